"""What the server knows of the vehicle, and how long: an autopilot's state that is old decides nothing."""

import pytest
from msgspec.structs import replace
from tests.onboard.messages import at, flying, pose, standing

from gloc3.messages.standard_topics import AUTOPILOT_SILENT_S, POSE_LATE_S, POSE_LOST_S
from gloc3.messages.vehicle import AutopilotState, DriverState, FlightMode, LandedState, Pose
from gloc3.mission.executing.board import PolicyCondition
from gloc3.platform.reader import load_platform
from gloc3_onboard.command_server.summaries import vehicle_summary
from gloc3_onboard.command_server.vehicle_state import POSE_LATE_MOST_S, POSE_SILENT_S, VehicleState

PLATFORM = load_platform("pelican_rtk")
STALE_S = AUTOPILOT_SILENT_S + 0.1


def facts_of(state: AutopilotState, *, age_s: float = 0.0) -> VehicleState:
    """The facts so long after a state was heard."""
    snapshot = VehicleState(PLATFORM, None)
    snapshot.update_autopilot(at(0.0, state))
    snapshot.expire(age_s)
    return snapshot


def conditions(snapshot: VehicleState, now_s: float) -> dict[PolicyCondition, bool]:
    return {condition: is_on for condition, is_on, _ in snapshot.conditions(None, now_s)}


def test_a_state_is_known_for_ten_periods_of_its_topic() -> None:
    assert AUTOPILOT_SILENT_S == 2.0
    assert facts_of(standing(), age_s=1.99).is_connected
    late = facts_of(standing(), age_s=2.0)
    assert not late.is_connected
    assert late.known_autopilot is None
    assert late.autopilot_problem == "no state is received from the autopilot"
    late.update_autopilot(at(2.1, standing()))
    late.expire(2.1)
    assert late.is_connected
    assert late.autopilot_problem == ""


def test_a_vehicle_that_was_armed_may_be_in_the_air_and_it_is_not_known_whether_it_is() -> None:
    armed = AutopilotState(is_connected=True, is_armed=True, landed=LandedState.ON_GROUND)
    assert not facts_of(armed).is_airborne
    assert facts_of(armed).is_flight_known
    assert facts_of(armed, age_s=STALE_S).is_airborne
    assert not facts_of(armed, age_s=STALE_S).is_flight_known
    assert facts_of(flying(FlightMode.GUIDED), age_s=STALE_S).is_airborne
    assert not facts_of(standing(), age_s=STALE_S).is_airborne


def test_a_lost_pose_is_still_noticed_in_flight_and_an_old_battery_decides_nothing() -> None:
    low = AutopilotState(is_connected=True, is_armed=True, landed=LandedState.IN_AIR, battery_remaining=0.1)
    assert conditions(facts_of(low), 0.0)[PolicyCondition.LOW_BATTERY]
    snapshot = facts_of(low, age_s=STALE_S)
    later_s = STALE_S + POSE_LOST_S + 0.05
    snapshot.expire(later_s)
    late = conditions(snapshot, later_s)
    assert late[PolicyCondition.POSE_LOST]
    assert PolicyCondition.LOW_BATTERY not in late  # neither on nor over


def test_home_does_not_follow_a_vehicle_of_which_it_is_not_known_whether_it_is_armed() -> None:
    snapshot = facts_of(standing())
    snapshot.update_pose(at(0.1, pose(1.0, 0.0, 0.0)))
    snapshot.expire(STALE_S)
    snapshot.update_pose(at(STALE_S, pose(9.0, 0.0, 0.0)))
    assert snapshot.home_ned_m is not None
    assert snapshot.home_ned_m[0] == 1.0
    assert isinstance(snapshot.pose, Pose)
    assert snapshot.pose.position_ned_m[0] == 9.0


def test_stations_are_told_that_it_is_not_known() -> None:
    now, late = (vehicle_summary(PLATFORM, facts_of(standing(), age_s=age_s), age_s) for age_s in (0.0, STALE_S))
    assert (now.is_autopilot_connected, now.landed, now.is_armable) == (True, "on_ground", True)
    assert (late.is_autopilot_connected, late.landed, late.is_armable) == (False, "unknown", False)


def pose_lost(gaps: list[tuple[float, float]], until_s: float) -> list[tuple[float, bool]]:
    """When it was said that the pose is lost, or is back, of a vehicle in flight whose pose comes but in the gaps."""
    snapshot, reported = facts_of(flying(FlightMode.GUIDED)), [(0.0, False)]
    for count in range(round(until_s / 0.05)):
        now_s = round(0.05 * count, 2)
        snapshot.update_autopilot(at(now_s, flying(FlightMode.GUIDED)))
        if not any(begin_s <= now_s < end_s for begin_s, end_s in gaps):
            snapshot.update_pose(at(now_s, pose()))
        snapshot.expire(now_s)
        is_lost = conditions(snapshot, now_s).get(PolicyCondition.POSE_LOST, reported[-1][1])
        if is_lost != reported[-1][1]:
            reported.append((now_s, is_lost))
    return reported[1:]


def test_a_pose_is_lost_after_two_seconds_and_is_back_at_once() -> None:
    assert POSE_LATE_S < POSE_SILENT_S < POSE_LOST_S == 2.0
    assert pose_lost([(1.0, 2.95)], 4.0) == []
    assert pose_lost([(1.0, 2.5), (2.55, 3.9), (3.95, 5.4)], 7.0) == []
    ((lost_s, is_lost), back) = pose_lost([(1.0, 3.5)], 5.0)
    assert is_lost
    assert 2.95 <= lost_s <= 3.25
    assert back == (3.5, False)


@pytest.mark.parametrize(
    ("age_s", "is_valid", "reason", "within_s"),
    [
        (0.0, True, "no pose for 2 s", 2.3),
        (0.5, True, "poses are 0.5 s late", POSE_LATE_MOST_S + 0.5),
        (0.0, False, "no source", 0.5),
    ],
)
def test_absent_late_and_invalid_poses_are_told_apart(
    age_s: float, is_valid: bool, reason: str, within_s: float
) -> None:
    snapshot, lost = facts_of(flying(FlightMode.GUIDED)), ""
    snapshot.update_pose(at(0.0, pose()))
    snapshot.expire(0.0)
    for count in range(1, round(within_s / 0.05) + 1):
        now_s = round(0.05 * count, 2)
        snapshot.update_autopilot(at(now_s, flying(FlightMode.GUIDED)))
        if age_s or not is_valid:
            snapshot.update_pose(
                at(now_s - age_s, replace(pose(), is_valid=is_valid, reason="" if is_valid else reason))
            )
        snapshot.expire(now_s)
        lost = next((why for what, is_on, why in snapshot.conditions(None, now_s) if is_on), "")
    assert lost == reason


@pytest.mark.parametrize(("is_streaming", "does"), [(True, "holding, "), (False, "")])
def test_a_late_pose_is_told_once_and_again_when_it_is_back(is_streaming: bool, does: str) -> None:
    snapshot, told = facts_of(flying(FlightMode.GUIDED)), []
    snapshot.driver = DriverState(is_streaming=is_streaming)
    for count in range(80):
        now_s = round(0.05 * count, 2)
        snapshot.update_autopilot(at(now_s, flying(FlightMode.GUIDED)))
        if not (1.0 <= now_s < 1.65 or 2.0 <= now_s < 2.3):
            snapshot.update_pose(at(now_s, pose()))
        snapshot.expire(now_s)
        told += [(now_s, news)] if (news := snapshot.late_pose_report(now_s)) else []
    assert told == [
        (1.35, f"pose is late by 0.4 s: {does}waiting up to 2 s"),
        (1.65, "pose is back after 0.7 s: going on"),
    ]


def test_a_stall_of_the_process_itself_is_no_lateness_of_the_poses() -> None:
    snapshot = facts_of(flying(FlightMode.GUIDED))
    snapshot.update_pose(at(0.0, pose(1.0, 0.0, 0.0)))
    snapshot.expire(0.1)
    for now_s in (0.3, 0.6):
        snapshot.update_pose(at(now_s - 0.5, pose(1.0, 0.0, 0.0)))
        snapshot.expire(now_s)
    stall_s = 1.6
    snapshot.stalled(stall_s)
    now_s = 0.6 + stall_s
    snapshot.update_pose(at(now_s - 0.6, pose(1.0, 0.0, 0.0)))
    snapshot.expire(now_s)
    assert not conditions(snapshot, now_s).get(PolicyCondition.POSE_LOST, False)
    assert conditions(snapshot, now_s + POSE_LOST_S)[PolicyCondition.POSE_LOST], "no more come"


def test_poses_that_keep_coming_late_are_waited_for_longer_than_one_that_does_not_come() -> None:
    snapshot = facts_of(flying(FlightMode.GUIDED))
    snapshot.update_pose(at(0.0, pose(1.0, 0.0, 0.0)))
    snapshot.expire(0.1)
    late_s, step_s, now_s = 0.9, 0.1, 0.1
    while now_s < POSE_LATE_MOST_S - 0.1:
        now_s += step_s
        snapshot.update_pose(at(max(0.0, now_s - late_s), pose(1.0, 0.0, 0.0)))
        snapshot.expire(now_s)
        assert not conditions(snapshot, now_s).get(PolicyCondition.POSE_LOST, False)
    now_s += 0.5
    snapshot.update_pose(at(now_s - late_s, pose(1.0, 0.0, 0.0)))
    assert conditions(snapshot, now_s)[PolicyCondition.POSE_LOST]
