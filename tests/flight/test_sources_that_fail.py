"""The vehicles of the paper lose what they fly by, in mid flight; every row of that is on the page of evidence `ablation`."""

from itertools import pairwise
from math import dist

import pytest
from tests.evidence.ablation import Row, fly, problems, rows_of
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission
from tests.flight.test_flying_on_our_own_pose import errors_m

from gloc3.component.lci import State
from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import Pose
from gloc3_onboard.components.controllers.limiter import LimiterSettings

pytestmark = pytest.mark.thorough

ROWS = {
    "pelican": (
        "imu late, stamped as new, tracker late 200 ms",
        "imu scale 5 %, stereo garbage, tracker removed",
    ),
    "hummingbird": (
        "imu late, stamped as new",
        "ground removed, height scale 5 %, stereo late, stamped as new",
        "imu removed, stereo garbage, tracker step 0.2 m",
    ),
}
"""Rows of the page in which the mission or the pose went wrong once, each of its own cause."""
SWEEP = mission(
    "{out: {follow_waypoints: {waypoints_m: [[4, 0, 1.5], [4.7, 0.7, 1.8]], speed_m_s: 0.7}}}", on_pose_lost="land"
)
LARGEST_M = 0.15
HARD_M_S = 1.0
ASIDE_M = 1.0


def sweep(flight: Card, platform: str) -> None:
    """On the way, two seconds into the sweep."""
    flight.begin(SWEEP, platform=platform)
    flight.await_state("sweep", "running")
    flight.wait(2.0)


@ONE_STYLE
@pytest.mark.parametrize(
    ("source", "fault"), [("imu", "device:imu=scaled/0.05"), ("stereo", "device:stereo_camera=garbage")]
)
def test_a_source_that_lies_leaves_the_pose_right_and_the_mission_done(flight: Card, source: str, fault: str) -> None:
    sweep(flight, "pelican")
    begin_s = flight.now_s
    flight.fault(fault)
    flight.await_state("sweep", "done", 40.0)
    assert max(errors_m(flight)) < LARGEST_M
    flight.await_state("mission", "done", 20.0)
    poses: list[Pose] = flight.since(begin_s, "pose")
    assert source in poses[0].sources
    if source == "stereo":  # a scale of the inertial unit is found as its bias
        assert any(source not in pose.sources for pose in poses[:45]), "found within 1.5 s"


@pytest.mark.parametrize("platform", sorted(ROWS))
def test_what_went_wrong_on_the_page_goes_well(platform: str) -> None:
    rows = {key: faults for key, faults in rows_of(platform).items() if key.partition(": ")[2] in ROWS[platform]}
    assert len(rows) == len(ROWS[platform])
    flown = dict[str, Row]()
    fly(platform, rows, flown.__setitem__)
    assert {key: wrong for key, row in flown.items() if (wrong := problems(row, rows[key]))} == {}


@ONE_STYLE
def test_a_quiet_estimator_takes_over_within_100_ms_without_a_step(flight: Card) -> None:
    sweep(flight, "hummingbird")
    begin_s = flight.now_s
    flight.fault("crash:pose")
    flight.await_component("pose_standby", "working", 1.0)
    faulty_s = first_s(flight, "pose", State.FAULTY, begin_s)
    assert first_s(flight, "pose_standby", State.WORKING, begin_s) - faulty_s <= 0.1
    flight.await_state("mission", "done", 40.0)
    poses: list[Envelope[Pose]] = [pose for pose in flight.received["pose"] if begin_s - 1.0 < pose.t_s < begin_s + 2.0]
    assert len({pose.source.component for pose in poses}) == 2
    for before, after in pairwise(poses):
        assert after.t_s - before.t_s <= 0.1
        assert after.payload.is_valid
        assert after.payload.reset_counter == before.payload.reset_counter
        assert dist(after.payload.position_ned_m, before.payload.position_ned_m) < 0.1
    assert max(errors_m(flight)) < LARGEST_M


def first_s(flight: Card, component: str, state: State, since_s: float) -> float:
    """When a component first told a state."""
    reported = flight.received[f"components/{component}/status"]
    return next(status.t_s for status in reported if status.t_s >= since_s and status.payload.state is state)


@ONE_STYLE
def test_with_too_little_left_it_slows_down_holds_and_lands_and_says_why(flight: Card) -> None:
    sweep(flight, "hummingbird")
    flight.fault("device:stereo_camera=lost")
    flight.fault("device:ground_camera=lost")
    flight.until(lambda: flight.last("pose").quality < 0.55, 1.0, "the pose rests on the tracker alone")
    flight.wait(1.5)
    assert flight.last("pose").is_valid
    assert 0.05 < flight.speed_m_s < LimiterSettings().careful_m_s, flight.story("it goes on slowly")
    flight.fault("device:tracker_camera=lost")
    flight.until(lambda: flight.last("pose").quality <= LimiterSettings().hold_quality, 1.0, "it rests on nothing")
    place, fastest = flight.position_m, 0.0
    flight.await_policy("land", 4.0)
    assert flight.was_told("pose lost")
    assert "nothing has held the position" in flight.last("pose").reason
    while flight.autopilot.is_armed:
        flight.wait(0.05)
        if flight.height_m < 0.3:
            fastest = max(fastest, flight.flight.simulator.truth().velocity_ned_m_s[2])
    flight.await_landed(1.0)
    assert fastest < HARD_M_S
    assert dist(flight.position_m[:2], place[:2]) < ASIDE_M
    assert "pose lost" in flight.mission.reason
