"""Flies a mission by the vehicle's own pose and says how far that was from the truth, by what it claimed to be."""

import asyncio
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy.special import chdtri
from tests.flight.probe import Array, Belief, ProbedFusion, probed

from gloc3.clock import run_virtual
from gloc3.evaluation.metrics import Evaluation, evaluate
from gloc3.evaluation.trajectory import Trajectory, matrices_from_quaternions
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Quaternion, conjugate, multiply, to_rotation_vector
from gloc3.messages.perception import Odometry
from gloc3_onboard.algorithms.odometry.chain import OdometryChain
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

TRUTH_PERIOD_S = 0.01
MOMENTS_S = 4.0
"""So far apart errors are looked at."""
ALOFT_M = 0.3
"""Accuracy is that of the pose while the vehicle is higher than this over its start; a lie counts at any height."""
UPRIGHT_M = 1.3
"""The odometers alone are judged above this: below, beside the sloping bilge hopper, a scanner cannot tell a descent from
a motion to the side, and says so."""
LOST_M = 0.15
"""A pose that is farther off, and by more than three of its own standard deviations, and valid, is a lie."""
ODOMETERS = ("stereo", "ground", "laser")


class Judged(msgspec.Struct, frozen=True, kw_only=True):
    """What a fusion was worth, while the vehicle was aloft."""

    rms_m: float
    """Of the distance from the truth, in the declared frame."""
    worst_m: float
    ate_m: float
    """The same, laid over the truth by the first tenth of the poses."""
    turn_deg: float
    end_m: float
    """Distance from the truth at the end, laid over it so."""
    nees_place: list[float]
    """Normalised squared errors of the position, three degrees of freedom, every `MOMENTS_S`."""
    nees: list[float]
    """The same of position and attitude, six degrees."""
    innovation: dict[str, float]
    """By source: mean normalised squared innovation over its degrees of freedom."""
    inside: dict[str, float]
    """By source: share of the innovations within their own 95 % bound."""
    beyond: float
    """Share of the valid poses that are off by more than three standard deviations."""
    lied_s: float
    valid: float
    """Share of the poses that are valid."""


class PoseTrial(msgspec.Struct, frozen=True, kw_only=True):
    """One flight."""

    state: str
    """Of the mission at its end."""
    way_m: float
    fused: Judged
    blind: Judged
    """The quiet fusion that does without the tracker."""
    odometers: dict[str, float]
    """By name: ATE in percent of the way, of its reports put end to end; the laser's in the plane."""


class TrueWay:
    """Where the vehicle really was."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, Any, Any, Quaternion]] = []

    def close(self) -> None:
        self.t_s = np.array([row[0] for row in self.rows])
        self.place = np.array([row[1] for row in self.rows])
        self.velocity = np.array([row[2] for row in self.rows])
        self.height_m = self.place[0, 2] - self.place[:, 2]
        is_aloft = self.height_m > ALOFT_M
        self.begin_s, self.end_s = float(self.t_s[is_aloft][0]), float(self.t_s[is_aloft][-1])
        flown = self.place[is_aloft]
        self.distance_m = float(np.linalg.norm(np.diff(flown, axis=0), axis=1).sum())

    def at(self, t_s: float) -> tuple[Array, Quaternion]:
        after = int(np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1))
        begin_s, period_s = self.t_s[after - 1], self.t_s[after] - self.t_s[after - 1]
        share = float(np.clip((t_s - begin_s) / period_s, 0.0, 1.0))
        place = self.place[after - 1] * (1.0 - share) + self.place[after] * share
        place += 0.5 * share * (share - 1.0) * period_s * (self.velocity[after] - self.velocity[after - 1])
        one, two = np.array(self.rows[after - 1][3]), np.array(self.rows[after][3])
        mixed = one * (1.0 - share) + two * (share if one @ two > 0.0 else -share)
        w, x, y, z = (mixed / np.linalg.norm(mixed)).tolist()
        return place, (w, x, y, z)

    def is_aloft(self, t_s: float) -> bool:
        return self.begin_s < t_s < self.end_s

    def is_upright(self, t_s: float) -> bool:
        return bool(np.interp(t_s, self.t_s, self.height_m) > UPRIGHT_M)

    def trajectory(self, times_s: list[float]) -> Trajectory:
        places, attitudes = zip(*(self.at(t_s) for t_s in times_s), strict=True)
        return _trajectory(times_s, list(places), list(attitudes))


def fly(
    mission: str, platform: str, seed: int, folder: Path, world: str = "", faults: tuple[str, ...] = ()
) -> PoseTrial:
    """Flies a mission in virtual time.

    Args:
        mission: a file, or the text of one.
        platform: the name of one that flies by its own pose.
        seed: of all chance.
        folder: for what has to be a file.
        world: its name; where it is empty, the one that the mission's frame belongs to.
        faults: as for `gloc3 fly`.
    """
    (folder / "platform.yaml").write_text(probed(platform))
    if "\n" in mission:
        (folder / "mission.yaml").write_text(mission)
        mission = str(folder / "mission.yaml")
    plan = FlightPlan(mission=mission, platform=str(folder / "platform.yaml"), seed=seed, world=world)
    return run_virtual(_fly(plan, faults))


async def _fly(plan: FlightPlan, faults: tuple[str, ...]) -> PoseTrial:
    ProbedFusion.made.clear()
    truth = TrueWay()
    reports: list[Envelope[Odometry]] = []
    async with Flight(plan) as flight:
        schedule_faults(flight, faults)
        watching = asyncio.ensure_future(watch(flight, truth))
        flight.exchange.subscribe(f"{flight.name}/odometry/*", reports.append)
        follower = await flight.upload_and_start()
        end = await flight.await_end(follower, within_s=400.0)
        watching.cancel()
    truth.close()
    fused, blind = ProbedFusion.made
    return PoseTrial(
        state=str(end.state),
        way_m=truth.distance_m,
        fused=judge(fused, truth),
        blind=judge(blind, truth),
        odometers={name: _alone(name, reports, truth) for name in ODOMETERS},
    )


async def watch(flight: Flight, truth: TrueWay) -> None:
    """Keeps the truth, until it is cancelled."""
    while True:
        now = flight.simulator.truth()
        if flight.truth.frame is not None and (not truth.rows or now.t_s > truth.rows[-1][0]):
            place = flight.truth.frame.ned_from_geo(now.latitude_deg, now.longitude_deg, now.altitude_m)
            truth.rows.append((now.t_s, place, now.velocity_ned_m_s, now.attitude_wxyz))
        await asyncio.sleep(TRUTH_PERIOD_S)


def judge(fusion: ProbedFusion, truth: TrueWay) -> Judged:
    """What one fusion was worth."""
    lied = [belief for belief in fusion.beliefs if belief.is_valid and _is_lie(belief, truth)]
    beliefs = [belief for belief in fusion.beliefs if truth.is_aloft(belief.t_s)]
    errors = np.array([_error(belief, truth) for belief in beliefs])
    reported = np.array([np.subtract(belief.reported_ned_m, truth.at(belief.t_s)[0]) for belief in beliefs])
    off_m = np.linalg.norm(reported, axis=1)
    claimed_m = np.array([np.sqrt(np.trace(belief.covariance[:3, :3])) for belief in beliefs])
    valid = np.array([belief.is_valid for belief in beliefs])
    times = np.array([belief.t_s for belief in beliefs])
    moments = np.unique(np.searchsorted(times, np.arange(times[0] + 1.0, times[-1], MOMENTS_S)))
    found = _evaluated([belief for belief in beliefs if belief.is_valid], truth)
    squares = {
        name: np.array([(square, degrees) for t_s, square, degrees in given if truth.is_aloft(t_s)])
        for name, given in fusion.innovations.items()
    }
    is_beyond = valid & (off_m > 3.0 * claimed_m)
    period_s = float(np.median(np.diff(times)))
    return Judged(
        rms_m=_rms(off_m[valid]),
        worst_m=float(off_m[valid].max()),
        ate_m=found.absolute_m.rms,
        turn_deg=float(np.degrees(_rms(np.linalg.norm(errors[valid, 3:], axis=1)))),
        end_m=found.end_m,
        nees_place=[_square(errors[at, :3], beliefs[at].covariance[:3, :3]) for at in moments],
        nees=[_square(errors[at], beliefs[at].covariance) for at in moments],
        innovation={name: float(np.mean(each[:, 0] / each[:, 1])) for name, each in squares.items()},
        inside={name: float(np.mean(each[:, 0] <= chdtri(each[:, 1], 0.05))) for name, each in squares.items()},
        beyond=float(is_beyond.sum() / valid.sum()),
        lied_s=len(lied) * period_s,
        valid=float(valid.mean()),
    )


def _is_lie(belief: Belief, truth: TrueWay) -> bool:
    off_m = float(np.linalg.norm(np.subtract(belief.reported_ned_m, truth.at(belief.t_s)[0])))
    return off_m > LOST_M and off_m > 3.0 * float(np.sqrt(np.trace(belief.covariance[:3, :3])))


def _error(belief: Belief, truth: TrueWay) -> Array:
    place, attitude = truth.at(belief.t_s)
    turn = to_rotation_vector(multiply(attitude, conjugate(belief.ned_from_frd)))
    return np.concatenate((place - belief.position_ned_m, turn))


def _square(error: Array, covariance: Array) -> float:
    return float(error @ np.linalg.solve(covariance, error))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _evaluated(beliefs: list[Belief], truth: TrueWay) -> Evaluation:
    times = [belief.t_s for belief in beliefs]
    places = [np.array(belief.reported_ned_m) for belief in beliefs]
    estimate = _trajectory(times, places, [belief.ned_from_frd for belief in beliefs])
    return evaluate(estimate, truth.trajectory(times))


def _alone(name: str, reports: list[Envelope[Odometry]], truth: TrueWay) -> float:
    """ATE of an odometer's own reports, in percent of the way."""
    chain: OdometryChain | None = None
    times, places, attitudes = [], [], []
    for report in reports:
        if not report.topic.endswith(f"/{name}") or not truth.is_upright(report.t_s):
            continue
        if chain is None:
            chain = OdometryChain(*_vector(truth.at(report.t_s)))
        if chain.add(report.payload, report.t_s):
            times.append(report.t_s)
            places.append(np.array(chain.position_m))
            attitudes.append(chain.attitude)
    if len(times) < 100:
        return float("nan")
    real = truth.trajectory(times)
    estimate = _trajectory(times, places, attitudes)
    if name == "laser":
        estimate.position_m[:, 2] = real.position_m[:, 2]
    return 100.0 * evaluate(estimate, real).absolute_m.rms / truth.distance_m


def _vector(pose: tuple[Array, Quaternion]) -> tuple[tuple[float, float, float], Quaternion]:
    north, east, down = pose[0].tolist()
    return (north, east, down), pose[1]


def _trajectory(times_s: list[float], places: list[Array], attitudes: list[Quaternion]) -> Trajectory:
    return Trajectory(
        t_s=np.array(times_s),
        position_m=np.array(places),
        world_from_body=matrices_from_quaternions(np.array(attitudes)),
    )
