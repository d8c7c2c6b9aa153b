"""The line-of-sight controller: a boat in a current keeps its way, its corners and its stops, or says why it cannot."""

import math
from typing import Any

import msgspec
import pytest
from tests.onboard.messages import pose
from tests.onboard.stage import Stage

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3, from_yaw, wrap_pi
from gloc3.messages.vehicle import DriverState, Home, Setpoint
from gloc3.mission.model.arguments import FollowWaypointsOrder, HeadingOrder
from gloc3.mission.model.messages import ActionStatus
from gloc3_onboard.components.controllers.line_of_sight import LineOfSightController, LineOfSightSettings

STEP_S = 0.05
LEGS = ((30.0, 0.0, 0.0), (30.0, 25.0, 0.0))


class Boat:
    """Turns to the velocity's direction with 0.3 rad/s, takes its speed up to 2 m/s through the water, and drifts."""

    def __init__(self, current: tuple[float, float] = (0.0, 0.0), **settings: Any) -> None:
        self.controller = LineOfSightController()
        self.stage = Stage(self.controller, LineOfSightSettings(**settings))
        self.at, self.yaw_rad, self.speed_m_s, self.current = (0.0, 0.0), 0.0, 0.0, current
        self.is_guided = True
        self.track: list[tuple[float, float]] = []
        self.stage.step(
            STEP_S, pose=self._pose(), driver=DriverState(is_guided=True), home=Home(position_ned_m=(0.0,) * 3)
        )

    def _pose(self) -> Any:
        vn, ve = self.speed_m_s * math.cos(self.yaw_rad), self.speed_m_s * math.sin(self.yaw_rad)
        velocity = (vn + self.current[0], ve + self.current[1], 0.0)
        return pose(*self.at, 0.0, ned_from_frd=from_yaw(self.yaw_rad), velocity_ned_m_s=velocity)

    def begin(self, waypoints: tuple[Vector3, ...] = LEGS, progress: float = 0.0, **order: Any) -> None:
        given = FollowWaypointsOrder(waypoints_ned_m=waypoints, **{"speed_m_s": 1.5, "acceptance_m": 2.0, **order})
        self.stage.begin("follow_waypoints", progress=progress, **msgspec.to_builtins(given))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            driver = DriverState(is_guided=self.is_guided, refusal="" if self.is_guided else "no position")
            for message in self.stage.step(STEP_S, pose=self._pose(), driver=driver):
                if isinstance(message, Setpoint) and self.is_guided:
                    assert message.position_ned_m is None
                    assert message.velocity_ned_m_s is not None
                    self._move(message.velocity_ned_m_s)

    def _move(self, velocity: Vector3) -> None:
        self.speed_m_s = math.hypot(velocity[0], velocity[1])
        if self.speed_m_s > 0.0:
            off = wrap_pi(math.atan2(velocity[1], velocity[0]) - self.yaw_rad)
            self.yaw_rad = wrap_pi(self.yaw_rad + max(-0.3 * STEP_S, min(0.3 * STEP_S, off)))
            # The autopilot regulates the speed over ground along the heading.
            self.speed_m_s -= self.current[0] * math.cos(self.yaw_rad) + self.current[1] * math.sin(self.yaw_rad)
            self.speed_m_s = min(self.speed_m_s, 2.0)
        north = self.speed_m_s * math.cos(self.yaw_rad) + self.current[0]
        east = self.speed_m_s * math.sin(self.yaw_rad) + self.current[1]
        self.at = (self.at[0] + north * STEP_S, self.at[1] + east * STEP_S)
        self.track.append(self.at)

    def until_ended(self, within_s: float = 120.0) -> ActionStatus:
        self.run(STEP_S)
        while self.stage.status.state in ("running", "paused"):
            assert self.stage.now_s < within_s
            self.run(STEP_S)
        return self.stage.status

    def nearest_m(self, place: Vector3) -> float:
        return min(math.dist(at, place[:2]) for at in self.track)


@pytest.mark.parametrize("current", [(0.0, 0.0), (0.0, 0.5), (-0.4, -0.3)])
def test_it_passes_its_waypoints_in_any_current_and_ends_at_the_last(current: tuple[float, float]) -> None:
    boat = Boat(current)
    boat.begin()
    assert boat.until_ended().state == "done"
    assert max(map(boat.nearest_m, LEGS)) < 2.0
    late = [abs(e) for n, e in boat.track if 20.0 < n < 27.0 and e < 5.0]
    assert max(late) < 1.0, "the way is kept, not only its ends"
    assert boat.stage.status.achieved == 2


def test_it_stays_at_a_waypoint_as_long_as_it_is_told() -> None:
    boat = Boat()
    boat.begin(hold_s=4.0)
    boat.until_ended()
    standing = sum(math.dist(one, other) < 1e-6 for one, other in zip(boat.track, boat.track[1:], strict=False))
    assert standing * STEP_S == pytest.approx(8.0, abs=0.5)


def test_a_pause_keeps_the_way_and_a_restart_takes_it_up_where_it_was() -> None:
    boat = Boat()
    boat.begin()
    boat.run(10.0)
    boat.stage.call("action.pause", action_id="go")
    boat.run(3.0)
    boat.stage.call("action.resume", action_id="go")
    assert boat.until_ended().state == "done"
    again = Boat()
    again.at = (31.0, 10.0)
    again.begin(progress=0.6)
    again.run(1.0)
    assert again.controller.waypoint == 1
    assert again.until_ended().state == "done"


@pytest.mark.parametrize("waypoints", [LEGS, LEGS[:1]])
@pytest.mark.parametrize("cause", ["pause", "autopilot", "pose"])
def test_an_interrupted_stop_goes_on_where_it_was_and_the_interruption_does_not_count(
    waypoints: tuple[Vector3, ...], cause: str
) -> None:
    boat = Boat()
    boat.begin(waypoints, hold_s=20.0)
    stop_at(boat, 5.0)
    interrupt(boat, cause, 25.0)
    here = boat.at
    boat.run(13.0)
    assert (boat.at, boat.stage.status.state) == (here, "running")
    boat.run(3.0)
    assert boat.at != here if len(waypoints) > 1 else boat.stage.status.state == "done"


def test_a_boat_that_was_taken_away_from_its_stop_goes_back_to_it_and_stops_there() -> None:
    boat = Boat()
    boat.begin(LEGS[:1], hold_s=20.0)
    stop_at(boat, 5.0)
    boat.stage.call("action.pause", action_id="go")
    boat.run(30.0)
    boat.at = (30.0, 150.0)
    boat.track.clear()
    boat.stage.call("action.resume", action_id="go")
    resumed_s = boat.stage.now_s
    assert boat.until_ended(300.0).state == "done"
    assert math.dist(boat.at, LEGS[0][:2]) < 2.0
    assert boat.stage.now_s - resumed_s > 150.0 / 1.5 + 20.0


def test_a_boat_that_was_taken_far_away_from_its_way_is_given_the_time_to_come_back() -> None:
    boat = Boat()
    boat.begin(LEGS[:1])
    boat.run(12.0)
    boat.stage.call("action.pause", action_id="go")
    boat.run(1.0)
    boat.at = (-150.0, 0.0)
    boat.stage.call("action.resume", action_id="go")
    assert boat.until_ended(300.0).state == "done"


def stop_at(boat: Boat, rested_s: float) -> None:
    """Drives to the first waypoint, and rests there for a time."""
    before = (math.inf, math.inf)
    while boat.at != before or boat.at[0] < 20.0:
        before = boat.at
        boat.run(STEP_S)
    boat.run(rested_s)


def interrupt(boat: Boat, cause: str, duration_s: float) -> None:
    if cause == "pause":
        boat.stage.call("action.pause", action_id="go")
        boat.run(duration_s)
        boat.stage.call("action.resume", action_id="go")
    elif cause == "autopilot":
        boat.is_guided = False
        boat.run(duration_s)
        boat.is_guided = True
    else:
        for _ in range(round(duration_s / STEP_S)):
            boat.stage.step(STEP_S, driver=DriverState(is_guided=True))


def test_it_goes_home_straight() -> None:
    boat = Boat((0.0, 0.2))
    boat.at = (20.0, 20.0)
    boat.run(0.1)
    boat.stage.begin("return_home")
    assert boat.until_ended().state == "done"
    assert boat.nearest_m((0.0, 0.0, 0.0)) < 3.0


def test_a_current_that_it_cannot_make_good_and_an_autopilot_that_does_not_follow_are_failures_with_their_reason() -> (
    None
):
    boat = Boat((-2.5, 0.0), slow_s=10.0)
    boat.begin()
    assert boat.until_ended().reason.startswith("the vehicle does not come to waypoint 1 (")
    alone = Boat(follow_s=5.0)
    alone.is_guided = False
    alone.begin()
    assert "does not follow our setpoints: no position" in alone.until_ended().reason


def test_what_only_a_vehicle_can_do_that_moves_sideways_is_refused() -> None:
    for order in ({"heading": HeadingOrder(mode="fixed", heading_rad=1.0)}, {"wall_distance_m": 2.0}):
        with pytest.raises(Refused, match="steers by its heading"):
            Boat().begin(**order)


def test_a_submarine_is_led_down_along_its_legs() -> None:
    boat = Boat(climb_m_s=0.5)
    boat.begin(((30.0, 0.0, 6.0),))
    boat.run(8.0)
    sent = [message for message in boat.stage.step(STEP_S, pose=boat._pose()) if isinstance(message, Setpoint)]
    assert sent[0].velocity_ned_m_s is not None
    assert 0.2 < sent[0].velocity_ned_m_s[2] <= 0.5
