"""Every fault of every source of the pose in mid flight, and every pair of them removed: what becomes of the mission.

The whole stack flies, pictures and all. Each row is what `gloc3 fly tests/evidence/ablation.yaml --platform PLATFORM
--fault FAULT@12..` flies.
"""

import asyncio
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations
from math import dist, hypot
from pathlib import Path
from typing import Any, Final, NoReturn

import msgspec
from tests.evidence.page import Bar, Figure, Progress

from gloc3.clock import VirtualLoop
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import interpolate
from gloc3.messages.vehicle import LandedState, Pose
from gloc3.mission.model.states import ActionState
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.messages import SimTruth
from gloc3_sitl.flight.plan import FlightPlan

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
HARD_M_S: Final = 1.0
"""No touch-down is faster, downward."""
ASIDE_M: Final = 1.0
"""No landing by a policy ends farther from where the policy began."""
LARGEST_M: Final = 0.3
"""No valid pose is farther off."""


def faults_of(sources: Sequence[str], fault: str) -> tuple[str, ...]:
    """The faults as `gloc3 fly` takes them."""
    words = [HEIGHT.get(fault, FAULTS[fault]) if name == "height" else FAULTS[fault] for name in sources]
    return tuple(f"{DEVICES[name]}={word}" for name, word in zip(sources, words, strict=True))


class Row(msgspec.Struct, kw_only=True):
    """What became of a flight."""

    state: str
    """Of the mission, at its end."""
    reason: str
    worst_m: float
    """Largest error of a valid pose in the air, against the simulated truth."""
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


def fly(platform: str, rows: Sequence[tuple[str, Sequence[str], str]], handle: Callable[[str, Row], None]) -> None:
    """Flies to the fault once, and from there in a process of its own for each row: what was before is the same for all.

    Args:
        platform: which one.
        rows: key, sources and fault of each.
        handle: told the outcome of a row by its key.
    """
    import cv2

    cv2.setNumThreads(1)  # threads do not live on in a fork
    received: Heard = {}
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        flight = runner.run(_begin(platform, received))
        children: dict[int, tuple[str, int]] = {}
        for key, sources, fault in rows:
            if len(children) == AT_ONCE:
                _await_one(children, handle)
            reading, writing = os.pipe()
            child = os.fork()
            if child == 0:
                _go_on(runner, flight, received, sources, fault, writing)
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
    runner: asyncio.Runner, flight: Flight, received: Heard, sources: Sequence[str], fault: str, writing: int
) -> NoReturn:
    """In the child: flies to the end, and writes what became of it into a pipe."""
    try:
        runner.run(_to_the_end(flight, received, sources, fault))
        os.write(writing, msgspec.json.encode(judge(received, sources)))
    finally:
        if sys.exception() is not None:
            traceback.print_exc()
        os._exit(0)


async def _to_the_end(flight: Flight, received: Heard, sources: Sequence[str], fault: str) -> None:
    schedule_faults(flight, faults_of(sources, fault))
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


def judge(received: Heard, sources: Sequence[str]) -> Row:
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
    missing = (pose.t_s for pose in before_landing if any(name not in pose.payload.sources for name in sources))
    found = next((t_s - FAULT_S for t_s in missing), None)
    return Row(
        state=received["ci/mission"][-1].payload.state,
        reason=received["ci/mission"][-1].payload.reason,
        worst_m=_worst_m(aloft, truths),
        found_s=found,
        before=next((pose.payload.sources for pose in reversed(aloft) if pose.t_s < FAULT_S), []),
        after=since[-1].payload.sources,
        least_quality=min(pose.payload.quality for pose in since),
        pose_reason=next((pose.payload.reason for pose in since if not pose.payload.is_valid), ""),
        touch_m_s=max((truth.payload.velocity_ned_m_s[2] for truth in low), default=0.0),
        aside_m=hypot(touch[0] - north, touch[1] - east),
    )


def _worst_m(poses: Sequence[Envelope[Pose]], truths: Sequence[Envelope[SimTruth]]) -> float:
    worst, at = 0.0, 0
    for pose in poses:
        while at + 2 < len(truths) and truths[at + 1].t_s <= pose.t_s:
            at += 1
        before, after = truths[at], truths[at + 1]
        if pose.payload.is_valid and before.t_s <= pose.t_s <= after.t_s:
            share = (pose.t_s - before.t_s) / (after.t_s - before.t_s)
            true = interpolate(before.payload.position_ned_m, after.payload.position_ned_m, share)
            worst = max(worst, dist(pose.payload.position_ned_m, true))
    return worst


# --- the page ---


def rows_of(platform: str) -> list[tuple[str, tuple[str, ...], str]]:
    """Key, sources and fault of each row."""
    sources = SOURCES[platform]
    rows: list[tuple[tuple[str, ...], str]] = [((name,), fault) for name in sources for fault in FAULTS]
    rows += [(pair, "removed") for pair in combinations(sources, 2)]
    rows.append((tuple(name for name in sources if name not in ("height", "imu")), "removed"))
    return [(f"{platform}: {' and '.join(names)} {fault}", names, fault) for names, fault in rows]


def problems(row: Row, *, is_one: bool) -> list[str]:
    """What is wrong with how a flight went; nothing where all is well."""
    is_done = row.state == ActionState.DONE
    found = []
    if not is_done and is_one:
        found.append(f"mission {row.state}")
    if not is_done and not row.reason:
        found.append("no reason is given")
    if row.worst_m > LARGEST_M:
        found.append("the pose is off")
    if row.touch_m_s > HARD_M_S:
        found.append("it came down hard")
    if row.aside_m > ASIDE_M:
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
        left = [row for row in rows if not progress.knows(row[0])]
        if left:
            progress.report(f"{platform}: {len(left)} of {len(rows)} rows to fly")
            fly(platform, left, lambda key, row: progress.part(key, lambda: row))
        for key, names, _ in rows:
            row = msgspec.convert(progress.part(key, _flown), Row)
            wrong = problems(row, is_one=len(names) == 1)
            bar = "done" if len(names) == 1 else "done, or a safe landing with its reason"
            figures.append(Figure(key, reported(row) + "".join(f"; **{text}**" for text in wrong), bar, not wrong))
    return figures


def _flown() -> Row:
    raise AssertionError("the row was not flown")


BARS = (
    Bar(
        "ablation",
        "Any source of the pose may fail in flight: the mission is done, or ends in a safe landing",
        "The whole stack flies 11 m in the hold at 0.7 m/s, with rendered pictures. After 12 s, with 8 m to go, one "
        "source of the pose fails for good, or two are removed, or all that hold the position. With one failure the "
        f"mission is done. With more it is done, or its policy lands the vehicle at no more than {HARD_M_S:g} m/s and "
        f"{ASIDE_M:g} m aside, with the reason. The largest error, at most {LARGEST_M:g} m, is that of a pose marked "
        "valid; the time is that to the first pose that does not use the source.",
        run,
        seeds="0",
    ),
)
