"""Every plugin of mavsdk 4 that means something for a multirotor, with the vehicle on the ground: what it does in each
style, and with which result it is refused.
"""

from collections.abc import Iterator
from math import isnan
from pathlib import Path
from typing import Any

import pytest
from mavsdk.plugins.action import OrbitYawBehavior, RelayCommand
from mavsdk.plugins.calibration import Calibration
from mavsdk.plugins.camera import Camera
from mavsdk.plugins.component_metadata import ComponentMetadata
from mavsdk.plugins.events import Events
from mavsdk.plugins.failure import Failure, FailureType, FailureUnit
from mavsdk.plugins.follow_me import FollowMe
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.geofence import Circle, FenceType, Geofence, GeofenceData, Point, Polygon
from mavsdk.plugins.gimbal import ControlMode, Gimbal
from mavsdk.plugins.gripper import Gripper
from mavsdk.plugins.info import Info
from mavsdk.plugins.log_files import LogFiles
from mavsdk.plugins.log_streaming import LogStreaming
from mavsdk.plugins.manual_control import ManualControl
from mavsdk.plugins.mission_raw import MissionItem
from mavsdk.plugins.offboard import Offboard
from mavsdk.plugins.param import Param
from mavsdk.plugins.rtk import RtcmData, Rtk
from mavsdk.plugins.shell import Shell
from mavsdk.plugins.shell.shell import Device
from mavsdk.plugins.transponder import Transponder
from tests.sitl.mavsdk_client import (
    ALTITUDE_M,
    LATITUDE_DEG,
    LONGITUDE_DEG,
    Client,
    client_of,
    degrees_north,
    item,
    outcome,
)

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

WAYPOINT, TAKE_OFF, RALLY, INCLUSION = 16, 22, 5100, 5001
STREAMS = [f"--param=MAV1_{name}=5" for name in ("EXT_STAT", "POSITION", "EXTRA1", "EXTRA3", "RAW_SENS")]
ARGUMENTS = {"px4": [], "ardupilot": ["--autopilot", "ardupilot", *STREAMS]}


@pytest.fixture(scope="module", params=["px4", "ardupilot"])
def at_hand(request: pytest.FixtureRequest) -> Iterator[tuple[Client, bool]]:
    """A client of a vehicle that may be armed, and whether that is of PX4's style."""
    with client_of(*ARGUMENTS[request.param], speed=10.0) as client:
        client.await_armable()
        yield client, request.param == "px4"


def both(px4: str, ardupilot: str) -> dict[bool, str]:
    return {True: px4, False: ardupilot}


def test_actions_on_the_ground(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    action = client.action
    place = (degrees_north(8.0), LONGITUDE_DEG, ALTITUDE_M + 4.0)
    refused = both("COMMAND_DENIED", "FAILED")
    for call, arguments, wanted in (
        (action.takeoff, (), refused),
        (action.goto_location, (*place, 90.0), refused),
        (
            action.do_orbit,
            (5.0, 1.0, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, *place),
            both("COMMAND_DENIED", "UNSUPPORTED"),
        ),
        (action.transition_to_fixedwing, (), both("NO_VTOL_TRANSITION_SUPPORT", "NO_VTOL_TRANSITION_SUPPORT")),
        (action.set_current_speed, (2.0,), both("SUCCESS", "SUCCESS")),
        (action.set_current_speed, (-3.0,), both("COMMAND_DENIED", "COMMAND_DENIED")),
        (action.set_actuator, (1, 1500.0), both("SUCCESS", "FAILED")),
        (action.set_actuator, (9, 1500.0), both("SUCCESS", "SUCCESS")),
        (action.set_relay, (0, RelayCommand.ON), both("UNSUPPORTED", "FAILED")),
        (action.set_home, (False, LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M), both("SUCCESS", "SUCCESS")),
        (action.set_home, (True, 0.0, 0.0, 0.0), both("SUCCESS", "SUCCESS")),
        (action.set_gps_global_origin, (47.0, 8.0, 400.0), both("TIMEOUT", "TIMEOUT")),
    ):
        assert outcome(call, *arguments) == wanted[is_px4], call
    if is_px4:
        action.set_home(False, LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M + 2.0)
        client.await_telemetry("home", lambda home: abs(home.absolute_altitude_m - ALTITUDE_M - 2.0) < 0.1)
        action.set_home(True, 0.0, 0.0, 0.0)
    action.set_takeoff_altitude(3.0)
    assert action.get_takeoff_altitude() == 3.0
    action.set_return_to_launch_altitude(6.0)
    assert action.get_return_to_launch_altitude() == 6.0


def test_arming_and_what_is_refused_meanwhile(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    client.action.arm()
    client.await_telemetry("armed", bool)
    assert outcome(client.action.reboot) == both("COMMAND_DENIED", "FAILED")[is_px4]
    assert outcome(client.action.shutdown) == both("COMMAND_DENIED", "FAILED")[is_px4]
    client.action.disarm()
    client.await_disarmed()


def test_parameters_of_each_type_and_every_refusal(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    param = client.plugin(Param)
    whole, real = ("NAV_DLL_ACT", "RTL_RETURN_ALT") if is_px4 else ("FS_GCS_ENABLE", "RTL_ALT_M")
    param.set_param_int(whole, 1)
    assert param.get_param_int(whole) == 1
    param.set_param_float(real, 9.5)
    assert param.get_param_float(real) == 9.5
    assert outcome(param.set_param_int, whole, 77) == "VALUE_OUT_OF_RANGE"
    assert param.get_param_int(whole) == 1
    assert outcome(param.get_param_int, "NO_SUCH") == both("TIMEOUT", "DOES_NOT_EXIST")[is_px4]
    assert outcome(param.get_param_float, whole) == "WRONG_TYPE"
    assert outcome(param.set_param_float, whole, 1.0) == both("TYPE_MISMATCH", "WRONG_TYPE")[is_px4]
    everything = param.get_all_params()
    values = {row.name: row.value for row in (*everything.int_params, *everything.float_params)}
    assert (values[whole], values[real]) == (1, 9.5)
    assert len(values) > 80
    assert not everything.custom_params
    param.set_param_int(whole, 0)


def test_offboard_needs_a_setpoint_first(at_hand: tuple[Client, bool]) -> None:
    client, _ = at_hand
    offboard = client.plugin(Offboard)
    assert outcome(offboard.start) == "NO_SETPOINT_SET"
    assert not offboard.is_active()


def plan(is_px4: bool) -> list[MissionItem]:
    first = [] if is_px4 else [item(0, WAYPOINT, height_m=0.0, frame=0)]
    return [*first, item(len(first), TAKE_OFF), item(len(first) + 1, WAYPOINT, north_m=6.0)]


def test_missions_are_uploaded_read_set_and_cleared(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    mission, items = client.mission, plan(is_px4)
    mission.clear_mission()
    assert outcome(mission.start_mission) == both("SUCCESS", "UNKNOWN")[is_px4], (
        "PX4 accepts every mode until it is armed"
    )
    assert outcome(mission.set_current_mission_item, 3) == "INVALID_ARGUMENT"
    assert outcome(mission.upload_mission, []) == "NO_MISSION_AVAILABLE"
    assert outcome(mission.upload_mission, [item(0, TAKE_OFF), item(2, WAYPOINT)]) == "INVALID_SEQUENCE"
    mission.upload_mission(items)
    assert [row.command for row in mission.download_mission()] == [row.command for row in items]
    mission.set_current_mission_item(1)
    assert outcome(mission.set_current_mission_item, 9) == "INVALID_ARGUMENT"
    client.await_telemetry("position", lambda _: mission.mission_progress().current == 1)
    assert mission.mission_progress().total == len(items)
    assert not mission.is_mission_finished()
    mission.clear_mission()
    assert len(mission.download_mission()) == (0 if is_px4 else 1)


def test_fences_and_rally_points_are_uploaded_read_and_cleared(at_hand: tuple[Client, bool]) -> None:
    client, _ = at_hand
    corners = ((-50.0, -50), (50.0, -50), (50.0, 50), (-50.0, 50))
    fence = [
        item(
            number,
            INCLUSION,
            north_m=north,
            param1=4.0,
            frame=0,
            mission_type=1,
            y=round((LONGITUDE_DEG + e / 75e3) * 1e7),
        )
        for number, (north, e) in enumerate(corners)
    ]
    client.mission.upload_geofence(fence)
    assert [(row.x, row.y) for row in client.mission.download_geofence()] == [(row.x, row.y) for row in fence]
    client.mission.upload_rally_points([item(0, RALLY, north_m=20.0, mission_type=2)])
    assert len(client.mission.download_rallypoints()) == 1
    places = [Point(degrees_north(north), LONGITUDE_DEG + east / 75e3) for north, east in corners]
    hole = Circle(Point(degrees_north(30.0), LONGITUDE_DEG), 5.0, FenceType.EXCLUSION)
    geofence = client.plugin(Geofence)
    geofence.upload_geofence(GeofenceData([Polygon(places, FenceType.INCLUSION)], [hole]))
    data = geofence.download_geofence()
    assert (len(data.polygons), len(data.circles)) == (1, 1)
    assert data.circles[0].radius == 5.0
    assert (
        outcome(geofence.upload_geofence, GeofenceData([Polygon(places[:2], FenceType.INCLUSION)], []))
        == "INVALID_ARGUMENT"
    )
    geofence.clear_geofence()
    assert not client.mission.download_geofence()


WPL = (
    "QGC WPL 110\n"
    "0\t1\t0\t16\t0\t0\t0\t0\t47.3977\t8.5456\t488\t1\n"
    "1\t0\t3\t22\t0\t0\t0\t0\t47.3977\t8.5456\t5\t1\n"
    "2\t0\t3\t16\t0\t0\t0\t0\t47.3978\t8.5456\t5\t1\n"
)


PLAN = """{"fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
 "mission": {"cruiseSpeed": 5, "firmwareType": 12, "globalPlanAltitudeMode": 1, "hoverSpeed": 5, "version": 2, "vehicleType": 2,
  "plannedHomePosition": [47.3977, 8.5456, 488],
  "items": [
   {"AMSLAltAboveTerrain": null, "Altitude": 5, "AltitudeMode": 1, "autoContinue": true, "command": 22, "doJumpId": 1,
    "frame": 3, "params": [0, 0, 0, null, 47.3977, 8.5456, 5], "type": "SimpleItem"},
   {"AMSLAltAboveTerrain": null, "Altitude": 5, "AltitudeMode": 1, "autoContinue": true, "command": 16, "doJumpId": 2,
    "frame": 3, "params": [0, 0, 0, null, 47.3979, 8.5456, 5], "type": "SimpleItem"}]},
 "geoFence": {"circles": [{"circle": {"center": [47.3977, 8.5456], "radius": 80}, "inclusion": true, "version": 1}],
  "polygons": [], "version": 2},
 "rallyPoints": {"points": [[47.3978, 8.5456, 5]], "version": 2}}"""


def test_a_plan_of_qgroundcontrol_is_imported_and_uploaded(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    imported = client.mission.import_qgroundcontrol_mission_from_string(PLAN)
    items = imported.mission_items
    home = [] if is_px4 else [WAYPOINT]  # mavsdk puts it there, where the vehicle is ArduPilot's
    assert [row.command for row in items] == [*home, TAKE_OFF, WAYPOINT]
    client.mission.upload_mission(items)
    client.mission.upload_geofence(imported.geofence_items)
    client.mission.upload_rally_points(imported.rally_items)
    assert len(client.mission.download_mission()) == len(items)
    assert len(client.mission.download_geofence()) == 1
    assert len(client.mission.download_rallypoints()) == 1
    client.mission.clear_mission()


def test_a_plan_of_another_program_is_imported_and_uploaded(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    imported = client.mission.import_mission_planner_mission_from_string(WPL)
    items = imported.mission_items[1:] if is_px4 else imported.mission_items
    for number, row in enumerate(items):
        row.seq, row.current = number, int(number == 0)
    client.mission.upload_mission(items)
    assert [row.command for row in client.mission.download_mission()][-2:] == [TAKE_OFF, WAYPOINT]
    client.mission.clear_mission()


def test_who_it_is(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    info = client.plugin(Info)
    version = info.get_version()
    assert (version.flight_sw_major, version.flight_sw_minor) == ((1, 16) if is_px4 else (4, 7))
    assert info.get_identification().legacy_uid != 0
    assert info.get_product().vendor_name == "undefined"
    client.telemetry.set_rate_attitude_euler(20.0)
    client.await_telemetry("attitude_euler", lambda _: outcome(info.get_speed_factor) == "SUCCESS")
    client.await_telemetry("attitude_euler", lambda _: 5.0 < info.get_speed_factor() < 15.0)


def test_calibrations(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    calibration = client.plugin(Calibration)
    for begin in (calibration.calibrate_gyro_async, calibration.calibrate_level_horizon_async):
        assert client.reported(begin)[-1][0].name == both("SUCCESS", "UNSUPPORTED")[is_px4]


def test_what_there_is_not(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    found = outcome(client.plugin(Failure).inject, FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
    # mavsdk asks for SYS_FAILURE_EN first, and refuses by itself where the answer came in time.
    assert found in (("DISABLED", "DENIED") if is_px4 else ("UNSUPPORTED",))
    assert outcome(client.plugin(Gripper).grab, 1) == both("UNSUPPORTED", "FAILED")[is_px4]
    assert outcome(client.plugin(Transponder).set_rate_transponder, 1.0) == both("UNKNOWN", "COMMAND_DENIED")[is_px4]
    assert outcome(client.plugin(Rtk).send_rtcm_data, RtcmData("AAAA")) == "SUCCESS"
    assert not client.plugin(Gimbal).gimbal_list().gimbals
    assert outcome(client.plugin(Gimbal).take_control, 0, ControlMode.PRIMARY) == "ERROR"
    assert not client.plugin(Camera).camera_list().cameras
    assert outcome(client.plugin(Camera).get_mode, 0) == "CAMERA_ID_INVALID"
    assert outcome(client.plugin(Events).get_health_and_arming_checks_report) == "NOT_AVAILABLE"
    client.plugin(ComponentMetadata).request_autopilot_component()
    if is_px4:
        assert outcome(client.plugin(LogStreaming).start_log_streaming) == "UNSUPPORTED"
        reported: list[Any] = []
        shell = client.plugin(Shell)
        shell.subscribe_receive(lambda receive, _: reported.append(receive))
        shell.send("ver all", Device.SHELL)
        client.await_telemetry("position", lambda _: bool(reported))


def test_a_gripper_that_a_parameter_enables(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    gripper, param = client.plugin(Gripper), client.plugin(Param)
    enable = both("PD_GRIPPER_EN", "GRIP_ENABLE")[is_px4]
    param.set_param_int(enable, 1)
    assert [outcome(call, 1) for call in (gripper.release, gripper.grab)] == ["SUCCESS", "SUCCESS"]
    param.set_param_int(enable, 0)


def test_follow_me_is_configured_and_entered_in_px4_alone(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    follow = client.plugin(FollowMe)
    config = follow.get_config()
    config.follow_distance_m = 12.0
    assert outcome(follow.set_config, config) == both("SUCCESS", "SET_CONFIG_FAILED")[is_px4]
    assert outcome(follow.start) == both("SUCCESS", "UNKNOWN")[is_px4]
    if is_px4:
        assert client.plugin(Param).get_param_float("FLW_TGT_DST") == 12.0
        client.await_mode("FOLLOW_ME")
        client.action.hold()


def test_manual_control_needs_input_first(at_hand: tuple[Client, bool]) -> None:
    client, _ = at_hand
    manual = client.plugin(ManualControl)
    assert outcome(manual.start_position_control) == "INPUT_NOT_SET"
    manual.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
    manual.start_altitude_control()
    client.await_mode("ALTCTL")
    manual.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
    manual.start_position_control()
    client.await_mode("POSCTL")


def test_files_and_logs(at_hand: tuple[Client, bool], tmp_path: Path) -> None:
    client, _ = at_hand
    files, logs = client.plugin(Ftp), client.plugin(LogFiles)
    source = tmp_path / "a.txt"
    source.write_bytes(bytes(range(256)) * 40)
    files.create_directory("/x")
    assert outcome(files.create_directory, "/x") == "FILE_EXISTS"
    assert client.reported(files.upload_async, str(source), "/x")[-1][0].name == "SUCCESS"
    assert [file.name for file in files.list_directory("/x").entries] == ["a.txt"]
    assert files.are_files_identical(str(source), "/x/a.txt")
    for is_burst in (False, True):
        folder = tmp_path / str(is_burst)
        folder.mkdir()
        assert client.reported(files.download_async, "/x/a.txt", str(folder), is_burst)[-1][0].name == "SUCCESS"
        assert (folder / "a.txt").read_bytes() == source.read_bytes()
    files.rename("/x/a.txt", "/x/b.txt")
    assert outcome(files.remove_directory, "/x") != "SUCCESS"
    files.remove_file("/x/b.txt")
    files.remove_directory("/x")
    assert outcome(files.remove_file, "/x/b.txt") == "FILE_DOES_NOT_EXIST"
    assert outcome(files.list_directory, "/x") == "FILE_DOES_NOT_EXIST"
    client.action.arm()
    client.await_telemetry("armed", bool)
    client.action.disarm()
    client.await_disarmed()
    assert logs.get_entries()
    logs.erase_all_log_files()
    assert outcome(logs.get_entries) == "NO_LOGFILES"


PX4_ALONE = {"altitude", "actuator_output_status", "ground_truth", "odometry"}
ARDUPILOT_ALONE = {"raw_imu"}
NO_OWNER = {"actuator_control_target"}
RATES = (
    *(
        "altitude",
        "attitude_euler",
        "attitude_quaternion",
        "battery",
        "distance_sensor",
        "fixedwing_metrics",
        "gps_info",
    ),
    *("health", "home", "imu", "in_air", "landed_state", "position", "position_velocity_ned", "raw_gps", "rc_status"),
    *("scaled_imu", "unix_epoch_time", "velocity_ned", "vtol_state", "raw_imu", "actuator_output_status"),
    *("ground_truth", "odometry", "actuator_control_target"),
)


def test_every_rate_is_set_or_refused(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand
    missing = NO_OWNER | (ARDUPILOT_ALONE if is_px4 else PX4_ALONE)
    refused = both("UNKNOWN", "COMMAND_DENIED")[is_px4]
    for name in RATES:
        found = outcome(getattr(client.telemetry, f"set_rate_{name}"), 5.0)
        assert found == (refused if name in missing else "SUCCESS"), name


def test_every_stream_tells_sensible_values(at_hand: tuple[Client, bool]) -> None:
    client, is_px4 = at_hand

    def near(value: float, wanted: float, within: float) -> bool:
        return bool(abs(value - wanted) <= within)

    def feels(imu: Any) -> bool:
        acceleration, field = imu.acceleration_frd, imu.magnetic_field_frd
        return near(acceleration.down_m_s2, -9.81, 0.3) and 0.2 < abs(field.down_gauss) < 0.7

    sensible: dict[str, Any] = {
        "armed": lambda value: value is False,
        "attitude_angular_velocity_body": lambda rate: near(rate.yaw_rad_s, 0.0, 0.1),
        "attitude_euler": lambda angles: near(angles.roll_deg, 0.0, 2.0) and near(angles.yaw_deg, 0.0, 6.0),
        "attitude_quaternion": lambda q: near(q.w, 1.0, 0.01),
        "battery": lambda battery: near(battery.voltage_v, 12.5, 0.5) and near(battery.remaining_percent, 100.0, 5.0),
        "distance_sensor": lambda distance: near(distance.current_distance_m, 0.08, 0.1),
        "fixedwing_metrics": lambda metrics: near(metrics.absolute_altitude_m, ALTITUDE_M, 1.0),
        "gps_info": lambda gps: gps.num_satellites > 10 and gps.fix_type.name == "RTK_FIXED",
        "heading": lambda heading: near((heading.heading_deg + 180.0) % 360.0, 180.0, 6.0),
        "health": lambda health: health.is_armable and health.is_global_position_ok and health.is_home_position_ok,
        "health_all_ok": bool,
        "home": lambda home: near(home.latitude_deg, LATITUDE_DEG, 1e-5),
        "in_air": lambda value: value is False,
        "landed_state": lambda state: state.name == "ON_GROUND",
        "position": lambda place: (
            near(place.longitude_deg, LONGITUDE_DEG, 1e-5) and near(place.relative_altitude_m, 0.0, 0.3)
        ),
        "position_velocity_ned": lambda both: near(both.position.north_m, 0.0, 0.3),
        "raw_gps": lambda gps: near(gps.absolute_altitude_m, ALTITUDE_M, 1.0) and 0.3 < gps.hdop < 2.0,
        "scaled_imu": feels,
        "scaled_pressure": lambda pressure: near(pressure.absolute_pressure_hpa, 956.0, 12.0),
        "unix_epoch_time": lambda time_us: time_us > 1_700_000_000_000_000,
        "velocity_ned": lambda velocity: near(velocity.north_m_s, 0.0, 0.2),
        "vtol_state": lambda state: state.name == "UNDEFINED",
    }
    if is_px4:
        sensible |= {
            "actuator_output_status": lambda status: status.active == 15 and max(status.actuator) == 0.0,
            "altitude": lambda altitude: near(altitude.altitude_amsl_m, ALTITUDE_M, 1.0),
            "ground_truth": lambda truth: near(truth.latitude_deg, LATITUDE_DEG, 1e-5),
            "imu": feels,
            "odometry": lambda odometry: (
                near(odometry.q.w, 1.0, 0.01) and not isnan(odometry.pose_covariance.covariance_matrix[0])
            ),
        }
    else:
        sensible["raw_imu"] = lambda imu: near(imu.acceleration_frd.down_m_s2, -1000.0, 40.0) or feels(imu)
    for name, condition in sensible.items():
        if name in RATES:
            getattr(client.telemetry, f"set_rate_{name}")(5.0)
        client.await_telemetry(name, condition, within_s=8.0)
