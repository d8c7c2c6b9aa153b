"""One kind of bad input to one sensor for a while, between good ones; what becomes of it in every component."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np
from tests.onboard.algorithms.vision import test_optical_follower as tracker
from tests.onboard.bad_input.chains import (
    CHAINS,
    HEIGHT_M,
    LAMP,
    START,
    Calibrations,
    Chain,
    Shot,
    error_m,
    is_finite,
    pictures,
)
from tests.onboard.messages import autopilot_pose, flying
from tests.onboard.scripted_sources import ScriptedSource

from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.messages.perception import ImuSample
from gloc3.messages.vehicle import HeightAboveGround, Image

STEP_S = 0.01
STEPS_A_FRAME = 10
GOOD_S = 1.5
GRACE_S = 0.25
"""So long after the begin of bad input what was on its way may still be told."""
WITHIN_S = 2.5
"""So soon everything is valid again: a source that was turned down has a second of probation."""
RIGHT_M = 0.1
MOVED_M = 0.2
"""What a vehicle could have moved between two pictures, as far as one camera can tell."""

Delivery = tuple[float, Shot]
"""How much later than now it is stamped, and what it is."""


class Given(NamedTuple):
    """What bad input is made of."""

    good: Shot
    before: Shot
    """The last one before it went wrong."""
    number: int
    """Counts from the begin of the bad input."""


class BadInput(NamedTuple):
    """A kind of bad input."""

    make: Callable[[Given], list[Delivery]]
    sensors: tuple[str, ...]
    is_reported: bool = True
    """A component of the chain must say that it cannot be used; otherwise what is told may be right instead."""
    height_m: float = HEIGHT_M
    """What the height sensor says meanwhile."""
    right_m: float = RIGHT_M
    """So wrong one report may be that is called valid; the pose may not."""


def _each(corrupt: Callable[[Any], Any]) -> Callable[[Given], list[Delivery]]:
    """Every part of every shot is spoilt."""
    return lambda given: [(0.0, tuple(map(corrupt, given.good)))]


def _pixels(corrupt: Callable[[Any], Any]) -> Callable[[Given], list[Delivery]]:
    def corrupted(image: Image) -> Image:
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
        return pictures([image.camera], [np.ascontiguousarray(corrupt(pixels))])[0]

    return _each(corrupted)


def _ranges(value: float) -> Callable[[Given], list[Delivery]]:
    return _each(lambda scan: msgspec.structs.replace(scan, ranges_m=np.full(360, value, "<f4").tobytes()))


def _torn(one: Any) -> Any:
    field = "data" if isinstance(one, Image) else "ranges_m"
    return msgspec.structs.replace(one, **{field: getattr(one, field)[: len(getattr(one, field)) * 2 // 3 + 1]})


def _mixed(given: Given) -> list[Delivery]:
    """Every other picture is moved to the side below some line, as where lines were lost in transit."""
    random = np.random.default_rng(given.number)
    line, shift = random.uniform(0.2, 0.8), int(random.integers(40, 280))

    def corrupt(pixels: Any) -> Any:
        row = round(line * len(pixels))
        return np.vstack([pixels[:row], np.roll(pixels[row:], shift, axis=1)])

    return [(0.0, given.good)] if given.number % 2 else _pixels(corrupt)(given)


def _two_lights(given: Given) -> list[Delivery]:
    return [(0.0, pictures(["tracker"], [tracker.seen(LAMP, (LAMP[0], LAMP[1] + 0.16, LAMP[2]), seed=given.number)]))]


EYES = ("stereo", "ground", "tracker")
ALL = (*EYES, "laser")
SEEN_BY_HEIGHT = ("ground", "tracker")
INPUTS: Mapping[str, BadInput] = {
    "black": BadInput(_pixels(lambda pixels: pixels * 0), EYES),
    "white": BadInput(_pixels(lambda pixels: pixels * 0 + 255), EYES),
    "torn: bytes are missing": BadInput(_each(_torn), ALL),
    "torn: every other one is shifted below a line": BadInput(_mixed, EYES, is_reported=False, right_m=MOVED_M),
    "of the wrong size": BadInput(_pixels(lambda pixels: pixels[::2, ::2]), EYES),
    "time runs backwards": BadInput(lambda given: [(-0.2 * given.number - 0.05, given.good)], ALL),
    "stamped in the future": BadInput(lambda given: [(5.0, given.good)], ALL, is_reported=False),
    "not a time": BadInput(lambda given: [(math.nan, given.good)], ALL),
    "stuck: the same with new times": BadInput(lambda given: [(0.0, given.before)], ALL),
    "duplicated: each twice": BadInput(lambda given: [(0.0, given.good)] * 2, ALL, is_reported=False),
    "missing: two of three": BadInput(
        lambda given: [(0.0, given.good)] if given.number % 3 == 0 else [], ALL, is_reported=False
    ),
    "missing: all": BadInput(lambda given: [], ALL),
    "all ranges NaN": BadInput(_ranges(math.nan), ("laser",)),
    "all ranges zero": BadInput(_ranges(0.0), ("laser",)),
    "all ranges at the maximum": BadInput(_ranges(30.0), ("laser",)),
    "two lights": BadInput(_two_lights, ("tracker",)),
    "height NaN": BadInput(lambda given: [(0.0, given.good)], SEEN_BY_HEIGHT, is_reported=False, height_m=math.nan),
    "height zero": BadInput(lambda given: [(0.0, given.good)], SEEN_BY_HEIGHT, is_reported=False, height_m=0.0),
    "height at the maximum": BadInput(
        lambda given: [(0.0, given.good)], SEEN_BY_HEIGHT, is_reported=False, height_m=40.0
    ),
}


def _other_size(rig: Calibrations) -> None:
    """Pictures of another mode of the camera were calibrated."""
    rig.models = {
        name: msgspec.structs.replace(model, width=model.width * 2, height=model.height * 2)
        for name, model in rig.models.items()
    }


def _rows_off(rig: Calibrations) -> None:
    """One of the two cameras was knocked."""
    right = rig.models["front_right"]
    moved = msgspec.structs.replace(right, center_px=(right.center_px[0], right.center_px[1] + 4.0))
    rig.models = {**rig.models, "front_right": moved}


MISFITS: Mapping[str, tuple[Callable[[Calibrations], None], tuple[str, ...]]] = {
    "calibrated for another size": (_other_size, EYES),
    "a camera moved since it was calibrated": (_rows_off, ("stereo",)),
}


class Outcome(msgspec.Struct, kw_only=True):
    """What one component made of it."""

    reason: str = ""
    """The last one that it gave while the input was bad; empty where it called everything valid."""
    valid: int = 0
    invalid: int = 0
    """Reports while the input was bad."""
    error_m: float = 0.0
    """The worst of those that it called valid, beyond what their covariance admits."""
    again_s: float = math.inf
    """After the input was good again: until everything was valid for good."""
    is_finite: bool = True
    is_working: bool = True
    is_reasoned: bool = True
    """Whatever was not valid had a reason."""

    def faults(self, right_m: float = RIGHT_M) -> list[str]:
        """What it did that it must not."""
        found = {
            "tells what is no number": not self.is_finite,
            "is faulty": not self.is_working,
            "is not valid without a reason": not self.is_reasoned,
            f"is wrong by {self.error_m:.2f} m": self.error_m > right_m,
            "is not valid again": self.again_s > WITHIN_S,
        }
        return [fault for fault, is_so in found.items() if is_so]


def faults(name: str, outcomes: Mapping[str, Outcome], *, is_long: bool) -> list[str]:
    """What went wrong in a chain; empty where all is as it must be.

    Args:
        name: of the kind of bad input.
        outcomes: by component.
        is_long: it lasted so long that the pose must not be valid any more where the input cannot be used.
    """
    given = INPUTS.get(name)
    is_reported, right_m = (given.is_reported, given.right_m) if given is not None else (True, RIGHT_M)
    *before, fused = outcomes
    found = [f"{one} {fault}" for one in before for fault in outcomes[one].faults(right_m)]
    found += [f"{fused} {fault}" for fault in outcomes[fused].faults()]
    if is_reported and not any(outcomes[one].invalid for one in before):
        found.append("nobody tells")
    if is_reported and is_long and not outcomes[fused].invalid:
        found.append("the pose stays valid")
    return found


class Trial:
    """A chain on a bench, the vehicle standing still in the air.

    Args:
        sensor: the name of the chain.
        with_sampler: the input comes from the device; otherwise it is published, and no sampler marks it.
    """

    def __init__(self, sensor: str, *, with_sampler: bool) -> None:
        self.chain: Chain = CHAINS[sensor]
        self.rig = Calibrations()
        self.height_m = HEIGHT_M
        self.bench = Bench()
        self._with_sampler = with_sampler
        self._source = ScriptedSource()
        self._random = np.random.default_rng(3)
        self._frames = self._steps = 0
        self._received: list[tuple[float, str, Any]] = []
        """When, on which topic, and what."""
        self.before = self.chain.poll(0)
        self.reports = self.chain.reports(with_sampler=with_sampler)
        self.outcomes = {name: Outcome() for name in self.reports}
        self.chain.host(self.bench, self.rig, self._source, with_sampler=with_sampler)

    def __enter__(self) -> "Trial":
        self.bench.__enter__()
        return self

    def __exit__(self, *_: Any) -> None:
        self.bench.__exit__(None, None, None)

    def good(self, duration_s: float) -> None:
        """Good input for a while."""
        self._run(duration_s, lambda given: [(0.0, given.good)])

    def bad(self, name: str, duration_s: float, good_s: float = WITHIN_S + 0.5) -> dict[str, Outcome]:
        """Bad input for a while, then good input again; by component."""
        given = INPUTS[name]
        self.height_m = given.height_m
        begin_s = self._begin()
        self._run(duration_s, given.make)
        self.height_m = HEIGHT_M
        return self._end(begin_s, good_s)

    def misfit(self, name: str, duration_s: float, good_s: float = WITHIN_S + 0.5) -> dict[str, Outcome]:
        """Good input under a calibration that does not fit, then under the one that does."""
        models = self.rig.models
        MISFITS[name][0](self.rig)
        self._initialize_anew()
        begin_s = self._begin()
        self.good(duration_s)
        self.rig.models = models
        self._initialize_anew()
        return self._end(begin_s, good_s)

    def _initialize_anew(self) -> None:
        for name in [one for one in self.reports if one != "fusion"]:
            for command in ("stop", "initialize", "start"):
                assert self.bench.command(name, command).is_accepted

    def _begin(self) -> float:
        self.outcomes = {one: Outcome() for one in self.reports}
        self._received.clear()
        return self.bench.loop.time()

    def _end(self, begin_s: float, good_s: float) -> dict[str, Outcome]:
        end_s = self.bench.loop.time()
        self.good(good_s)
        for one, topic in self.reports.items():
            self._judge(self.outcomes[one], topic, begin_s, end_s)
        return self.outcomes

    def _judge(self, outcome: Outcome, topic: str, begin_s: float, end_s: float) -> None:
        reported = [(at_s, message) for at_s, received, message in self._received if received == topic]
        outcome.is_finite = all(is_finite(message) for _, message in reported)
        outcome.is_reasoned = all(message.is_valid or message.reason for _, message in reported)
        wrong = [error_m(message) for at_s, message in reported if message.is_valid and at_s > begin_s]
        outcome.error_m = max(wrong, default=0.0)
        for at_s, message in reported:
            if begin_s + GRACE_S < at_s <= end_s:
                outcome.valid += message.is_valid
                outcome.invalid += not message.is_valid
                outcome.reason = outcome.reason if message.is_valid else message.reason
        after = [(at_s, message.is_valid) for at_s, message in reported if at_s > end_s]
        if after and after[-1][1]:
            last = max((at_s for at_s, is_valid in after if not is_valid), default=end_s)
            outcome.again_s = round(last - end_s, 2)

    # --- what comes ---

    def _run(self, duration_s: float, make: Callable[[Given], list[Delivery]]) -> None:
        number = 0
        for _ in range(round(duration_s / STEP_S)):
            self._measure_forces()
            if self._steps % STEPS_A_FRAME == 0:
                self._frames += 1
                shot = self.chain.poll(self._frames)
                for late_s, one in make(Given(shot, self.before, number)):
                    self._deliver(self.bench.loop.time() + late_s, one)
                    self.bench.run(STEP_S / 10)
                number += 1
            self._steps += 1
            self.bench.run(STEP_S)
            self._keep()
        if number:
            self.before = shot

    def _deliver(self, t_s: float, shot: Shot) -> None:
        if self._with_sampler:
            self.chain.stamp(self._source, t_s, shot)
            self._source.bell.ring()
            return
        for topic, message in zip(self.chain.topics, shot, strict=True):
            self.bench.send(topic, message, t_s=t_s)

    def _measure_forces(self) -> None:
        """Everything else that the components hear."""
        rate = tuple((self._random.normal(size=3) * 7e-4).tolist())
        force = tuple((self._random.normal(size=3) * 0.02 + (0.0, 0.0, -9.80665)).tolist())
        self.bench.send("imu", ImuSample(rate_frd_rad_s=rate, specific_force_frd_m_s2=force))
        if self._steps % 5 == 0:
            self.bench.send("autopilot_pose", autopilot_pose(START[0], START[1], -START[2]))
            height_m = self.height_m
            if height_m == HEIGHT_M:
                height_m += self._random.normal() * 0.005
            self.bench.send("height", HeightAboveGround(height_m=height_m, is_valid=True))
        if self._steps % 20 == 0:
            self.bench.send("autopilot", flying())

    def _keep(self) -> None:
        now_s = self.bench.loop.time()
        for envelope in self.bench.envelopes:
            topic = envelope.topic.removeprefix("bench/")
            if topic in self.reports.values() and envelope.source.component != "bench":
                self._received.append((now_s, topic, envelope.payload))
        self.bench.envelopes.clear()
        for name, outcome in self.outcomes.items():
            outcome.is_working &= self.bench.state(name) is State.WORKING
