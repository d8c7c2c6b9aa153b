"""Every fault of every source of the pose in mid flight, every pair of them removed, and two or three different faults
at once: what becomes of the mission.

The whole stack flies, pictures and all. Each row is what `gloc3 fly tests/evidence/ablation.yaml --platform PLATFORM
--fault FAULT@12..` flies.
"""

import asyncio
import os
import random
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import combinations, islice
from math import hypot
from pathlib import Path
from typing import Any, Final, NoReturn

import msgspec
from tests.evidence.page import Bar, Figure, Progress

from gloc3.clock import VirtualLoop
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, interpolate
from gloc3.messages.vehicle import LandedState, Pose
from gloc3.mission.model.states import ActionState
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.messages import SimTruth
from gloc3_sitl.flight.plan import FlightPlan
from gloc3_sitl.proof.space import DISHONEST_S, LEAST_STD_M, SIGMAS

Heard = dict[str, list[Envelope[Any]]]
"""Everything that was published, by topic below the platform's name."""

MISSION: Final = Path(__file__).with_name("ablation.yaml")
FAULT_S: Final = 12.0
"""About 3 m into the way of 11 m."""
AT_ONCE: Final = 2
"""Processes."""
GIVEN_UP_S: Final = 150.0
ENDED: Final = (ActionState.DONE, ActionState.FAILED, ActionState.SKIPPED, ActionState.ABORTED)
LANDING: Final = ("policy", "down running")
"""What an event says that tells of a landing."""
DEVICES: Final = {
    "stereo": "device:stereo_camera",
    "ground": "device:ground_camera",
    "laser": "device:laser",
    "tracker": "device:tracker_camera",
    "height": "sensor:height",
    "imu": "device:imu",
}
"""Source of the pose, to the device that it comes from."""
SOURCES: Final = {"pelican": tuple(DEVICES), "hummingbird": tuple(name for name in DEVICES if name != "laser")}
FAULTS: Final = {
    "removed": "lost",
    "frozen": "stuck",
    "scale 5 %": "scaled/0.05",
    "step 0.2 m": "step/0.2",
    "late 200 ms": "late/0.2",
    "late, stamped as new": "old/0.2",
    "garbage": "garbage",
}
HEIGHT: Final = {"step 0.2 m": "biased/0.2", "garbage": "noisy/5"}
"""The words of the height sensor, where they are others."""
DRAWN: Final = 40
"""So many rows have two different faults at once, and so many three."""
HARD_M_S: Final = 1.0
"""No touch-down is faster, downward."""
ASIDE_M, DRIFTED_M = 1.0, 3.0
"""No landing by a policy ends farther from where the policy began; the second, where several sources lie and the autopilot
comes down without a position."""
LARGEST_M: Final = 0.3
"""No valid pose is farther off."""


def faults_of(faults: Mapping[str, str]) -> tuple[str, ...]:
    """The faults, by source, as `gloc3 fly` takes them."""
    words = {
        name: HEIGHT.get(fault, FAULTS[fault]) if name == "height" else FAULTS[fault] for name, fault in faults.items()
    }
    return tuple(f"{DEVICES[name]}={word}" for name, word in words.items())


class Row(msgspec.Struct, kw_only=True):
    """What became of a flight."""

    state: str
    """Of the mission, at its end."""
    reason: str
    worst_m: float
    """Largest error of a valid pose in the air, against the simulated truth."""
    dishonest_s: float
    """Longest time for which one was off by more than four of its standard deviations."""
    found_s: float | None
    """From the fault to the first pose that does not rest on one of the sources; None for never before the landing."""
    before: list[str]
    """The sources that the pose rested on just before."""
    after: list[str]
    """And at the touch-down."""
    least_quality: float
    """Of a pose in the air, after the fault."""
    pose_reason: str
    """Why the pose was not valid, where it was not."""
    touch_m_s: float
    """Fastest descent below 0.3 m."""
    aside_m: float
    """From where the policy began, or the landing, to the touch-down."""


def fly(platform: str, rows: Mapping[str, Mapping[str, str]], handle: Callable[[str, Row], None]) -> None:
    """Flies to the fault once, and from there in a process of its own for each row: what was before is the same for all.

    Args:
        platform: which one.
        rows: the faults of each by source, by its key.
        handle: told the outcome of a row by its key.
    """
    import cv2

    cv2.setNumThreads(1)  # threads do not live on in a fork
    received: Heard = {}
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        flight = runner.run(_begin(platform, received))
        children: dict[int, tuple[str, int]] = {}
        for key, faults in rows.items():
            if len(children) == AT_ONCE:
                _await_one(children, handle)
            reading, writing = os.pipe()
            child = os.fork()
            if child == 0:
                _go_on(runner, flight, received, faults, writing)
            os.close(writing)
            children[child] = (key, reading)
        while children:
            _await_one(children, handle)
        runner.run(flight.__aexit__(None, None, None))


async def _begin(platform: str, received: Heard) -> Flight:
    """A flight, until the fault."""
    flight = await Flight(FlightPlan(mission=str(MISSION), platform=platform)).__aenter__()
    flight.exchange.subscribe(f"{flight.name}/**", partial(_receive, received))
    await flight.upload_and_start()
    await asyncio.sleep(FAULT_S - flight.loop.time())
    return flight


def _receive(received: Heard, envelope: Envelope[Any]) -> None:
    topic = envelope.topic.partition("/")[2]
    if not topic.startswith("camera/"):
        received.setdefault(topic, []).append(envelope)


def _go_on(
    runner: asyncio.Runner, flight: Flight, received: Heard, faults: Mapping[str, str], writing: int
) -> NoReturn:
    """In the child: flies to the end, and writes what became of it into a pipe."""
    try:
        runner.run(_to_the_end(flight, received, faults))
        os.write(writing, msgspec.json.encode(judge(received, faults)))
    finally:
        if sys.exception() is not None:
            traceback.print_exc()
        os._exit(0)


async def _to_the_end(flight: Flight, received: Heard, faults: Mapping[str, str]) -> None:
    schedule_faults(flight, faults_of(faults))
    while not _is_over(received) and flight.loop.time() < GIVEN_UP_S:
        await asyncio.sleep(0.1)


def _is_over(received: Heard) -> bool:
    return received["ci/mission"][-1].payload.state in ENDED and not received["autopilot"][-1].payload.is_armed


def _await_one(children: dict[int, tuple[str, int]], handle: Callable[[str, Row], None]) -> None:
    child, _ = os.wait()
    key, reading = children.pop(child)
    with os.fdopen(reading, "rb") as pipe:
        reported = pipe.read()
    handle(key, msgspec.json.decode(reported, type=Row))


def judge(received: Heard, faults: Mapping[str, str]) -> Row:
    """Looks at what was published."""
    poses, truths, states = received["pose"], received["sim/truth"], received["autopilot"]
    reported = [event for event in received["ci/event"] if any(word in event.payload.text for word in LANDING)]
    landing_s = reported[0].t_s if reported else float("inf")
    flying = [state.t_s for state in states if state.payload.is_armed and state.payload.landed is LandedState.IN_AIR]
    begin_s, end_s = flying[0], max(truth.t_s for truth in truths if -truth.payload.position_ned_m[2] > 0.1)
    at = [truth for truth in truths if begin_s <= truth.t_s <= end_s + 0.2]
    low = [truth for truth in at if truth.t_s > FAULT_S and -truth.payload.position_ned_m[2] < 0.3]
    place = next((truth for truth in at if truth.t_s >= landing_s), at[-1]).payload.position_ned_m
    (north, east, _), touch = place, at[-1].payload.position_ned_m
    aloft = [pose for pose in poses if begin_s <= pose.t_s <= end_s]
    since = [pose for pose in aloft if pose.t_s >= FAULT_S]
    before_landing = [pose for pose in since if pose.t_s < landing_s]  # near the floor some see nothing anyway
    missing = (pose.t_s for pose in before_landing if any(name not in pose.payload.sources for name in faults))
    found = next((t_s - FAULT_S for t_s in missing), None)
    off = list(_errors(aloft, truths))
    return Row(
        state=received["ci/mission"][-1].payload.state,
        reason=received["ci/mission"][-1].payload.reason,
        worst_m=max((hypot(*error) for _, error, _ in off), default=0.0),
        dishonest_s=_longest_s(off),
        found_s=found,
        before=next((pose.payload.sources for pose in reversed(aloft) if pose.t_s < FAULT_S), []),
        after=since[-1].payload.sources,
        least_quality=min(pose.payload.quality for pose in since),
        pose_reason=next((pose.payload.reason for pose in since if not pose.payload.is_valid), ""),
        touch_m_s=max((truth.payload.velocity_ned_m_s[2] for truth in low), default=0.0),
        aside_m=hypot(touch[0] - north, touch[1] - east),
    )


def _errors(
    poses: Sequence[Envelope[Pose]], truths: Sequence[Envelope[SimTruth]]
) -> Iterator[tuple[float, tuple[float, ...], Vector3]]:
    """Time, error along each axis and its standard deviation, of each valid pose."""
    at = 0
    for pose in poses:
        while at + 2 < len(truths) and truths[at + 1].t_s <= pose.t_s:
            at += 1
        before, after = truths[at], truths[at + 1]
        if pose.payload.is_valid and before.t_s <= pose.t_s <= after.t_s:
            share = (pose.t_s - before.t_s) / (after.t_s - before.t_s)
            true = interpolate(before.payload.position_ned_m, after.payload.position_ned_m, share)
            found = pose.payload
            yield (
                pose.t_s,
                tuple(a - b for a, b in zip(found.position_ned_m, true, strict=True)),
                found.position_std_m,
            )


def _longest_s(off: Sequence[tuple[float, tuple[float, ...], Vector3]]) -> float:
    """Longest time of errors that are larger than told."""
    longest_s, since_s = 0.0, None
    for t_s, error, std_m in off:
        is_wrong = any(abs(a) > SIGMAS * max(b, LEAST_STD_M) for a, b in zip(error, std_m, strict=True))
        since_s = (t_s if since_s is None else since_s) if is_wrong else None
        longest_s = max(longest_s, t_s - since_s) if since_s is not None else longest_s
    return longest_s


# --- the page ---


def rows_of(platform: str) -> dict[str, dict[str, str]]:
    """The faults of each row by source, by its key."""
    sources = SOURCES[platform]
    alike: list[tuple[tuple[str, ...], str]] = [((name,), fault) for name in sources for fault in FAULTS]
    alike += [(pair, "removed") for pair in combinations(sources, 2)]
    alike.append((tuple(name for name in sources if name not in ("height", "imu")), "removed"))
    rows = {f"{platform}: {' and '.join(names)} {fault}": dict.fromkeys(names, fault) for names, fault in alike}
    for count in (2, 3):
        for faults in islice(_drawn(sources, count), DRAWN):
            rows[f"{platform}: " + ", ".join(f"{name} {fault}" for name, fault in faults.items())] = faults
    return rows


def _drawn(sources: Sequence[str], count: int) -> Iterator[dict[str, str]]:
    """So many sources with a fault each, not all with the same, never twice alike."""
    chosen, seen = random.Random(count), set[tuple[tuple[str, str], ...]]()
    while True:
        faults = {name: chosen.choice(tuple(FAULTS)) for name in sorted(chosen.sample(sources, count))}
        key = tuple(faults.items())
        if key not in seen and len(set(faults.values())) > 1:
            seen.add(key)
            yield faults


def problems(row: Row, faults: Mapping[str, str]) -> list[str]:
    """What is wrong with how a flight went; nothing where all is well."""
    is_done, is_one = row.state == ActionState.DONE, len(faults) == 1
    is_bounded = is_one or set(faults.values()) == {"removed"}
    found = []
    if not is_done and is_one:
        found.append(f"mission {row.state}")
    if not is_done and not row.reason:
        found.append("no reason is given")
    if is_bounded and row.worst_m > LARGEST_M:
        found.append("the pose is off")
    if row.dishonest_s > DISHONEST_S:
        found.append(f"the pose was wrong without telling for {row.dishonest_s:.1f} s")
    if row.touch_m_s > HARD_M_S:
        found.append("it came down hard")
    if row.aside_m > (ASIDE_M if is_bounded else DRIFTED_M):
        found.append("it came down elsewhere")
    return found


def reported(row: Row) -> str:
    """A flight in a line."""
    found = "taken in as it is" if row.found_s is None else f"found after {row.found_s:.2f} s"
    end = row.state if row.state == ActionState.DONE else f"{row.state}: {row.reason}"
    return (
        f"{end}; off by {row.worst_m * 1e3:.0f} mm at most, {found}, quality {row.least_quality:.2f} at least; "
        f"down at {row.touch_m_s:.1f} m/s, {row.aside_m:.2f} m aside; then used: {', '.join(sorted(row.after))}"
    )


def run(progress: Progress) -> list[Figure]:
    """The bar."""
    figures = []
    for platform in SOURCES:
        rows = rows_of(platform)
        left = {key: faults for key, faults in rows.items() if not progress.knows(key)}
        if left:
            progress.report(f"{platform}: {len(left)} of {len(rows)} rows to fly")
            fly(platform, left, lambda key, row: progress.part(key, lambda: row))
        for key, faults in rows.items():
            row = msgspec.convert(progress.part(key, _flown), Row)
            wrong = problems(row, faults)
            bar = "done" if len(faults) == 1 else "done, or a safe landing with its reason"
            figures.append(Figure(key, reported(row) + "".join(f"; **{text}**" for text in wrong), bar, not wrong))
    return figures


def _flown() -> Row:
    raise AssertionError("the row was not flown")


BARS = (
    Bar(
        "ablation",
        "Any source of the pose may fail in flight: the mission is done, or ends in a safe landing",
        "The whole stack flies 11 m in the hold at 0.7 m/s, with rendered pictures. After 12 s, with 8 m to go, one "
        "source of the pose fails for good, or two are removed, or all that hold the position, or two or three have "
        f"different faults at once ({DRAWN} of each are drawn). With one failure the mission is done. With more it is done, "
        f"or its policy lands the vehicle with the reason, at no more than {HARD_M_S:g} m/s and {ASIDE_M:g} m aside "
        f"({DRIFTED_M:g} m where several sources lie, since the autopilot then comes down without a position). A valid pose is "
        f"never off by more than {SIGMAS:g} of its standard deviations for {DISHONEST_S:g} s, and with one failure, or "
        f"removed sources, by no more than {LARGEST_M:g} m. The time is that to the first pose that does not use the source.",
        run,
        seeds="0",
    ),
)
