"""The scenarios of dronekit's tests, written anew with pymavlink, in ArduPilot's style over TCP.

They speak as dronekit does: MAVLink 1 until the vehicle is heard, REQUEST_DATA_STREAM, SET_MODE, floats in missions, items to
go to now, overridden channels. `gloc3 sitl --autopilot ardupilot` itself listens on TCP 5760.
"""

import socket
from collections.abc import Iterator
from math import hypot
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from tests.sitl.dronekit_client import ACCEPTED, GUIDED, Vehicle
from tests.sitl.mavsdk_client import ALTITUDE_M, LATITUDE_DEG, degrees_north, simulated_vehicle

from gloc3_sitl.cli.sitl import ARDUPILOTS_LINK, read_link
from gloc3_sitl.vehicles.simulator import LinkKind

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

RTL, STABILIZE, ALT_HOLD, LOITER = 6, 0, 2, 5
DENIED, FAILED = 2, 4


def fly_port(*arguments: str, speed: float = 8.0) -> Any:
    return simulated_vehicle("--autopilot", "ardupilot", *arguments, speed=speed, link="tcpin://127.0.0.1:0")


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with fly_port() as port:
        yield port


@pytest.fixture
def vehicle(port: int) -> Iterator[Vehicle]:
    vehicle = Vehicle(port)
    try:
        vehicle.connect()
        yield vehicle
    finally:
        vehicle.close()


def test_the_command_listens_where_ardupilot_does() -> None:
    assert ARDUPILOTS_LINK == "station=tcpin://127.0.0.1:5760"
    assert read_link(ARDUPILOTS_LINK).kind is LinkKind.GROUND


def test_state_mode_and_version(vehicle: Vehicle) -> None:
    heartbeat = vehicle.received["HEARTBEAT"]
    assert (heartbeat.type, heartbeat.autopilot) == (dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA)
    vehicle.await_message(
        "HEARTBEAT", lambda beat: beat.system_status == dialect.MAV_STATE_STANDBY
    )  # it boots at first
    assert vehicle.command(dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1) == ACCEPTED
    version = vehicle.received.get("AUTOPILOT_VERSION") or vehicle.await_message("AUTOPILOT_VERSION")
    assert version.flight_sw_version >> 24 == 4
    assert version.capabilities & dialect.MAV_PROTOCOL_CAPABILITY_MISSION_INT


def test_the_streams_that_were_asked_for_come_and_locations_agree(vehicle: Vehicle) -> None:
    for name in (
        "ATTITUDE",
        "VFR_HUD",
        "RAW_IMU",
        "GPS_RAW_INT",
        "EKF_STATUS_REPORT",
        "BATTERY_STATUS",
        "SERVO_OUTPUT_RAW",
    ):
        vehicle.await_message(name)
    place = vehicle.await_message("GLOBAL_POSITION_INT")
    assert place.lat * 1e-7 == pytest.approx(LATITUDE_DEG, abs=1e-5)
    assert place.alt * 1e-3 == pytest.approx(ALTITUDE_M, abs=1.0)
    local = vehicle.await_message("LOCAL_POSITION_NED")
    assert hypot(local.x, local.y) < 1.0


def test_parameters_are_listed_read_set_and_kept(vehicle: Vehicle) -> None:
    assert len(vehicle.parameters) > 80
    for wanted in (1.5, 2.5):
        vehicle.master.mav.param_set_send(1, 1, b"PILOT_SPD_UP", wanted, dialect.MAV_PARAM_TYPE_REAL32)
        assert vehicle.await_message("PARAM_VALUE").param_value == wanted
        vehicle.master.mav.param_request_read_send(1, 1, b"PILOT_SPD_UP", -1)
        assert vehicle.await_message("PARAM_VALUE").param_value == wanted
    vehicle.master.mav.param_set_send(1, 1, b"FS_GCS_ENABLE", 1.0, dialect.MAV_PARAM_TYPE_REAL32)
    assert vehicle.await_message("PARAM_VALUE").param_type == dialect.MAV_PARAM_TYPE_INT8
    vehicle.master.mav.param_set_send(1, 1, b"FS_GCS_ENABLE", 0.0, dialect.MAV_PARAM_TYPE_REAL32)


def test_modes_are_set_and_listeners_hear_each_change(vehicle: Vehicle) -> None:
    seen: list[int] = []
    vehicle.listeners.append(("HEARTBEAT", lambda heartbeat: seen.append(heartbeat.custom_mode)))
    for mode in (ALT_HOLD, GUIDED, STABILIZE):
        vehicle.set_mode(mode)
    assert [mode for mode in (ALT_HOLD, GUIDED, STABILIZE) if mode in seen] == [ALT_HOLD, GUIDED, STABILIZE]


def test_a_listener_for_everything_and_its_end(vehicle: Vehicle) -> None:
    names: set[str] = set()
    row = ("*", lambda message: names.add(message.get_type()))
    vehicle.listeners.append(row)
    vehicle.wait(lambda: {"HEARTBEAT", "ATTITUDE", "SYS_STATUS"} <= names)
    vehicle.listeners.remove(row)
    names.clear()
    vehicle.await_message("ATTITUDE")
    assert not names


def test_a_message_that_is_asked_for_at_a_rate(vehicle: Vehicle) -> None:
    interval = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
    assert vehicle.command(interval, dialect.MAVLINK_MSG_ID_HOME_POSITION, 200_000) == ACCEPTED
    home = vehicle.await_message("HOME_POSITION")
    assert home.latitude * 1e-7 == pytest.approx(LATITUDE_DEG, abs=1e-5)
    assert vehicle.command(interval, dialect.MAVLINK_MSG_ID_ALTITUDE, 1e6) == DENIED


def test_calibrations_are_acknowledged(vehicle: Vehicle) -> None:
    calibrate = dialect.MAV_CMD_PREFLIGHT_CALIBRATION
    for params, wanted in (
        ((1,), ACCEPTED),  # gyro
        ((0, 0, 1), ACCEPTED),  # barometer
        ((0, 0, 0, 0, 4), ACCEPTED),  # accelerometer, simple
        ((0, 0, 0, 0, 2), ACCEPTED),  # level
        ((0, 0, 0, 0, 1), ACCEPTED),  # accelerometer, on all six sides: it requests them one by one
    ):
        assert vehicle.command(calibrate, *params) == wanted, params
    assert vehicle.command(dialect.MAV_CMD_DO_START_MAG_CAL) == FAILED
    assert vehicle.command(dialect.MAV_CMD_DO_CANCEL_MAG_CAL) == ACCEPTED


def test_missions_are_uploaded_downloaded_and_cleared_and_home_is_kept(vehicle: Vehicle) -> None:
    vehicle.await_armable()
    vehicle.upload()
    assert len(vehicle.download()) == 1
    waypoint, take_off = dialect.MAV_CMD_NAV_WAYPOINT, dialect.MAV_CMD_NAV_TAKEOFF
    vehicle.upload((take_off, 0.0, 10.0), *((waypoint, 10.0 * number, 10.0) for number in range(1, 6)))
    items = vehicle.download()
    assert [item.command for item in items] == [waypoint, take_off, *(waypoint,) * 5]
    assert items[0].x == pytest.approx(LATITUDE_DEG, abs=1e-5)
    assert items[4].x == pytest.approx(degrees_north(30.0), abs=1e-5)
    assert items[4].z == 10.0
    vehicle.master.mav.mission_set_current_send(1, 1, 3)
    vehicle.await_message("MISSION_CURRENT", lambda current: current.seq == 3)
    vehicle.master.mav.mission_clear_all_send(1, 1)
    vehicle.await_message("MISSION_ACK")
    assert len(vehicle.download()) <= 1


def test_take_off_goto_and_return(vehicle: Vehicle) -> None:
    vehicle.simple_goto(5.0, 5.0)
    assert vehicle.await_message("MISSION_ACK").type != 0  # not in GUIDED
    vehicle.arm_and_take_off(5.0)
    vehicle.simple_goto(15.0, 8.0)
    vehicle.await_message("LOCAL_POSITION_NED", lambda place: abs(place.x - 15.0) < 1.0 and abs(place.z + 8.0) < 1.0)
    vehicle.simple_goto(0.0, 6.0)
    vehicle.await_message("LOCAL_POSITION_NED", lambda place: place.x < 10.0)
    vehicle.set_mode(RTL)
    vehicle.wait(lambda: not vehicle.is_armed, 60.0)
    vehicle.set_mode(STABILIZE)


def test_velocities_in_guided(vehicle: Vehicle) -> None:
    vehicle.arm_and_take_off(4.0)
    for _ in range(20):
        vehicle.master.mav.set_position_target_local_ned_send(0, 1, 1, 1, 3527, 0, 0, 0, 0, 1.5, 0, 0, 0, 0, 0, 0)
        vehicle.await_message("LOCAL_POSITION_NED")
        if vehicle.received["LOCAL_POSITION_NED"].vy > 1.2:
            break
    assert vehicle.received["LOCAL_POSITION_NED"].vy > 1.2
    assert vehicle.command(dialect.MAV_CMD_NAV_LAND) == ACCEPTED
    vehicle.wait(lambda: not vehicle.is_armed, 60.0)
    vehicle.set_mode(STABILIZE)


def test_arming_is_refused_with_the_reason_in_words(vehicle: Vehicle) -> None:
    vehicle.set_mode(RTL)
    assert vehicle.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) == FAILED
    vehicle.wait(lambda: "PreArm: " in getattr(vehicle.received.get("STATUSTEXT"), "text", ""))
    vehicle.set_mode(STABILIZE)


def test_a_reboot_is_acknowledged_and_the_vehicle_comes_back(vehicle: Vehicle) -> None:
    before = vehicle.await_message("SYSTEM_TIME").time_boot_ms
    assert vehicle.command(dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == ACCEPTED
    vehicle.received.pop("HEARTBEAT")
    vehicle.await_message("HEARTBEAT")
    vehicle.master.mav.request_data_stream_send(1, 1, 0, 4, 1)
    assert vehicle.await_message("SYSTEM_TIME").time_boot_ms < before


def test_a_port_without_a_vehicle_is_told_within_the_time_that_was_given() -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        nobody = Vehicle(silent.getsockname()[1], timeout_s=1.0)
        try:
            with pytest.raises(AssertionError):
                nobody.connect()
        finally:
            nobody.close()


def test_two_clients_on_one_port_are_both_served(port: int) -> None:
    first, second = Vehicle(port), Vehicle(port)
    try:
        first.connect()
        second.connect()
        first.await_message("ATTITUDE")
        second.await_message("ATTITUDE")
    finally:
        first.close()
        second.close()


def check_overrides(vehicle: Vehicle) -> None:
    def override(*pulses: int) -> None:
        vehicle.master.mav.rc_channels_override_send(1, 1, *pulses, *(65535,) * (8 - len(pulses)))

    override(1700, 1500, 1200, 1500)
    received = vehicle.await_message("RC_CHANNELS", lambda channels: channels.chan1_raw == 1700)
    assert received.chan3_raw == 1200
    override(65535, 1600)
    received = vehicle.await_message("RC_CHANNELS", lambda channels: channels.chan2_raw == 1600)
    assert received.chan1_raw == 1700
    override(0, 0, 0, 0)
    vehicle.await_message("RC_CHANNELS", lambda channels: channels.rssi == 0)


def test_channels_are_overridden_and_given_back() -> None:
    with fly_port() as port:  # one of its own: afterwards the transmitter counts as lost
        vehicle = Vehicle(port)
        try:
            vehicle.connect()
            check_overrides(vehicle)
        finally:
            vehicle.close()
