"""The landing controller: here or at a place, asked for until it is flown, and over when the vehicle is disarmed."""

import math
from typing import Any

import pytest
from msgspec.structs import replace
from tests.onboard.messages import flying, pose, standing
from tests.onboard.stage import Stage

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3
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
from gloc3_onboard.components.controllers.landing import STILL_S, LandingController, LandingSettings

RUNNING, FAILED = ManoeuvreState.RUNNING, ManoeuvreState.FAILED


class Rig:
    """A controller over a vehicle that follows setpoints."""

    def __init__(self, **settings: Any) -> None:
        self.stage = Stage(LandingController(), LandingSettings(**settings))
        self.autopilot: AutopilotState = flying(FlightMode.GUIDED)
        self.driver = DriverState(action_id="go", is_guided=True)
        self.at: Vector3 = (0.0, 0.0, -3.0)
        self.has_pose = True
        self.speed_m_s = 0.0
        """Downwards, by the pose."""
        self.run(0.05)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            messages: dict[str, Any] = {"autopilot": self.autopilot, "driver": self.driver}
            if self.has_pose:
                still = pose(self.at[0], self.at[1], -self.at[2])
                messages["pose"] = replace(still, velocity_ned_m_s=(0.0, 0.0, self.speed_m_s))
            for message in self.stage.step(0.05, **messages):
                if isinstance(message, Setpoint) and message.position_ned_m is not None and self.driver.is_guided:
                    self.at = message.position_ned_m

    def says(self, state: ManoeuvreState, reason: str = "", manoeuvre_id: str = "go") -> None:
        self.driver = DriverState(
            action_id="go", manoeuvre_id=manoeuvre_id, manoeuvre_state=state, manoeuvre_reason=reason
        )

    @property
    def requested(self) -> list[Manoeuvre]:
        return self.stage.all(Manoeuvre)


def test_landing_here_is_asked_for_at_once_and_done_when_disarmed() -> None:
    rig = Rig()
    rig.stage.begin("land")
    rig.run(0.05)
    assert rig.requested == [Manoeuvre(action_id="go", kind=ManoeuvreKind.LAND)]
    rig.says(RUNNING)
    rig.run(20.0)
    assert len(rig.requested) == 1
    rig.autopilot = standing()
    rig.run(0.05)
    assert (rig.stage.status.state, rig.stage.status.progress) == ("done", 1.0)


def test_landing_here_needs_no_pose() -> None:
    rig = Rig()
    rig.has_pose = False
    rig.run(2.0)
    rig.stage.begin("land")
    rig.run(0.05)
    assert len(rig.requested) == 1


def test_an_autopilot_that_is_silent_has_not_landed() -> None:
    rig = Rig()
    rig.stage.begin("land")
    rig.autopilot = replace(standing(), is_connected=False)
    rig.run(5.0)
    assert rig.stage.status.state == "running"


@pytest.mark.parametrize("state", [FAILED, None])
def test_a_landing_that_is_refused_or_lost_is_asked_for_again(state: ManoeuvreState | None) -> None:
    rig = Rig(repeat_s=2.0)
    rig.stage.begin("land")
    rig.run(0.1)
    if state is not None:
        rig.says(state, "rejected for now")
    rig.run(6.1)
    assert len(rig.requested) == 4
    assert rig.stage.status.state == "running"
    if state is not None:
        assert rig.stage.status.reason == "rejected for now"
    rig.says(RUNNING)
    rig.run(5.0)
    assert len(rig.requested) == 4
    assert rig.stage.status.reason == ""


def test_of_an_autopilot_that_is_gone_no_mode_is_told() -> None:
    rig = Rig(timeout_s=30.0)
    rig.speed_m_s = 1.0
    rig.stage.begin("land")
    rig.says(RUNNING)
    rig.autopilot = replace(flying(FlightMode.LAND, landed=LandedState.LANDING), is_connected=False)
    rig.run(31.0)
    assert rig.stage.status.reason == "not landed after 30 s: it is not heard: the autopilot is silent"


def test_one_that_never_comes_down_fails_in_time() -> None:
    rig = Rig(timeout_s=30.0)
    rig.speed_m_s = 1.0
    rig.stage.begin("land")
    rig.says(RUNNING)
    rig.autopilot = flying(FlightMode.LAND, landed=LandedState.LANDING)
    rig.run(31.0)
    assert (rig.stage.status.state, rig.stage.status.reason) == (
        "failed",
        "not landed after 30 s: it is armed in mode land, and the autopilot reports landing",
    )


def test_one_that_stands_on_the_ground_undetected_fails_soon_and_says_what_to_do() -> None:
    rig = Rig()
    rig.speed_m_s = 1.0
    rig.stage.begin("land")
    rig.says(RUNNING)
    rig.autopilot = flying(FlightMode.LAND)
    rig.run(60.0)
    assert rig.stage.status.state == "running", "it comes down"
    rig.speed_m_s = 0.05
    rig.run(STILL_S - 1.0)
    assert rig.stage.status.state == "running"
    rig.run(2.0)
    assert (rig.stage.status.state, rig.stage.status.reason) == (
        "failed",
        (
            "it has stood still for 30 s, but is armed in mode land, and the autopilot reports in air: it does not detect that "
            "it has landed; if it stands on the ground, disarm it"
        ),
    )


def test_one_whose_speed_is_not_known_is_not_taken_to_stand_still() -> None:
    rig = Rig()
    rig.stage.begin("land")
    rig.says(RUNNING)
    rig.has_pose = False
    rig.run(STILL_S + 10.0)
    assert rig.stage.status.state == "running"


def test_what_the_driver_says_of_an_earlier_landing_does_not_count() -> None:
    rig = Rig()
    rig.says(RUNNING, manoeuvre_id="earlier")
    rig.stage.begin("land")
    rig.run(3.0)
    assert len(rig.requested) == 2


def test_at_a_place_it_flies_there_first_at_the_present_height() -> None:
    rig = Rig()
    rig.stage.begin("land", at_ned_m=(4.0, 3.0, 0.0))
    rig.run(3.0)
    assert rig.requested == []
    rig.run(4.0)
    assert math.dist(rig.at, (4.0, 3.0, -3.0)) < 0.05
    assert len(rig.requested) == 1
    assert all(setpoint.position_ned_m[2] == pytest.approx(-3.0) for setpoint in rig.stage.all(Setpoint))
    count = len(rig.stage.all(Setpoint))
    rig.run(1.0)
    assert len(rig.stage.all(Setpoint)) == count


def test_to_a_place_it_needs_a_pose_that_is_young() -> None:
    rig = Rig()
    rig.has_pose = False
    rig.run(1.0)
    with pytest.raises(Refused, match="no valid pose to fly to a landing place with"):
        rig.stage.begin("land", at_ned_m=(4.0, 3.0, 0.0))


def test_a_place_that_is_not_reached_fails_it() -> None:
    rig = Rig()
    rig.driver = DriverState(is_guided=False, refusal="no position")
    rig.stage.begin("land", at_ned_m=(4.0, 3.0, 0.0))
    rig.run(31.0)
    assert rig.stage.status.state == "failed"
    assert "the autopilot does not follow our setpoints: no position" in rig.stage.status.reason


def test_a_lost_pose_on_the_way_is_waited_for() -> None:
    rig = Rig()
    rig.stage.begin("land", at_ned_m=(4.0, 0.0, 0.0))
    rig.run(1.0)
    rig.has_pose = False
    rig.run(0.2)
    count = len(rig.stage.all(Setpoint))
    rig.run(5.0)
    assert len(rig.stage.all(Setpoint)) == count
    rig.has_pose = True
    rig.run(8.0)
    assert len(rig.requested) >= 1


@pytest.mark.parametrize("is_on_the_way", [True, False])
def test_a_pause_is_gone_on_with(is_on_the_way: bool) -> None:
    rig = Rig(timeout_s=30.0)
    place: dict[str, Any] = {"at_ned_m": (9.0, 0.0, 0.0)} if is_on_the_way else {}
    rig.stage.begin("land", **place)
    rig.run(1.0)
    rig.says(RUNNING)
    rig.stage.call("action.pause", action_id="go")
    rig.says(FAILED, "motion was granted to another owner")
    setpoints, requested = len(rig.stage.all(Setpoint)), len(rig.requested)
    rig.run(60.0)
    assert (len(rig.stage.all(Setpoint)), len(rig.requested)) == (setpoints, requested)
    rig.stage.call("action.resume", action_id="go")
    rig.driver = replace(rig.driver, is_guided=True)
    rig.run(0.1)
    assert rig.stage.status.state == "running"
    if is_on_the_way:
        assert len(rig.stage.all(Setpoint)) > setpoints
    else:
        assert len(rig.requested) == requested + 1


def test_a_pause_over_the_landing_place_does_not_count_as_waiting_for_the_vehicle() -> None:
    rig = Rig()
    rig.speed_m_s = 0.4
    rig.stage.begin("land", at_ned_m=(1.0, 0.0, 0.0))
    while rig.at[0] < 1.0:
        rig.run(0.05)
    rig.run(1.0)
    assert rig.requested == []
    rig.stage.call("action.pause", action_id="go")
    rig.run(60.0)
    rig.stage.call("action.resume", action_id="go")
    rig.run(4.0)
    assert rig.stage.status.state == "running"
    assert rig.requested


def test_on_the_ground_there_is_nothing_to_do() -> None:
    rig = Rig()
    rig.autopilot = standing()
    rig.run(0.05)
    rig.stage.begin("land", at_ned_m=(4.0, 0.0, 0.0))
    rig.run(0.05)
    assert rig.stage.status.state == "done"
    assert rig.requested == []


def test_a_cancelled_landing_asks_no_more() -> None:
    rig = Rig()
    rig.stage.begin("land")
    rig.run(0.1)
    rig.stage.call("action.cancel", action_id="go")
    rig.run(5.0)
    assert len(rig.requested) == 1


def test_a_vehicle_that_was_disarmed_when_the_autopilots_state_fell_silent_has_not_landed() -> None:
    rig = Rig()
    rig.autopilot = standing()
    rig.run(0.05)
    for _ in range(60):
        rig.stage.step(0.05, pose=pose(0.0, 0.0, 3.0), driver=rig.driver)
    rig.stage.begin("land")
    rig.stage.step(0.05, pose=pose(0.0, 0.0, 3.0), driver=rig.driver)
    assert rig.stage.status.state == "running"
