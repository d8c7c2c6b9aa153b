"""Setting off and ending a way, where a vehicle neither climbs nor disarms by itself."""

import pytest
from msgspec.structs import replace
from tests.onboard.driver_rig import DriverRig
from tests.onboard.messages import LIMITS
from tests.onboard.scripted_autopilot import ScriptedAutopilot

from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import FlightMode, LandedState, ManoeuvreKind, VehicleClass

LAND, SET_OFF, TAKE_OFF = ManoeuvreKind.LAND, ManoeuvreKind.SET_OFF, ManoeuvreKind.TAKE_OFF
LED = pytest.mark.parametrize("vehicle", [VehicleClass.ROVER, VehicleClass.BOAT, VehicleClass.SUB])


def rig_of(vehicle: VehicleClass) -> DriverRig:
    return DriverRig(autopilot=ScriptedAutopilot("ardupilot", vehicle))


def running(vehicle: VehicleClass) -> DriverRig:
    """Armed, and following the owner's setpoints."""
    rig = rig_of(vehicle)
    rig.step()
    rig.request(SET_OFF, may_arm=True)
    rig.run(1.0)
    rig.autopilot.reported = replace(rig.autopilot.reported, landed=LandedState.IN_AIR)
    rig.hold()
    rig.run(1.0)
    assert rig.state.is_guided
    return rig


@LED
def test_it_sets_off_armed_in_guided_and_then_follows_the_stream(vehicle: VehicleClass) -> None:
    rig = rig_of(vehicle)
    rig.step()
    rig.request(SET_OFF, may_arm=True)
    rig.run(1.0)
    assert rig.autopilot.commands == ["mode guided", "arm"]
    assert rig.state.manoeuvre_state == "done"
    assert running(vehicle).autopilot.setpoints


@LED
def test_it_does_not_take_off(vehicle: VehicleClass) -> None:
    rig = rig_of(vehicle)
    rig.request(TAKE_OFF, height_m=2.0, may_arm=True)
    rig.run(1.0)
    assert rig.autopilot.commands == []
    assert "does not take off" in rig.state.manoeuvre_reason


def test_a_copter_does_not_set_off_without_climbing() -> None:
    rig = rig_of(VehicleClass.COPTER)
    rig.request(SET_OFF, may_arm=True)
    rig.run(1.0)
    assert rig.autopilot.commands == []
    assert "ask for a take-off" in rig.state.manoeuvre_reason


@pytest.mark.parametrize("vehicle", [VehicleClass.ROVER, VehicleClass.BOAT])
def test_a_way_on_the_ground_ends_in_hold_at_rest_and_disarmed(vehicle: VehicleClass) -> None:
    rig = running(vehicle)
    rig.wants = lambda: None
    rig.request(LAND)
    rig.run(0.5)
    assert rig.autopilot.modes_asked[-1] == "hold"
    assert "disarm" not in rig.autopilot.commands
    rig.run(4.0)
    assert rig.autopilot.commands[-1] == "disarm"
    assert rig.state.manoeuvre_state == "done"
    assert not rig.state.has_pilot_control


def test_what_still_rolls_is_not_disarmed() -> None:
    from tests.onboard.messages import autopilot_pose, pose

    rig = running(VehicleClass.ROVER)
    rig.wants = lambda: None
    rig.request(LAND)
    for _ in range(100):
        rig.step(pose=replace(pose(0.0, 0.0, 0.0), velocity_ned_m_s=(0.5, 0.0, 0.0)), autopilot_pose=autopilot_pose())
    assert "disarm" not in rig.autopilot.commands
    rig.run(3.0)
    assert rig.autopilot.commands[-1] == "disarm"


def test_a_submarine_that_has_surfaced_goes_over_to_alt_hold_by_itself_and_is_disarmed() -> None:
    rig = running(VehicleClass.SUB)
    rig.wants = lambda: None
    rig.request(LAND)
    rig.run(2.0)
    assert rig.autopilot.modes_asked[-1] == "land"
    assert "disarm" not in rig.autopilot.commands, "it has only begun to rise"
    rig.autopilot.reported = replace(rig.autopilot.reported, mode=FlightMode.MANUAL, mode_name="ALT_HOLD")
    rig.run(1.0)
    assert rig.autopilot.commands[-1] == "disarm"
    assert rig.state.manoeuvre_state == "done"
    assert not rig.state.has_pilot_control


def test_a_submarine_whose_pilot_takes_alt_hold_under_way_is_left_to_him() -> None:
    rig = running(VehicleClass.SUB)
    rig.autopilot.reported = replace(rig.autopilot.reported, mode=FlightMode.MANUAL, mode_name="ALT_HOLD")
    rig.see()
    assert rig.state.has_pilot_control


def flying(away_m: float, *, home_ned_m: Vector3 | None = (0.0, 0.0, 0.0), refuses: str = "") -> DriverRig:
    """A PX4 plane so far from home, whose landing is asked for."""
    rig = DriverRig(autopilot=ScriptedAutopilot("px4", VehicleClass.PLANE)).in_flight()
    rig.autopilot.refuses |= {refuses: "there is none"} if refuses else {}
    rig.at, rig.wants = (away_m, 0.0, 60.0), lambda: None
    rig.step(limits=replace(LIMITS, home_ned_m=home_ned_m))
    rig.autopilot.commands.clear()
    rig.request(LAND)
    return rig


def test_a_px4_plane_is_brought_home_before_it_circles_down() -> None:
    rig = flying(900.0)
    rig.run(20.0)
    assert rig.autopilot.modes_asked == ["return"]
    assert rig.state.manoeuvre_state == "running"
    assert not rig.state.has_pilot_control
    rig.at = (100.0, 50.0, 60.0)
    rig.run(1.0)
    assert rig.autopilot.modes_asked == ["return", "land"]
    rig.autopilot.touch_down()
    rig.run(1.0)
    assert rig.state.manoeuvre_state == "done"


@pytest.mark.parametrize(("away_m", "home_ned_m"), [(100.0, (0.0, 0.0, 0.0)), (900.0, None)])
def test_a_px4_plane_at_home_or_without_one_lands_where_it_is(away_m: float, home_ned_m: Vector3 | None) -> None:
    rig = flying(away_m, home_ned_m=home_ned_m)
    rig.run(2.0)
    assert rig.autopilot.modes_asked == ["land"]


def test_a_px4_plane_that_cannot_return_lands_where_it_is() -> None:
    rig = flying(900.0, refuses="mode return")
    rig.run(2.0)
    assert rig.autopilot.modes_asked == ["return", "land"]


def test_a_px4_plane_that_its_own_return_has_landed_has_landed() -> None:
    rig = flying(900.0)
    rig.run(2.0)
    rig.autopilot.touch_down()
    rig.run(1.0)
    assert rig.state.manoeuvre_state == "done"
    assert rig.autopilot.modes_asked == ["return"]


def test_a_plan_s_mode_is_asked_for_although_the_last_heartbeat_shows_it_still() -> None:
    """The hold between two plans may have been commanded since; PX4's heartbeat comes once a second."""
    rig = DriverRig(autopilot=ScriptedAutopilot("px4", VehicleClass.VTOL)).in_flight()
    for _ in range(2):
        rig.autopilot.commands.clear()
        rig.request(ManoeuvreKind.PLAN)
        rig.run(1.0)
        assert rig.autopilot.commands == ["mode mission"]
    assert rig.state.manoeuvre_state == "running"


def test_a_px4_plane_on_the_ground_is_put_into_the_mission_mode_before_it_is_armed_for_its_plan() -> None:
    rig = DriverRig(autopilot=ScriptedAutopilot("px4", VehicleClass.PLANE))
    rig.autopilot.reported = replace(rig.autopilot.reported, mode=FlightMode.HOLD)
    rig.step()
    rig.request(ManoeuvreKind.PLAN, may_arm=True)
    rig.run(2.0)
    assert rig.autopilot.modes_asked == ["mission"]
    assert rig.state.manoeuvre_state == "running"
