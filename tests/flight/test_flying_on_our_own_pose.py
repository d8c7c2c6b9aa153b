"""The vehicles of the paper fly by what their own sensors tell, without satellites."""

from asyncio import Future, ensure_future
from math import dist
from statistics import mean

import pytest
from tests.flight.card import Card
from tests.flight.missions import mission
from tests.flight.pose_trial import Judged, TrueWay, judge, watch
from tests.flight.probe import ProbedFusion, probed

from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, interpolate
from gloc3.messages.perception import FusionState
from gloc3.messages.vehicle import Pose
from gloc3_sitl.flight.messages import SimTruth

SWEEP = mission("{out: {follow_waypoints: {waypoints_m: [[4, 0, 1.5], [4, 2, 2]], speed_m_s: 0.5}}}")
SOURCES = {"pelican": {"stereo", "ground", "laser", "tracker"}, "hummingbird": {"stereo", "ground", "tracker"}}


def errors_m(flight: Card) -> list[float]:
    """How far each valid pose in the air was from the truth."""
    truth: list[Envelope[SimTruth]] = flight.received["sim/truth"]
    poses: list[Envelope[Pose]] = [pose for pose in flight.received["pose"] if pose.payload.is_valid]
    found, at = [], 0
    for pose in poses:
        while at + 1 < len(truth) and truth[at + 1].t_s <= pose.t_s:
            at += 1
        if at + 1 < len(truth) and truth[at].t_s <= pose.t_s:
            found.append(dist(pose.payload.position_ned_m, _between(truth[at], truth[at + 1], pose.t_s)))
    return found


def _between(before: Envelope[SimTruth], after: Envelope[SimTruth], t_s: float) -> Vector3:
    share = (t_s - before.t_s) / (after.t_s - before.t_s)
    return interpolate(before.payload.position_ned_m, after.payload.position_ned_m, share)


@pytest.mark.parametrize(("style", "platform"), [("px4", "pelican"), ("ardupilot", "hummingbird")], indirect=["style"])
def test_it_flies_a_mission_by_all_its_sources(flight: Card, platform: str) -> None:
    ProbedFusion.made.clear()
    flight.begin(SWEEP, platform=probed(platform))
    way = TrueWay()
    watched = flight.run(watching(flight, way))
    flight.await_state("sweep", "done", 60.0)
    states: list[Envelope[FusionState]] = flight.received["fusion/primary"]
    used = {state.source for state in states[-1].payload.sources if state.is_used}
    assert used == SOURCES[platform] | {"imu", "height"}
    flight.await_state("mission", "done", 30.0)
    found = errors_m(flight)
    assert len(found) > 500
    assert max(found) < 0.15
    assert (sum(error * error for error in found) / len(found)) ** 0.5 < 0.05
    watched.cancel()
    way.close()
    judged = judge(ProbedFusion.made[0], way)
    expect_honesty(judged, SOURCES[platform] | {"height"})


async def watching(flight: Card, way: TrueWay) -> Future[None]:
    """Begins to keep the truth."""
    return ensure_future(watch(flight.flight, way))


def expect_honesty(judged: Judged, sources: set[str]) -> None:
    """Errors and innovations are as large as the covariance says: ten times more or less would be seen."""
    assert 0.1 < mean(judged.nees_place) / 3.0 < 4.0
    assert set(judged.innovation) == sources
    for source, innovation in judged.innovation.items():
        assert 0.1 < innovation < 1.6, source
    assert judged.lied_s == 0.0
