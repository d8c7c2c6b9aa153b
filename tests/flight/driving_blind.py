"""Drives of the rover where satellites are not seen for a while, in virtual time, and how far its pose is off then."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gloc3.clock import run_virtual
from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import Pose
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan


class Drive(NamedTuple):
    """What came of one."""

    state: str
    """Of the mission."""
    distance_m: float
    """Driven while satellites were away."""
    off_m: float
    """By how much the pose was off at the end of that, more than at its begin."""
    claimed_m: float
    """The standard deviation along the worse axis that it claimed then."""
    worst_m: float
    """Largest error of the whole drive."""
    turns: int
    """Changes of the autopilot's set of sources."""
    reasons: tuple[str, ...]
    """What the valid poses said of themselves."""
    sources: tuple[tuple[str, ...], ...]
    """What they rested on, in order."""


def drive(
    mission: str, folder: Path, *, away: tuple[float, float], seed: int = 1, faults: tuple[str, ...] = ()
) -> Drive:
    """Drives.

    Args:
        mission: the text of one in the rover's frame.
        folder: for what has to be a file.
        away: from when to when no satellites are seen, in seconds.
        seed: of all chance.
        faults: further ones, as for `gloc3 fly`.
    """
    file = folder / "mission.yaml"
    file.write_text(mission)
    faults = (f"sensor:fix=lost@{away[0]:g}..{away[1]:g}", *faults)
    return run_virtual(_drive(FlightPlan(mission=str(file), platform="rover", seed=seed), away, faults))


async def _drive(plan: FlightPlan, away: tuple[float, float], faults: tuple[str, ...]) -> Drive:
    poses: list[Envelope[Pose]] = []
    async with Flight(plan) as flight:
        schedule_faults(flight, faults)
        flight.exchange.subscribe(f"{flight.name}/pose", poses.append)
        end = await flight.await_end(await flight.upload_and_start(), within_s=600.0)
        samples, texts = list(flight.truth.samples), list(flight.simulator.texts)
    times = np.array([sample.t_s for sample in samples])
    truth = np.array([sample.position_ned_m[:2] for sample in samples])
    reported = [envelope for envelope in poses if envelope.payload.is_valid and times[0] <= envelope.t_s <= times[-1]]
    at = np.array([envelope.t_s for envelope in reported])
    true = np.column_stack([np.interp(at, times, truth[:, axis]) for axis in range(2)])
    off = np.array([envelope.payload.position_ned_m[:2] for envelope in reported]) - true
    first, last = (int(np.searchsorted(at, min(t_s, at[-1]))) for t_s in away)
    routes = np.hypot(*np.diff(true[first : last + 1], axis=0).T)
    return Drive(
        state=str(end.state),
        distance_m=float(routes.sum()),
        off_m=math.dist(off[last], off[first]),
        claimed_m=max(reported[last].payload.position_std_m[:2]),
        worst_m=float(np.hypot(*off.T).max()),
        turns=sum("source set" in text for _, _, text in texts),
        reasons=tuple(dict.fromkeys(envelope.payload.reason for envelope in reported if envelope.payload.reason)),
        sources=tuple(dict.fromkeys(tuple(envelope.payload.sources) for envelope in reported)),
    )
