"""The adapter is chosen by what the heartbeat says, and chosen anew when that changes; each class is led in its form."""

import math

import pytest

from gloc3.mavlink import codec
from gloc3.mavlink.message import Address
from gloc3.messages.frames import from_yaw
from gloc3.messages.vehicle import AutopilotPose, FlightMode, LandedState, Style, VehicleClass, VtolForm
from gloc3_onboard.autopilot import ardupilot, px4
from gloc3_onboard.autopilot.ardupilot import ArduPilot
from gloc3_onboard.autopilot.families import style_of
from gloc3_onboard.autopilot.px4 import Px4
from gloc3_onboard.autopilot.setpoints import MOST_M_S, setpoint_message
from gloc3_onboard.autopilot.style import NAV_TAKEOFF, SET_MODE, ClassProperties, Form, MavCommand
from gloc3_onboard.components.drivers.setpoint_stream import EXPIRY_S
from gloc3_onboard.sensors.devices import AutopilotSetpoint, CommandAnswer

from .test_autopilot_link import SET_POSITION, Rig

AUTOPILOT = Address(1, 1)
EAST = AutopilotPose(
    position_ned_m=(10.0, 0.0, 0.0),
    velocity_ned_m_s=(0.0, 0.0, 0.0),
    ned_from_frd=from_yaw(math.pi / 2.0),
    rate_frd_rad_s=(0.0, 0.0, 0.0),
    origin_geo=(47.0, 8.0, 400.0),
)
EVERY = [*ardupilot.CLASSES.values(), *px4.CLASSES.values()]


@pytest.mark.parametrize(
    ("style", "number", "vehicle"),
    [
        ("ardupilot", 2, "copter"),
        ("ardupilot", 13, "copter"),
        ("ardupilot", 10, "rover"),
        ("ardupilot", 11, "boat"),
        ("ardupilot", 12, "sub"),
        ("ardupilot", 1, "plane"),
        ("ardupilot", 20, "vtol"),
        ("ardupilot", 22, "vtol"),
        ("px4", 2, "copter"),
        ("px4", 10, "rover"),
        ("px4", 1, "plane"),
        ("px4", 22, "vtol"),
    ],
)
def test_the_adapter_is_chosen_by_autopilot_and_type(style: str, number: int, vehicle: str) -> None:
    with Rig(style, vehicle_type=number) as rig:
        rig.run(2.0)
        assert rig.reported[0] == f"{style} autopilot found as 1/1, on a {vehicle}"
        assert (rig.device.state().style, rig.device.state().vehicle) == (Style(style), VehicleClass(vehicle))
        assert rig.device.behaviour.vehicle is VehicleClass(vehicle)
        assert rig.device.setup().vehicle is VehicleClass(vehicle)


def test_a_quadplane_holds_on_wings_in_a_circle_and_on_rotors_in_a_hover() -> None:
    style = ArduPilot(VehicleClass.VTOL)
    asked = {form: style.mode_command(FlightMode.HOLD, form) for form in (None, *VtolForm)}
    numbers = {form: command.parameters[1] for form, command in asked.items() if isinstance(command, MavCommand)}
    assert numbers == {None: 12.0, "rotors": 15.0, "to_rotors": 15.0, "to_wings": 12.0, "wings": 12.0}
    assert style.flight_mode(15) is FlightMode.HOLD
    plane = ArduPilot(VehicleClass.PLANE).mode_command(FlightMode.HOLD, VtolForm.ROTORS)
    assert isinstance(plane, MavCommand)
    assert plane.parameters[1] == 12.0


@pytest.mark.parametrize(("style", "number"), [("ardupilot", 5), ("ardupilot", 7), ("px4", 12), ("px4", 0)])
def test_a_class_whose_modes_are_not_known_is_left_alone(style: str, number: int) -> None:
    with Rig(style, vehicle_type=number) as rig:
        rig.run(5.0)
        assert rig.reported[0].endswith(f"MAV_TYPE {number}): it is ignored")
        assert rig.autopilot.ran == []


@pytest.mark.parametrize("autopilot", [0, 4, 8, 18])
def test_of_another_firmware_nothing_is_believed(autopilot: int) -> None:
    heartbeat = codec.message("HEARTBEAT", type=2, autopilot=autopilot, system_status=3, mavlink_version=3)
    assert style_of(heartbeat) is None


def test_it_is_chosen_anew_when_another_firmware_speaks() -> None:
    with Rig("ardupilot", vehicle_type=2) as rig:
        rig.run(4.0)
        rig.autopilot.style, rig.autopilot.vehicle_type = "px4", 10
        rig.autopilot.boot()
        rig.run(4.0)
        assert "the autopilot is now px4 on a rover" in rig.reported
        assert rig.device.behaviour == px4.ROVER.behaviour
        assert rig.autopilot.rate_hz("ESTIMATOR_STATUS") == pytest.approx(1.0), "asked for what PX4 has"
        rig.autopilot.vehicle_type = 7
        rig.autopilot.boot()
        rig.run(3.0)
        ticket = rig.device.command_arm()
        answer = rig.device.answer(ticket)
        assert answer is not None
        assert not answer.is_accepted
        assert not rig.device.state().is_connected


@pytest.mark.parametrize("facts", EVERY, ids=lambda snapshot: f"{snapshot.vehicle}-{len(snapshot.modes)}")
def test_every_mode_that_is_commanded_is_read_as_what_it_does(facts: ClassProperties) -> None:
    for mode, number in facts.commanded.items():
        read, _ = facts.modes[number]
        assert read is (facts.behaviour.land_mode if mode is FlightMode.LAND else mode)
    is_led = facts is not ardupilot.VTOL  # its GUIDED is a hold
    assert {FlightMode.HOLD, *([FlightMode.GUIDED] if is_led else [])} <= set(facts.commanded)
    assert facts.behaviour.vehicle is facts.vehicle
    assert facts.behaviour.climbs != bool(facts.why_no_take_off)


def test_what_a_class_has_no_mode_or_no_take_off_for_is_refused_in_words() -> None:
    sub, rover, plane = ArduPilot(VehicleClass.SUB), ArduPilot(VehicleClass.ROVER), ArduPilot(VehicleClass.PLANE)
    assert sub.mode_command(FlightMode.RETURN) == CommandAnswer(False, "a sub has no mode for return")
    refused = rover.take_off_command(2.0, 0.0)
    assert refused == CommandAnswer(False, "a rover does not take off; its missions begin with drive_off")
    assert Px4(VehicleClass.ROVER).take_off_command(2.0, 0.0) == refused
    used = plane.take_off_command(50.0, 0.0)
    assert isinstance(used, MavCommand)
    assert (used.number, used.parameters[1]) == (SET_MODE, 13.0)
    with Rig("ardupilot", vehicle_type=10) as rig:
        rig.run(4.0)
        assert rig.device.answer(rig.device.command_take_off(2.0)) == refused
        assert rig.requested(NAV_TAKEOFF) == []


@pytest.mark.parametrize("number", [10, 11, 12])
def test_what_does_not_tell_whether_it_has_landed_is_under_way_while_it_is_armed(number: int) -> None:
    with Rig("ardupilot", vehicle_type=number) as rig:
        rig.run(3.0)
        assert rig.device.state().landed is LandedState.ON_GROUND
        rig.autopilot.heartbeat.base_mode |= 128
        rig.run(1.0)
        assert rig.device.state().landed is LandedState.IN_AIR


def test_a_rover_is_led_by_a_velocity_alone_to_a_moving_place() -> None:
    with Rig("ardupilot", vehicle_type=10) as rig:
        rig.run(4.0)
        rig.device.send_setpoint(AutopilotSetpoint((3.0, 4.0, 0.0), (0.6, 0.8, 0.0), 1.0))
        rig.run(0.1)
        received = next(message for message in rig.autopilot.received if message.name == SET_POSITION)
        assert received.type_mask == 0b1101_1100_0111, "position, acceleration, yaw and its rate are to be ignored"
        assert math.hypot(received.vx, received.vy) == pytest.approx(1.0 + MOST_M_S, abs=0.01)
        assert math.atan2(received.vy, received.vx) == pytest.approx(math.atan2(0.8, 0.6), abs=0.01)


def test_a_rover_that_is_there_stands_and_keeps_its_heading() -> None:
    message = setpoint_message(
        AutopilotSetpoint((10.3, 0.2, 0.0), (0.0, 0.0, 0.0), None), Form.VELOCITY, AUTOPILOT, 0, EAST
    )
    assert message is not None
    assert (message.vx, message.vy, message.yaw) == pytest.approx((0.0, 0.0, math.pi / 2.0))
    assert not message.type_mask & 0b0100_0000_0000
    brake = setpoint_message(AutopilotSetpoint(None, (0.0, 0.0, 0.0), None), Form.VELOCITY, AUTOPILOT, 0, EAST)
    assert brake is not None
    assert brake.yaw == pytest.approx(math.pi / 2.0), "a heading of 0 would turn it to the north"


def test_a_rover_does_not_circle_to_come_back_to_a_place_that_it_has_just_passed() -> None:
    for east_m, speed in ((-1.2, 0.0), (-3.0, 2.0), (1.2, 0.96)):
        message = setpoint_message(
            AutopilotSetpoint((10.0, east_m, 0.0), None, None), Form.VELOCITY, AUTOPILOT, 0, EAST
        )
        assert message is not None
        assert math.hypot(message.vx, message.vy) == pytest.approx(speed, abs=0.01), east_m


@pytest.mark.parametrize("facts", EVERY, ids=lambda snapshot: f"{snapshot.vehicle}-{snapshot.timeout_s}")
def test_only_a_multirotor_gets_the_acceleration_of_the_moving_place(facts: ClassProperties) -> None:
    setpoint = AutopilotSetpoint((10.0, 5.0, -3.0), (2.0, 0.0, 0.0), 0.0, (1.5, 0.0, -0.2))
    message = setpoint_message(setpoint, facts.form, AUTOPILOT, 0, EAST)
    assert message is not None
    if message.name != "SET_POSITION_TARGET_LOCAL_NED":
        return
    has_acceleration = not message.type_mask & 0b1_1100_0000
    assert has_acceleration == (facts.vehicle is VehicleClass.COPTER)
    if has_acceleration:
        assert (message.afx, message.afy, message.afz) == pytest.approx((1.5, 0.0, -0.2))


def test_a_submarine_never_gets_a_position_without_a_velocity() -> None:
    message = setpoint_message(AutopilotSetpoint((1.0, 2.0, 3.0), None, None), Form.MOVING, AUTOPILOT, 0, EAST)
    assert message is not None
    assert not message.type_mask & 0b11_1000, "a stream of positions alone begins its way anew each time"
    assert (message.vx, message.vy, message.vz) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("facts", EVERY, ids=lambda snapshot: f"{snapshot.vehicle}-{snapshot.timeout_s}")
def test_our_own_expiry_comes_before_that_of_every_autopilot(facts: ClassProperties) -> None:
    assert facts.timeout_s > EXPIRY_S, "else the autopilot would act by itself before we command its hold"


def test_a_rover_whose_place_is_not_known_is_led_nowhere() -> None:
    wanted = AutopilotSetpoint((3.0, 4.0, 0.0), None, None)
    assert setpoint_message(wanted, Form.VELOCITY, AUTOPILOT, 0, None) is None


@pytest.mark.parametrize(("style", "gap_s"), [("px4", 1.5), ("ardupilot", 3.5)])
def test_a_stream_that_has_paused_for_too_long_is_told(style: str, gap_s: float) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        rig.autopilot.heartbeat.base_mode |= 128
        rig.autopilot.heartbeat.custom_mode = 6 << 16 if style == "px4" else 4
        rig.run(1.5)
        for pause_s in (0.05, 0.5 * gap_s, gap_s):
            rig.device.send_setpoint(AutopilotSetpoint((1.0, 0.0, -2.0), None, None))
            rig.run(pause_s)
        assert not [text for text in rig.reported if "no setpoint" in text]
        rig.device.send_setpoint(AutopilotSetpoint((1.0, 0.0, -2.0), None, None))
        reported = [text for text in rig.reported if "no setpoint" in text]
        assert len(reported) == 1
        assert reported[0].startswith(f"no setpoint for {gap_s:.1f} s")


def test_a_plane_is_sent_to_a_place_ahead_once_a_second() -> None:
    with Rig("ardupilot", vehicle_type=1) as rig:
        rig.run(4.0)
        rig.device.send_setpoint(AutopilotSetpoint((3.0, 0.0, -50.0), (15.0, 0.0, 0.0), None))
        rig.autopilot.heartbeat.custom_mode = 15
        rig.run(1.5)
        assert not [m for m in rig.autopilot.received if m.name == "COMMAND_INT"], "only in guided mode"
        for _ in range(40):
            rig.device.send_setpoint(AutopilotSetpoint((3.0, 0.0, -50.0), (15.0, 0.0, 0.0), None))
            rig.run(0.05)
        received = [m for m in rig.autopilot.received if m.name == "COMMAND_INT" and m.command == 192]
        assert 2 <= len(received) <= 3
        assert received[0].x * 1e-7 == pytest.approx(39.5 + 203.0 / 111_000.0, abs=1e-4)
        assert received[0].z == pytest.approx(55.0, abs=0.1), "altitude above the sea"
        assert not [m for m in rig.autopilot.received if m.name == SET_POSITION]
