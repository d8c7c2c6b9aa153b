"""Dives of the whole stack in virtual time, and how far dead reckoning is off then."""

from math import hypot
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gloc3.clock import run_virtual
from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import Pose
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.path_error import TruthSample
from gloc3_sitl.flight.plan import FlightPlan

SHORT_DIVE = """\
mission: a short dive
frame: bay
geofence: {polygon_m: [[-40, -40], [60, -40], [60, 40], [-40, 40]], ceiling_m: 3}
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: land
tasks:
  down:
    actions:
      dive: {dive: {depth_m: 2}}
  out:
    after: [down]
    actions:
      line: {go_to: {position_m: [16, 4, -3], speed_m_s: 0.5}}
  up:
    after: [out]
    actions:
      surface: {land: {}}
"""
"""A mission under water in the bay, 16 m long."""
UNDER_WATER_M = 1.0
"""Deeper than this it counts as diving."""
_EVERY_M = 2.0
_WORTH_M = 30.0
"""A share of the way is told from here on."""


class Dive(NamedTuple):
    """What came of one."""

    state: str
    """Of the mission."""
    reason: str
    distance_m: float
    """Under water, over ground."""
    off_m: float
    """How much the error of the pose had grown when the vehicle came up."""
    worst: float
    """Largest error on the way, as a share of the way until then."""
    claimed_m: float
    """Standard deviation that was claimed at the end, less what it began with."""
    deepest_m: float
    back_m: float
    """Error of the last pose, at the surface."""
    reasons: tuple[str, ...]
    """What the pose said of itself, in order."""
    along: float
    """Error along the straight from the begin where it is farthest from there, as a share of that: the velocity's scale."""
    across: float
    """Error across it: heading and mounting."""
    errors: tuple[tuple[float, float], ...]
    """Way and error, every few metres."""


def dive(
    mission: str,
    platform: str,
    seed: int,
    folder: Path,
    world: str = "bay",
    faults: tuple[str, ...] = (),
    out: str = "",
    waves_m: float = 0.0,
) -> Dive:
    """Dives.

    Args:
        mission: the text of one.
        platform: the name of one that reckons its way.
        seed: of all chance.
        folder: for what has to be a file.
        world: its name or file.
        faults: as for `gloc3 fly`.
        out: name of a folder in `folder` for the log; empty keeps none.
        waves_m: significant height.
    """
    file = folder / "mission.yaml"
    file.write_text(mission)
    log = folder / out if out else None
    plan = FlightPlan(mission=str(file), platform=platform, seed=seed, world=world, out=log, waves_m=waves_m)
    return run_virtual(_dive(plan, faults))


async def _dive(plan: FlightPlan, faults: tuple[str, ...]) -> Dive:
    poses: list[Envelope[Pose]] = []
    async with Flight(plan) as flight:
        schedule_faults(flight, faults)
        flight.exchange.subscribe(f"{flight.name}/pose", poses.append)
        follower = await flight.upload_and_start()
        end = await flight.await_end(follower, within_s=3000.0)
        samples = list(flight.truth.samples)
    return _judged(str(end.state), end.reason, poses, samples)


def _judged(state: str, reason: str, poses: list[Envelope[Pose]], samples: list[TruthSample]) -> Dive:
    times = np.array([sample.t_s for sample in samples])
    truth = np.array([sample.position_ned_m for sample in samples])
    reported = [envelope for envelope in poses if envelope.payload.is_valid and times[0] <= envelope.t_s <= times[-1]]
    at = np.array([envelope.t_s for envelope in reported])
    true = np.column_stack([np.interp(at, times, truth[:, axis]) for axis in range(3)])
    off = np.array([envelope.payload.position_ned_m for envelope in reported])[:, :2] - true[:, :2]
    deep = np.flatnonzero(true[:, 2] > UNDER_WATER_M)
    first, last = (int(deep[0]), int(deep[-1])) if len(deep) else (0, len(at) - 1)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(true[first : last + 1, :2], axis=0).T))])
    grown = np.hypot(*(off[first : last + 1] - off[first]).T)
    far = way > min(_WORTH_M, 0.5 * way[-1])
    claimed = [hypot(*reported[index].payload.position_std_m[:2]) for index in (first, last)]
    out = true[first : last + 1, :2] - true[first, :2]
    farthest = int(np.argmax(np.hypot(*out.T)))
    away = float(np.hypot(*out[farthest]))
    error, unit = off[first + farthest] - off[first], out[farthest] / max(away, 1e-9)
    marks = np.searchsorted(way, np.arange(0.0, way[-1], _EVERY_M))
    reasons = dict.fromkeys(envelope.payload.reason for envelope in reported if envelope.payload.reason)
    return Dive(
        state=state,
        reason=reason,
        distance_m=float(way[-1]),
        off_m=float(grown[-1]),
        worst=float(np.max(grown[far] / way[far])),
        claimed_m=float(np.sqrt(max(0.0, claimed[1] ** 2 - claimed[0] ** 2))),
        deepest_m=float(true[:, 2].max()),
        back_m=float(hypot(*off[-1])),
        reasons=tuple(reasons),
        along=float(error @ unit) / away,
        across=float(error[1] * unit[0] - error[0] * unit[1]) / away,
        errors=tuple((round(float(way[mark]), 2), round(float(grown[mark]), 3)) for mark in marks),
    )
