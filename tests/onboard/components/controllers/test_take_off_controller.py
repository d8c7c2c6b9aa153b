"""The take-off controller: refusals on the ground, the climb, the hand-over at the top, and what can go wrong between."""

from typing import Any

import pytest
from msgspec.structs import replace
from tests.onboard.messages import flying, pose, standing
from tests.onboard.stage import Stage

from gloc3.errors import Refused
from gloc3.messages.vehicle import (
    AutopilotState,
    DriverState,
    FlightMode,
    LandedState,
    Manoeuvre,
    ManoeuvreKind,
    ManoeuvreState,
    Setpoint,
)
from gloc3_onboard.components.controllers.take_off import TakeOffController, TakeOffSettings

RUNNING, DONE, FAILED = ManoeuvreState.RUNNING, ManoeuvreState.DONE, ManoeuvreState.FAILED


class Rig:
    """A controller; autopilot, driver and height are what the test says."""

    def __init__(self, *, arm: bool = True, ground_m: float = 0.0) -> None:
        self.stage = Stage(TakeOffController(), TakeOffSettings(arm=arm))
        self.autopilot: AutopilotState = standing()
        self.driver = DriverState()
        self.ground_m = ground_m
        self.height_m = 0.0
        self.climb_m_s = 0.0
        self.has_pose = True
        self.run(0.1)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            messages: dict[str, Any] = {"autopilot": self.autopilot, "driver": self.driver}
            if self.has_pose:
                height_m = self.ground_m + self.height_m
                messages["pose"] = pose(0.0, 0.0, height_m, velocity_ned_m_s=(0.0, 0.0, -self.climb_m_s))
            self.stage.step(0.1, **messages)

    def begin(self, height_m: float = 2.0) -> "Rig":
        self.stage.begin("take_off", height_m=height_m)
        return self

    def says(self, state: ManoeuvreState, reason: str = "", **fields: Any) -> None:
        self.driver = DriverState(
            action_id="go", manoeuvre_id="go", manoeuvre_state=state, manoeuvre_reason=reason, **fields
        )

    def lift_off(self, height_m: float = 1.0, mode: FlightMode = FlightMode.TAKE_OFF) -> None:
        self.says(RUNNING)
        self.autopilot = flying(mode, landed=LandedState.TAKING_OFF)
        self.height_m, self.climb_m_s = height_m, 1.0
        self.run(1.0)

    @property
    def requested(self) -> list[Manoeuvre]:
        return self.stage.all(Manoeuvre)

    @property
    def setpoints(self) -> list[Setpoint]:
        return self.stage.all(Setpoint)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        ({"autopilot": replace(standing(), is_connected=False)}, "the autopilot does not answer"),
        ({"autopilot": flying()}, "the vehicle is in the air already"),
        ({"autopilot": standing(is_armable=False, reasons=["no fix"])}, "the autopilot would not arm: no fix"),
        ({"autopilot": standing(is_armable=False)}, "the autopilot would not arm: it gives no reason"),
        ({"has_pose": False}, "there is no valid pose"),
    ],
)
def test_what_would_not_work_is_refused(spoil: dict[str, Any], reason: str) -> None:
    rig = Rig()
    for name, value in spoil.items():
        setattr(rig, name, value)
    rig.run(2.2)  # a late pose will do until then: the vehicle stands
    with pytest.raises(Refused, match=reason):
        rig.begin()


def test_a_late_pose_is_no_reason_to_refuse_but_the_climb_waits_for_the_next() -> None:
    rig = Rig()
    rig.has_pose = False
    rig.run(1.0)
    rig.begin().run(0.5)
    assert rig.requested == []
    rig.has_pose = True
    rig.run(0.1)
    assert len(rig.requested) == 1


def test_a_disarmed_vehicle_is_refused_where_arming_is_not_allowed_and_an_armed_one_is_not() -> None:
    rig = Rig(arm=False)
    with pytest.raises(Refused, match="the platform file does not allow arming"):
        rig.begin()
    rig.autopilot = standing(is_armed=True, is_armable=False)
    rig.run(0.1)
    rig.begin().run(0.1)
    assert rig.requested == [Manoeuvre(action_id="go", kind=ManoeuvreKind.TAKE_OFF, height_m=2.0, may_arm=False)]


def test_the_climb_is_asked_for_once_and_ends_on_our_own_setpoints() -> None:
    rig = Rig(ground_m=5.0).begin()
    rig.run(1.0)
    assert len(rig.requested) == 1
    assert rig.requested[0].may_arm
    rig.lift_off()
    assert rig.setpoints == []
    assert rig.stage.status.progress == pytest.approx(0.5)
    rig.height_m, rig.climb_m_s = 1.95, 0.1
    rig.says(DONE)
    rig.autopilot = flying(FlightMode.HOLD)
    rig.run(1.0)
    assert rig.setpoints[-1].position_ned_m == pytest.approx((0.0, 0.0, -7.0))
    assert rig.stage.status.state == "running"
    rig.says(DONE, is_guided=True)
    rig.autopilot = flying(FlightMode.GUIDED)
    rig.run(0.1)
    assert rig.stage.status.state == "done"
    assert len(rig.requested) == 1
    count = len(rig.setpoints)
    rig.run(0.5)
    assert len(rig.setpoints) == count


def test_while_it_passes_the_height_fast_the_climb_is_not_over() -> None:
    rig = Rig().begin()
    rig.run(0.1)
    rig.lift_off(2.0)
    assert rig.setpoints == []


def test_a_climb_that_ends_too_low_is_gone_on_with() -> None:
    rig = Rig().begin()
    rig.run(0.1)
    rig.lift_off(1.2)
    rig.says(DONE, is_guided=True)
    rig.autopilot = flying(FlightMode.GUIDED)
    rig.climb_m_s = 0.0
    rig.run(0.5)
    assert rig.setpoints[-1].position_ned_m == pytest.approx((0.0, 0.0, -2.0))
    assert rig.stage.status.state == "running"
    rig.height_m = 2.0
    rig.run(0.1)
    assert rig.stage.status.state == "done"


def test_somebody_elses_guided_mode_is_not_ours() -> None:
    rig = Rig().begin()
    rig.run(0.1)
    rig.lift_off(2.0)
    rig.climb_m_s = 0.0
    rig.driver = replace(rig.driver, action_id="hold", is_guided=True)
    rig.run(1.0)
    assert rig.stage.status.state == "running"


def test_a_refusal_fails_it_with_the_reason() -> None:
    rig = Rig().begin()
    rig.run(0.1)
    rig.says(FAILED, "compass not calibrated")
    rig.run(1.0)
    assert (rig.stage.status.state, rig.stage.status.reason) == ("failed", "compass not calibrated")


def test_a_disarm_on_the_way_fails_it() -> None:
    rig = Rig().begin()
    rig.run(0.1)
    rig.lift_off()
    rig.autopilot = standing()
    rig.run(0.1)
    assert (rig.stage.status.state, rig.stage.status.reason) == ("failed", "the vehicle was disarmed")


def test_one_that_does_not_come_up_fails_in_time_and_says_how_far_it_was() -> None:
    rig = Rig().begin()
    rig.run(0.1)
    rig.lift_off(0.7)
    rig.run(60.0)
    assert rig.stage.status.state == "failed"
    assert rig.stage.status.reason == "after 60 s it is at 0.7 m of 2.0 m"


def test_without_a_pose_at_the_top_nothing_is_streamed_and_it_goes_on_with_one() -> None:
    rig = Rig().begin()
    rig.run(0.1)
    rig.lift_off(2.0)
    rig.says(DONE, is_guided=True)
    rig.climb_m_s = 0.0
    rig.has_pose = False
    rig.run(3.0)
    assert len(rig.setpoints) <= 1
    assert rig.stage.status.state == "running"
    rig.has_pose = True
    rig.run(0.2)
    assert rig.stage.status.state == "done"


def test_a_pause_in_the_air_is_gone_on_with_by_setpoints_to_the_same_height() -> None:
    rig = Rig().begin()
    rig.run(0.1)
    rig.lift_off(1.0)
    rig.stage.call("action.pause", action_id="go")
    rig.driver = DriverState(
        action_id="hold",
        manoeuvre_id="go",
        manoeuvre_state=FAILED,
        manoeuvre_reason="motion was granted to another owner",
        is_guided=True,
    )
    rig.autopilot, rig.climb_m_s = flying(FlightMode.GUIDED), 0.0
    rig.run(90.0)
    assert rig.setpoints == []
    rig.stage.call("action.resume", action_id="go")
    rig.run(0.3)
    assert rig.setpoints[-1].position_ned_m == pytest.approx((0.0, 0.0, -2.0))
    assert len(rig.requested) == 1
    rig.driver = replace(rig.driver, action_id="go")
    rig.height_m = 2.0
    rig.run(0.1)
    assert rig.stage.status.state == "done"


def test_a_pause_on_the_ground_is_gone_on_with_by_asking_again() -> None:
    rig = Rig().begin()
    rig.run(0.2)
    rig.says(RUNNING)
    rig.stage.call("action.pause", action_id="go")
    rig.says(FAILED, "motion was granted to another owner")
    rig.run(1.0)
    rig.stage.call("action.resume", action_id="go")
    rig.run(0.3)
    assert len(rig.requested) == 2
    assert rig.stage.status.state == "running"
    rig.says(RUNNING)
    rig.run(1.0)
    assert rig.stage.status.state == "running"


def test_a_cancelled_take_off_asks_for_nothing_more() -> None:
    rig = Rig().begin()
    rig.run(0.1)
    rig.lift_off(2.0)
    rig.stage.call("action.cancel", action_id="go")
    rig.climb_m_s = 0.0
    rig.run(1.0)
    assert (len(rig.requested), rig.setpoints) == (1, [])


def test_a_take_off_is_refused_while_nothing_is_heard_of_the_autopilots_state() -> None:
    rig = Rig()
    for _ in range(30):
        rig.stage.step(0.1, pose=pose(0.0, 0.0, 0.0), driver=rig.driver)
    with pytest.raises(Refused, match="no state is received from the autopilot"):
        rig.begin()


def test_driving_off_arms_and_is_done_once_the_vehicle_follows_from_where_it_stands() -> None:
    rig = Rig(ground_m=3.0)
    rig.stage.begin("drive_off")
    rig.run(0.1)
    requested = rig.stage.last(Manoeuvre)
    assert isinstance(requested, Manoeuvre)
    assert (requested.kind, requested.height_m, requested.may_arm) == (ManoeuvreKind.SET_OFF, 0.0, True)
    rig.says(RUNNING)
    rig.autopilot = flying(FlightMode.GUIDED)
    rig.run(1.0)
    assert rig.stage.last(Setpoint) is None, "the driver has not armed it yet"
    rig.says(DONE)
    rig.run(0.5)
    setpoint = rig.stage.last(Setpoint)
    assert isinstance(setpoint, Setpoint)
    assert setpoint.position_ned_m == pytest.approx((0.0, 0.0, -3.0))
    assert rig.stage.status.state == "running"
    rig.says(DONE, is_guided=True)
    rig.run(0.3)
    assert rig.stage.status.state == "done"


def test_a_dive_leads_down_by_setpoints_and_is_done_at_its_depth() -> None:
    rig = Rig()
    rig.stage.begin("dive", depth_m=4.0)
    rig.run(0.1)
    rig.says(DONE, is_guided=True)
    rig.autopilot = flying(FlightMode.GUIDED)
    rig.height_m, rig.climb_m_s = -2.0, -0.5
    rig.run(1.0)
    setpoint = rig.stage.last(Setpoint)
    assert isinstance(setpoint, Setpoint)
    assert setpoint.position_ned_m == pytest.approx((0.0, 0.0, 4.0))
    assert rig.stage.status.state == "running"
    assert rig.stage.status.progress == pytest.approx(0.5)
    rig.height_m, rig.climb_m_s = -4.0, 0.0
    rig.run(0.3)
    assert rig.stage.status.state == "done"


def test_a_refusal_to_arm_says_what_the_autopilot_and_its_estimator_say() -> None:
    rig = Rig()
    doubts = ["not well: GPS", "the estimator has no horizontal position"]
    rig.autopilot = standing(is_armable=False, reasons=["PreArm: Need Position Estimate"], doubts=doubts)
    rig.run(0.1)
    with pytest.raises(
        Refused, match="Need Position Estimate; not well: GPS; the estimator has no horizontal position"
    ):
        rig.begin()


def test_a_driver_that_has_forgotten_the_manoeuvre_is_asked_again_on_the_ground_and_led_on_in_the_air() -> None:
    rig = Rig().begin()
    rig.says(RUNNING)
    rig.run(1.0)
    assert len(rig.requested) == 1
    rig.driver = DriverState(action_id="go")
    rig.run(1.0)
    assert len(rig.requested) >= 2
    rig.lift_off()
    count = len(rig.requested)
    rig.driver = DriverState(action_id="go")
    rig.run(1.0)
    assert rig.setpoints
    assert len(rig.requested) == count
