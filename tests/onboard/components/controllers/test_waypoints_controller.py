"""The waypoint controller: legs, headings, a lost pose, a pause, an autopilot that does not follow, and the way home."""

import itertools
import math
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace
from tests.onboard.messages import pose
from tests.onboard.stage import Stage

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3, from_yaw
from gloc3.messages.vehicle import DriverState, Home, Setpoint
from gloc3.mission.model.arguments import FollowWaypointsOrder, HeadingOrder
from gloc3.mission.model.messages import ActionStatus
from gloc3_onboard.components.controllers.waypoints import WaypointsController, WaypointsSettings

STEP_S = 0.05
LEGS = ((3.0, 0.0, -2.0), (3.0, 3.0, -2.0))


class Rig:
    """A controller and a vehicle that follows its setpoints, unless told otherwise."""

    def __init__(self, **settings: Any) -> None:
        self.controller = WaypointsController()
        self.stage = Stage(self.controller, WaypointsSettings(**settings))
        self.at: Vector3 = (0.0, 0.0, -2.0)
        self.yaw_rad = 0.0
        self.velocity: Vector3 = (0.0, 0.0, 0.0)
        self.off: Vector3 = (0.0, 0.0, 0.0)
        """How far its estimate is from where the setpoint is."""
        self.is_guided = self.has_pose = self.is_following = True
        self.refusal = ""
        self.stage.step(STEP_S, pose=self._pose(), driver=DriverState(is_guided=True))

    def _pose(self) -> Any:
        north, east, down = (here + off for here, off in zip(self.at, self.off, strict=True))
        return pose(north, east, -down, ned_from_frd=from_yaw(self.yaw_rad), velocity_ned_m_s=self.velocity)

    def begin(self, waypoints: tuple[Vector3, ...] = LEGS, progress: float = 0.0, **order: Any) -> None:
        given = FollowWaypointsOrder(waypoints_ned_m=waypoints, **{"speed_m_s": 1.0, **order})
        self.stage.begin("follow_waypoints", progress=progress, **msgspec.to_builtins(given))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            messages: dict[str, Any] = {"driver": DriverState(is_guided=self.is_guided, refusal=self.refusal)}
            if self.has_pose:
                messages["pose"] = self._pose()
            for message in self.stage.step(STEP_S, **messages):
                if isinstance(message, Setpoint) and self.is_following and self.is_guided:
                    assert message.position_ned_m is not None
                    self.at = message.position_ned_m

    def until_ended(self, within_s: float = 60.0) -> ActionStatus:
        while self.stage.status.state in ("running", "paused"):
            assert self.stage.now_s < within_s
            self.run(STEP_S)
        return self.stage.status

    @property
    def last(self) -> Setpoint:
        found = self.stage.last(Setpoint)
        assert isinstance(found, Setpoint)
        return found


def test_the_waypoints_are_passed_in_order_and_the_action_is_done_at_the_last() -> None:
    rig = Rig()
    rig.begin()
    rig.run(STEP_S)
    status = rig.until_ended()
    assert (status.state, status.progress, status.reason) == ("done", 1.0, "")
    assert math.dist(rig.at, LEGS[-1]) < 0.01
    progress = [report.progress for report in rig.stage.all(ActionStatus)]
    assert progress == sorted(progress)
    assert rig.stage.now_s == pytest.approx(6.0 + 2.0, abs=0.7)


def test_the_last_waypoint_is_attained_when_the_vehicle_has_come_to_rest_there() -> None:
    rig = Rig()
    rig.begin(((1.0, 0.0, -2.0),))
    rig.run(4.0)
    assert rig.stage.status.state == "done"
    rig = Rig()
    rig.velocity = (0.6, 0.0, 0.0)
    rig.begin(((1.0, 0.0, -2.0),))
    rig.run(4.0)
    assert rig.stage.status.state == "running"
    rig.velocity = (0.1, 0.0, 0.0)
    rig.run(0.5)
    assert rig.stage.status.state == "done"


@pytest.mark.parametrize(("least_m", "state"), [(0.0, "failed"), (1.0, "done")])
def test_a_vehicle_with_a_coarse_position_passes_waypoints_within_the_least_acceptance(
    least_m: float, state: str
) -> None:
    rig = Rig(least_acceptance_m=least_m, settle_s=5.0)
    rig.off, rig.velocity = (0.4, -0.4, 0.0), (0.5, 0.0, 0.0)
    rig.begin()
    rig.run(STEP_S)
    status = rig.until_ended()
    assert status.state == state
    if state == "done":
        assert rig.stage.now_s < 13.0, "a restless estimate costs no more than a moment at the end"


def test_who_has_come_to_the_last_waypoint_once_is_done_though_the_estimate_wanders_off_again() -> None:
    rig = Rig()
    rig.begin(((1.0, 0.0, -2.0),))
    rig.velocity = (0.5, 0.0, 0.0)
    rig.run(3.0)
    rig.off = (0.4, 0.0, 0.0)
    rig.run(3.5)
    assert rig.stage.status.state == "done"


def test_every_setpoint_names_its_action() -> None:
    rig = Rig()
    rig.begin()
    rig.run(9.0)
    assert {setpoint.action_id for setpoint in rig.stage.all(Setpoint)} == {"go"}
    count = len(rig.stage.all(Setpoint))
    rig.run(1.0)
    assert len(rig.stage.all(Setpoint)) == count


def test_without_a_pose_it_does_not_begin_and_an_old_one_is_none() -> None:
    stage = Stage(WaypointsController())
    stage.step()
    with pytest.raises(Refused, match="there is no valid pose"):
        stage.begin("follow_waypoints", waypoints_ned_m=LEGS, speed_m_s=1.0)
    stage.step(pose=pose())
    stage.step(2.1)
    with pytest.raises(Refused, match="there is no valid pose"):
        stage.begin("go_to", waypoints_ned_m=LEGS, speed_m_s=1.0)
    stage.step(pose=replace(pose(), is_valid=False))
    with pytest.raises(Refused, match="there is no valid pose"):
        stage.begin("go_to", waypoints_ned_m=LEGS, speed_m_s=1.0)


def test_a_way_begins_by_a_late_pose_and_is_flown_by_the_next() -> None:
    stage = Stage(WaypointsController())
    stage.step(pose=pose())
    stage.step(1.0)
    stage.begin("follow_waypoints", waypoints_ned_m=LEGS, speed_m_s=1.0)
    stage.step(0.5)
    assert stage.all(Setpoint) == []
    stage.step(pose=pose())
    assert len(stage.all(Setpoint)) == 1


def test_a_way_without_waypoints_is_refused() -> None:
    rig = Rig()
    with pytest.raises(Refused, match="there is no waypoint"):
        rig.begin(())


def test_while_the_pose_is_lost_nothing_is_streamed_and_afterwards_it_goes_back_to_the_way() -> None:
    rig = Rig()
    rig.begin()
    rig.run(2.0)
    rig.has_pose = False
    rig.run(0.3)
    left = rig.last.position_ned_m
    assert left is not None
    count = len(rig.stage.all(Setpoint))
    rig.run(3.0)
    assert len(rig.stage.all(Setpoint)) == count
    rig.at = (left[0] + 0.5, 1.0, -2.0)
    rig.has_pose = True
    rig.run(STEP_S)
    assert math.dist(rig.last.position_ned_m or (), (left[0] + 0.5, 1.0, -2.0)) < 0.05
    before = rig.at
    places = []
    while rig.stage.status.state == "running" and rig.stage.now_s < 60.0:
        rig.run(STEP_S)
        assert math.dist(before, rig.at) <= 1.0 * STEP_S + 1e-6
        before = rig.at
        places.append(rig.at)
    assert min(math.dist(place, left) for place in places) < 0.05
    assert rig.stage.status.state == "done"


def test_a_pause_streams_nothing_and_a_resume_goes_on_from_where_it_left_the_way() -> None:
    rig = Rig()
    rig.begin()
    rig.run(2.0)
    left, progress = rig.last.position_ned_m, rig.stage.status.progress
    rig.stage.call("action.pause", action_id="go")
    rig.run(5.0)
    assert rig.last.position_ned_m == left
    assert rig.stage.status.state == "paused"
    rig.at = (rig.at[0] + 2.0, 2.0, -3.0)
    rig.stage.call("action.resume", action_id="go")
    rig.run(0.2)
    assert rig.stage.status.progress >= progress - 0.51
    assert math.dist(rig.last.position_ned_m or (), rig.at) < 0.1
    assert rig.until_ended().state == "done"


def paused_at_the_end(*, hold_s: float = 0.0, restless_m_s: float = 0.5) -> Rig:
    rig = Rig()
    rig.velocity = (restless_m_s, 0.0, 0.0)
    rig.begin(((1.0, 0.0, -2.0),), hold_s=hold_s)
    rig.run(3.0)
    assert (rig.stage.status.state, rig.stage.status.progress) == ("running", 1.0)
    rig.stage.call("action.pause", action_id="go")
    rig.run(30.0)
    return rig


def test_a_pause_at_the_last_waypoint_does_not_count_as_waiting_for_the_vehicle() -> None:
    rig = paused_at_the_end()
    rig.stage.call("action.resume", action_id="go")
    rig.run(1.0)
    assert rig.stage.status.state == "running"
    rig.run(2.5)
    assert (rig.stage.status.state, rig.stage.status.reason) == ("done", "")


@pytest.mark.parametrize("hold_s", [0.0, 20.0])
def test_a_vehicle_that_was_taken_away_from_the_last_waypoint_in_a_pause_flies_back_at_the_ways_speed(
    hold_s: float,
) -> None:
    rig = paused_at_the_end(hold_s=hold_s)
    rig.velocity = (0.0, 0.0, 0.0)
    rig.at = (1.0, 8.0, -2.0)
    rig.stage.call("action.resume", action_id="go")
    resumed_s = rig.stage.now_s
    while rig.stage.status.state in ("paused", "running") and rig.stage.now_s < resumed_s + 60.0:
        before = rig.at
        rig.run(STEP_S)
        assert math.dist(before, rig.at) <= 1.0 * STEP_S + 1e-6
    assert rig.stage.status.state == "done"
    assert rig.stage.now_s - resumed_s == pytest.approx(8.0 + hold_s, abs=1.5)
    assert math.dist(rig.at, (1.0, 0.0, -2.0)) < 0.01


def test_a_cancelled_action_is_silent_at_once() -> None:
    rig = Rig()
    rig.begin()
    rig.run(1.0)
    rig.stage.call("action.cancel", action_id="go")
    count = len(rig.stage.all(Setpoint))
    rig.run(1.0)
    assert len(rig.stage.all(Setpoint)) == count
    assert rig.stage.status.state == "aborted"


def test_until_the_autopilot_follows_the_target_stays_where_the_vehicle_is() -> None:
    rig = Rig()
    rig.is_guided = False
    rig.begin()
    rig.run(3.0)
    assert {setpoint.position_ned_m for setpoint in rig.stage.all(Setpoint)} == {(0.0, 0.0, -2.0)}
    assert rig.last.velocity_ned_m_s == (0.0, 0.0, 0.0)
    rig.is_guided = True
    assert rig.until_ended().state == "done"


def test_an_autopilot_that_never_follows_fails_the_action_with_its_reason() -> None:
    rig = Rig(follow_s=4.0)
    rig.is_guided, rig.refusal = False, "no setpoints are streamed"
    rig.begin()
    rig.run(STEP_S)
    status = rig.until_ended(10.0)
    assert status.state == "failed"
    assert "the autopilot does not follow our setpoints: no setpoints are streamed" in status.reason


def test_a_driver_that_is_silent_does_not_count_as_following() -> None:
    rig = Rig()
    rig.begin()
    rig.run(1.0)
    for _ in range(40):
        rig.stage.step(STEP_S, pose=rig._pose())
    before = rig.last.position_ned_m
    rig.stage.step(STEP_S, pose=rig._pose())
    assert rig.last.position_ned_m == before


def test_a_vehicle_that_does_not_come_fails_the_action_and_says_where() -> None:
    rig = Rig(settle_s=3.0)
    rig.is_following = False
    rig.begin()
    rig.run(STEP_S)
    status = rig.until_ended(30.0)
    assert status.state == "failed"
    assert "the vehicle does not come to waypoint 1" in status.reason


@pytest.mark.parametrize(("progress", "first"), [(0.0, 0), (0.49, 0), (0.5, 1), (0.9, 1), (1.0, 1)])
def test_after_a_restart_waypoints_that_were_passed_are_left_out(progress: float, first: int) -> None:
    rig = Rig()
    rig.at = (3.0, 1.0, -2.0)
    rig.run(STEP_S)
    rig.begin(progress=progress)
    rig.run(0.5)
    assert rig.controller.waypoint == first
    assert rig.stage.status.progress >= first / 2
    assert rig.until_ended().state == "done"


@pytest.mark.parametrize(
    ("heading", "wanted_rad"),
    [
        (HeadingOrder(mode="along"), math.pi / 2),
        (HeadingOrder(mode="hold"), 0.3),
        (HeadingOrder(mode="fixed", heading_rad=-2.0), -2.0),
        (HeadingOrder(mode="look_at", look_at_ned_m=(3.0, 99.0, -2.0)), math.pi / 2),
    ],
)
def test_headings_turn_no_faster_than_they_may(heading: HeadingOrder, wanted_rad: float) -> None:
    rig = Rig(yaw_rate_rad_s=0.5)
    rig.yaw_rad = 0.3
    rig.run(STEP_S)
    rig.begin(((3.0, 0.0, -2.0), (3.0, 12.0, -2.0)), heading=heading)
    yaws = [0.3]
    for _ in range(240):
        rig.run(STEP_S)
        yaws.append(rig.last.yaw_rad or 0.0)
    assert yaws[-1] == pytest.approx(wanted_rad, abs=0.02)
    assert max(abs(b - a) for a, b in itertools.pairwise(yaws)) <= 0.5 * STEP_S + 1e-9


def test_on_a_vertical_leg_the_heading_stays() -> None:
    rig = Rig()
    rig.yaw_rad = 1.0
    rig.run(STEP_S)
    rig.begin(((0.0, 0.0, -5.0),))
    rig.run(2.0)
    assert rig.last.yaw_rad == pytest.approx(1.0)


def test_home_is_flown_to_at_the_height_asked_for() -> None:
    rig = Rig()
    with pytest.raises(Refused, match="home is not known"):
        rig.stage.begin("return_home")
    rig.stage.put(home=Home(position_ned_m=(-4.0, 1.0, 0.5)))
    rig.run(STEP_S)
    rig.stage.begin("return_home", height_m=4.5)
    rig.run(STEP_S)
    assert rig.until_ended().state == "done"
    assert math.dist(rig.at, (-4.0, 1.0, -4.0)) < 0.01
    climbed = next(s for s in rig.stage.all(Setpoint) if abs(s.position_ned_m[2] + 4.0) < 0.01)
    assert climbed.position_ned_m[:2] == pytest.approx((0.0, 0.0), abs=0.02)


def test_a_stop_forgets_the_way() -> None:
    rig = Rig()
    rig.begin()
    rig.run(1.0)
    rig.controller.stop()
    rig.controller.start()
    count = len(rig.stage.all(Setpoint))
    rig.run(1.0)
    assert len(rig.stage.all(Setpoint)) == count


def test_after_a_restart_no_waypoint_is_flown_back_to_that_the_vehicle_has_drifted_past() -> None:
    way = ((1.0, 0.0, -2.0), (2.0, 0.0, -2.0), (3.0, 0.0, -2.0), (4.0, 0.0, -2.0))
    for hold_s, back_m in ((0.0, 0.0), (1.0, 0.4)):  # a rest that was not had is made up for
        rig = Rig()
        rig.at = (2.4, 0.0, -2.0)
        rig.run(STEP_S)
        rig.begin(way, progress=0.25, hold_s=hold_s)
        rig.run(10.0)
        norths = [setpoint.position_ned_m[0] for setpoint in rig.stage.all(Setpoint)]
        assert min(norths) == pytest.approx(2.4 - back_m, abs=0.01)
        assert rig.stage.status.state == "done"


def test_each_waypoint_that_is_passed_is_reported_at_once() -> None:
    rig = Rig()
    rig.begin(tuple((0.5 * n, 0.0, -2.0) for n in range(1, 9)), speed_m_s=2.0)
    rig.run(8.0)
    achieved = [report.achieved for report in rig.stage.all(ActionStatus)]
    assert sorted(set(achieved)) == [*range(9)]
