"""Steering by hand onboard: a place that moves as demanded, level and by the heading, and rests when demands end."""

import math
from typing import Any

import pytest
from tests.onboard.messages import LIMITS, pose
from tests.onboard.stage import Stage

from gloc3.messages.frames import Vector3, from_euler, from_yaw
from gloc3.messages.teleoperation import EXPIRES_S, TeleoperationState, VelocityDemand
from gloc3.messages.vehicle import Setpoint
from gloc3.mission.model.states import ActionState
from gloc3_onboard.components.controllers.teleoperate import TeleoperateController, TeleoperateSettings

SETTINGS = TeleoperateSettings(acceleration_m_s2=1.0)
STEP_S = 0.05


class Helm(Stage):
    """A vehicle that is where it shall be."""

    def __init__(self, yaw_rad: float = 0.0, **arguments: Any) -> None:
        super().__init__(TeleoperateController(), SETTINGS)
        self.place: Vector3 = (0.0, 0.0, 2.0)
        self.yaw_rad = yaw_rad
        self.sequence = 0
        self.step(limits=LIMITS)
        self.begin("teleoperate", **arguments)

    def drive(
        self, seconds: float, velocity_cm_s: tuple[int, int, int] | None = None, yaw_rate_cdeg_s: int = 0
    ) -> None:
        """Time passes, with a demand in each cycle or without any."""
        for _ in range(round(seconds / STEP_S)):
            more: dict[str, Any] = {}
            if velocity_cm_s is not None:
                more["motion_demand"] = VelocityDemand(
                    sender="255",
                    session=1,
                    sequence=self.sequence,
                    velocity_cm_s=velocity_cm_s,
                    yaw_rate_cdeg_s=yaw_rate_cdeg_s,
                )
                self.sequence += 1
            north, east, down = self.place
            self.step(STEP_S, pose=pose(north, east, -down, ned_from_frd=from_yaw(self.yaw_rad)), **more)
            wanted = self.last(Setpoint)
            assert wanted.position_ned_m is not None
            assert wanted.yaw_rad is not None
            self.place, self.yaw_rad = wanted.position_ned_m, wanted.yaw_rad

    @property
    def velocity(self) -> Vector3:
        found: Vector3 = self.last(Setpoint).velocity_ned_m_s
        return found


def test_surge_sway_and_heave_are_ahead_right_and_up_of_the_heading() -> None:
    for yaw_rad in (0.0, 1.0, -2.5):
        helm = Helm(yaw_rad)
        helm.drive(2.0, (100, 50, 20))
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        assert helm.velocity == pytest.approx((c - 0.5 * s, s + 0.5 * c, -0.2), abs=1e-6)
        assert helm.last(Setpoint).action_id == "go"


def test_a_demand_is_good_for_half_a_second_and_then_it_brakes_to_rest_and_stays() -> None:
    helm = Helm()
    helm.drive(2.0, (100, 0, 0))
    let_go = helm.place
    assert EXPIRES_S == 0.5
    helm.drive(EXPIRES_S - STEP_S)
    assert helm.velocity[0] == pytest.approx(1.0)
    helm.drive(2.0)
    assert helm.velocity == (0.0, 0.0, 0.0)
    assert helm.place[0] - let_go[0] == pytest.approx(1.0 * EXPIRES_S + 0.5, abs=0.06)
    rested = helm.place
    helm.drive(10.0)
    assert helm.place == rested
    state = helm.last(TeleoperationState)
    assert (state.is_live, state.velocity_cm_s, state.reason) == (False, (0, 0, 0), "the last demand has expired")
    assert state.sequence == helm.sequence - 1


def test_it_is_no_faster_than_the_platform_and_the_action_allow() -> None:
    helm = Helm(speed_m_s=0.6, yaw_rate_deg_s=10.0)
    helm.drive(3.0, (3000, 4000, 9000), 9000)
    assert math.hypot(*helm.velocity[:2]) == pytest.approx(0.6)
    assert helm.velocity[2] == pytest.approx(-0.6)
    state = helm.last(TeleoperationState)
    assert state.velocity_cm_s == (36, 48, 60)
    assert state.yaw_rate_cdeg_s == 1000
    fast = Helm()
    fast.drive(6.0, (3000, 4000, 9000))
    assert math.hypot(*fast.velocity[:2]) == pytest.approx(LIMITS.speed_m_s)
    assert fast.velocity[2] == pytest.approx(-LIMITS.climb_m_s)


def test_one_that_is_held_fast_does_not_leap_when_it_is_free() -> None:
    helm = Helm()
    for sequence in range(200):
        demand = VelocityDemand(
            sender="255", session=1, sequence=sequence, velocity_cm_s=(100, 0, 0), yaw_rate_cdeg_s=9000
        )
        helm.step(STEP_S, pose=pose(0.0, 0.0, -2.0), motion_demand=demand)
    wanted = helm.last(Setpoint)
    assert math.dist(wanted.position_ned_m, (0.0, 0.0, 2.0)) <= SETTINGS.lead_m + 1e-9
    assert wanted.yaw_rad <= SETTINGS.turn_ahead_rad + 1e-9


def test_what_was_demanded_before_it_began_or_rested_does_not_move_it() -> None:
    helm = Helm()
    helm.drive(1.0, (100, 0, 0))
    helm.call("action.pause", action_id="go")
    count = len(helm.all(Setpoint))
    helm.step(STEP_S, pose=pose())
    assert len(helm.all(Setpoint)) == count
    helm.call("action.resume", action_id="go")
    helm.step(STEP_S, pose=pose(5.0, 6.0, 7.0))
    assert helm.last(Setpoint).position_ned_m == pytest.approx((5.0, 6.0, -7.0))
    assert helm.last(Setpoint).velocity_ned_m_s == (0.0, 0.0, 0.0)


def test_it_ends_by_itself_when_its_time_is_over_and_is_silent_without_a_pose() -> None:
    helm = Helm(duration_s=3.0)
    helm.drive(1.0, (100, 0, 0))
    count = len(helm.all(Setpoint))
    for _ in range(10):
        helm.step(STEP_S, pose=pose(is_valid=False))
    assert len(helm.all(Setpoint)) == count
    for _ in range(60):
        helm.step(STEP_S, pose=pose())
    assert helm.status.state is ActionState.DONE


def test_roll_and_pitch_do_not_tilt_the_way() -> None:
    helm = Helm()
    for sequence in range(40):
        demand = VelocityDemand(sender="255", session=1, sequence=sequence, velocity_cm_s=(100, 0, 0))
        tilted = pose(*helm.place[:2], -helm.place[2], ned_from_frd=from_euler(0.2, 0.4, 0.0))
        helm.step(STEP_S, pose=tilted, motion_demand=demand)
        helm.place = helm.last(Setpoint).position_ned_m
    assert helm.velocity == pytest.approx((1.0, 0.0, 0.0), abs=1e-3)


def test_what_coasts_down_when_it_begins_keeps_its_depth_while_it_goes_ahead() -> None:
    helm = Helm()
    helm.step(STEP_S, pose=pose(0.0, 0.0, -2.0, velocity_ned_m_s=(0.0, 0.0, 0.4)))
    helm.drive(4.0, (100, 0, 0))
    assert helm.place[2] == pytest.approx(2.08, abs=0.03), "0.4 m/s is lost in 0.4 s, whatever is asked for ahead"


def test_a_driven_vehicle_is_led_by_speed_and_heading_goes_only_ahead_and_keeps_its_place_when_it_stands() -> None:
    stage = Stage(TeleoperateController(), TeleoperateSettings(acceleration_m_s2=1.0, is_driven=True))
    stage.step(limits=LIMITS)
    stage.begin("teleoperate")

    def drive(seconds: float, velocity_cm_s: tuple[int, int, int], yaw_rate_cdeg_s: int = 0) -> Setpoint:
        for number in range(round(seconds / STEP_S)):
            demand = VelocityDemand(
                sender="255", session=1, sequence=number, velocity_cm_s=velocity_cm_s, yaw_rate_cdeg_s=yaw_rate_cdeg_s
            )
            here = pose(3.0, 4.0, 0.0, ned_from_frd=from_yaw(1.0))
            stage.step(STEP_S, pose=here, motion_demand=demand)
        found: Setpoint = stage.last(Setpoint)
        return found

    ahead = drive(2.0, (100, 50, 20))
    assert ahead.position_ned_m is None
    assert ahead.yaw_rad is None, "it looks where it goes"
    assert ahead.velocity_ned_m_s == pytest.approx((math.cos(1.0), math.sin(1.0), 0.0))
    assert stage.last(TeleoperationState).reason == "it only goes ahead and turns, not to the side, up or back"
    stands = drive(2.0, (-100, 0, 0))
    assert (stands.position_ned_m, stands.velocity_ned_m_s) == ((3.0, 4.0, 0.0), (0.0, 0.0, 0.0))
    turns = drive(0.5, (0, 0, 0), 2000)
    assert (turns.position_ned_m, turns.velocity_ned_m_s) == (None, (0.0, 0.0, 0.0))
    assert turns.yaw_rad == pytest.approx(1.0 + math.radians(10.0), abs=0.01)
    assert stage.last(TeleoperationState).reason == ""
