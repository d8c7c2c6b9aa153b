"""mavsdk 4 flies the simulated vehicle with its plugins: offboard in every form, orbit, missions, by hand, following; and
vision in place of satellites.
"""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from math import hypot, nan
from typing import Any

import pytest
from mavsdk.plugins.action import OrbitYawBehavior
from mavsdk.plugins.follow_me import FollowMe, TargetLocation
from mavsdk.plugins.manual_control import ManualControl
from mavsdk.plugins.mission import Mission, MissionPlan
from mavsdk.plugins.mission import MissionItem as PlanItem
from mavsdk.plugins.mocap import (
    AttitudePositionMocap,
    Covariance,
    Mocap,
    Odometry,
    PositionBody,
    Quaternion,
    VisionPositionEstimate,
)
from mavsdk.plugins.offboard import (
    AccelerationNed,
    ActuatorControl,
    Attitude,
    AttitudeRate,
    Offboard,
    PositionGlobalYaw,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from mavsdk.plugins.param import Param
from tests.sitl.mavsdk_client import ALTITUDE_M, LATITUDE_DEG, LONGITUDE_DEG, Client, client_of, degrees_north, outcome

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

STREAMS = [f"--param=MAV1_{name}=5" for name in ("EXT_STAT", "POSITION", "EXTRA1", "EXTRA3")]
ARGUMENTS = {"px4": [], "ardupilot": ["--autopilot", "ardupilot", *STREAMS]}
STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])
STREAMED_SPEED = 3.0
"""mavsdk repeats its setpoints 20 times a second of wall time; an autopilot wants two in a second of its own."""


PATIENT = ("--param", "COM_OF_LOSS_T=60")
"""On a busy computer mavsdk may pause for longer than a second of the vehicle's time."""


def flying(style: str, *arguments: str, speed: float = 5.0) -> AbstractContextManager[Client]:
    return client_of(*ARGUMENTS[style], *arguments, speed=speed)


def take_off(client: Client, height_m: float = 5.0) -> None:
    client.await_armable()
    client.action.set_takeoff_altitude(height_m)
    client.action.arm()
    client.action.takeoff()
    client.await_height(0.9 * height_m)


def await_velocity(client: Client, north_m_s: float, east_m_s: float, within: float = 0.3) -> None:
    def fits(velocity: Any) -> bool:
        return bool(abs(velocity.north_m_s - north_m_s) < within and abs(velocity.east_m_s - east_m_s) < within)

    client.await_telemetry("velocity_ned", fits)


def test_offboard_in_every_form() -> None:
    with flying("px4", *PATIENT, speed=STREAMED_SPEED) as client:
        client.telemetry.set_rate_position_velocity_ned(10.0)
        client.telemetry.set_rate_attitude_euler(20.0)
        take_off(client)
        client.await_mode("HOLD")
        offboard = client.plugin(Offboard)
        assert outcome(offboard.start) == "NO_SETPOINT_SET"
        offboard.set_position_ned(PositionNedYaw(4.0, 0.0, -5.0, 90.0))
        client.start_offboard(offboard)
        client.await_near(4.0, 0.0)
        client.await_telemetry("attitude_euler", lambda angles: abs(angles.yaw_deg - 90.0) < 5.0)
        offboard.set_velocity_ned(VelocityNedYaw(-1.0, 0.5, 0.0, 90.0))
        await_velocity(client, -1.0, 0.5)
        offboard.set_velocity_body(VelocityBodyYawspeed(1.0, 0.0, 0.0, 0.0))
        await_velocity(client, 0.0, 1.0)
        offboard.set_position_velocity_ned(PositionNedYaw(0.0, 0.0, -5.0, 0.0), VelocityNedYaw(0.0, 0.0, 0.0, 0.0))
        client.await_near(0.0, 0.0, within_m=0.3)
        await_velocity(client, 0.0, 0.0, within=0.1)
        offboard.set_acceleration_ned(AccelerationNed(1.5, 0.0, 0.0))
        client.await_telemetry("velocity_ned", lambda velocity: velocity.north_m_s > 0.8)
        offboard.set_position_velocity_acceleration_ned(
            PositionNedYaw(0.0, 0.0, -5.0, 0.0), VelocityNedYaw(0.0, 0.0, 0.0, 0.0), AccelerationNed(0.0, 0.0, 0.0)
        )
        client.await_near(0.0, 0.0)
        place = PositionGlobalYaw(degrees_north(5.0), LONGITUDE_DEG, 6.0, 0.0, PositionGlobalYaw.AltitudeType.REL_HOME)
        offboard.set_position_global(place)
        client.await_near(5.0, 0.0)
        thrust = client.plugin(Param).get_param_float("MPC_THR_HOVER")
        offboard.set_attitude(Attitude(0.0, -4.0, 0.0, thrust))
        client.await_telemetry("attitude_euler", lambda angles: angles.pitch_deg < -2.5)
        offboard.set_attitude_rate(AttitudeRate(0.0, 20.0, 0.0, thrust))
        client.await_telemetry("attitude_euler", lambda angles: angles.pitch_deg > 2.0)
        offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -5.0, 0.0))
        client.await_near(0.0, 0.0)
        assert offboard.is_active()
        offboard.stop()
        client.await_mode("HOLD")


def test_offboard_setpoints_that_end_are_a_failsafe() -> None:
    with flying("px4", "--param", "COM_OBL_RC_ACT=4", speed=STREAMED_SPEED) as client:
        take_off(client, 3.0)
        offboard = Offboard(client.system)
        offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -3.0, 0.0))
        client.start_offboard(offboard)
        client.await_mode("OFFBOARD")
        offboard.destroy()
        client.await_mode("LAND")
        client.await_disarmed()


def test_actuator_controls_are_no_setpoints_here() -> None:
    with flying("px4", speed=STREAMED_SPEED) as client:
        take_off(client, 3.0)
        offboard = client.plugin(Offboard)
        offboard.set_actuator_control(ActuatorControl([]))
        assert outcome(offboard.start) in ("COMMAND_DENIED", "NO_SETPOINT_SET")


def test_ardupilots_guided_takes_the_setpoints() -> None:
    with flying("ardupilot", speed=STREAMED_SPEED) as client:
        take_off(client)
        offboard = client.plugin(Offboard)
        offboard.set_position_ned(PositionNedYaw(4.0, 0.0, -5.0, 0.0))
        offboard.start()
        client.await_near(4.0, 0.0)
        offboard.set_velocity_ned(VelocityNedYaw(0.0, 1.0, 0.0, 0.0))
        await_velocity(client, 0.0, 1.0)
        offboard.stop()
        client.action.land()
        client.await_disarmed()


@STYLES
def test_actions_in_flight(style: str) -> None:
    height = "RTL_RETURN_ALT" if style == "px4" else "RTL_ALT_M"
    with flying(style, "--param", f"{height}=4", speed=10.0) as client:
        take_off(client)
        if style == "px4":
            place = (LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M + 5.0)
            client.action.do_orbit(5.0, 2.0, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, *place)
            for north, east in ((5.0, 0.0), (0.0, 5.0), (-5.0, 0.0)):
                client.await_near(north, east, 1.5)
        else:
            place = (LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M + 5.0)
            facing = OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER
            assert outcome(client.action.do_orbit, 5.0, 2.0, facing, *place) == "UNSUPPORTED"
        client.action.hold()
        client.action.goto_location(degrees_north(60.0), LONGITUDE_DEG, ALTITUDE_M + 8.0, 0.0)
        client.await_telemetry("position_velocity_ned", lambda reading: reading.position.north_m > 10.0)
        client.action.hold()
        client.await_telemetry("velocity_ned", lambda velocity: hypot(velocity.north_m_s, velocity.east_m_s) < 0.2)
        stopped = client.await_telemetry("position_velocity_ned", lambda _: True).position.north_m
        assert stopped < 50.0
        assert client.action.get_return_to_launch_altitude() == 4.0
        client.action.return_to_launch()
        client.await_disarmed()
        client.await_near(0.0, 0.0)


@STYLES
def test_kill_and_terminate_stop_the_motors_in_flight(style: str) -> None:
    for word in ("kill", "terminate"):
        with flying(style, speed=10.0) as client:
            take_off(client, 3.0)
            assert outcome(getattr(client.action, word)) == "SUCCESS"
            client.await_disarmed()


def test_a_mission_is_paused_goes_on_and_returns_at_its_end() -> None:
    with flying("px4", "--param", "RTL_RETURN_ALT=5", speed=10.0) as client:
        client.await_armable()
        mission = client.plugin(Mission)
        items = [
            PlanItem(
                latitude_deg=degrees_north(north),
                longitude_deg=LONGITUDE_DEG,
                relative_altitude_m=5.0,
                speed_m_s=4.0,
                is_fly_through=True,
                acceptance_radius_m=1.0,
                camera_action=PlanItem.CameraAction.NONE,
                vehicle_action=PlanItem.VehicleAction.NONE,
            )
            for north in (10.0, 40.0)
        ]
        mission.set_return_to_launch_after_mission(True)
        assert mission.get_return_to_launch_after_mission()
        rows = client.reported(mission.upload_mission_with_progress_async, MissionPlan(items))
        assert rows[-1][0].name == "SUCCESS"
        read = mission.download_mission()
        assert [round(row.relative_altitude_m) for row in read.mission_items] == [5, 5]
        client.action.arm()
        mission.start_mission()
        client.await_telemetry("position", lambda _: mission.mission_progress().current >= 1)
        mission.pause_mission()
        client.await_mode("HOLD")
        assert not mission.is_mission_finished()
        mission.start_mission()
        client.await_near(40.0, 0.0, 2.0)
        client.await_mode("MISSION")
        client.await_disarmed()
        client.await_near(0.0, 0.0)
        assert mission.is_mission_finished()


def test_it_is_flown_by_hand() -> None:
    with flying("px4", speed=STREAMED_SPEED) as client:
        client.await_armable()
        manual = client.plugin(ManualControl)

        def sticks(pitch: float, throttle: float, until: Callable[[Any], bool]) -> None:
            def is_so(reading: Any) -> bool:
                manual.set_manual_control_input(pitch, 0.0, throttle, 0.0)
                return until(reading)

            client.await_telemetry("position_velocity_ned", is_so)

        client.telemetry.set_rate_position_velocity_ned(15.0)
        sticks(0.0, 0.5, lambda _: True)
        manual.start_position_control()
        client.action.arm()
        sticks(0.0, 0.9, lambda reading: reading.position.down_m < -3.0)
        sticks(0.5, 0.5, lambda reading: reading.position.north_m > 5.0)
        sticks(0.0, 0.0, lambda reading: reading.position.down_m > -0.15)


def test_it_follows_somebody() -> None:
    with flying("px4") as client:
        take_off(client)
        client.await_mode("HOLD")
        follow = client.plugin(FollowMe)
        follow.start()
        client.await_mode("FOLLOW_ME")
        client.await_telemetry("position", lambda _: follow.is_active())
        follow.set_target_location(TargetLocation(degrees_north(30.0), LONGITUDE_DEG, ALTITUDE_M, 0.0, 0.0, 0.0))
        client.await_near(22.0, 0.0, 1.5)
        client.await_height(7.5)
        assert follow.get_last_location().latitude_deg == pytest.approx(degrees_north(30.0))
        follow.stop()
        client.await_mode("HOLD")


# -- without satellites -------------------------------------------------------------------------------------------------


def is_believed(client: Client, report: Callable[[], object], north_m: float, east_m: float, within_s: float) -> bool:
    """Tells a place again and again until the vehicle believes it, or not."""
    deadline = time.monotonic() + within_s
    last: list[Any] = []
    handle = client.telemetry.subscribe_position_velocity_ned(lambda value, _: last.append(value))
    try:
        while not last or hypot(last[-1].position.north_m - north_m, last[-1].position.east_m - east_m) > 0.2:
            if time.monotonic() > deadline:
                return False
            report()
            time.sleep(0.02)
    finally:
        client.telemetry.unsubscribe_position_velocity_ned(handle)
    return True


UNKNOWN = Covariance([nan])


def test_px4_believes_vision_and_odometry_but_no_motion_capture() -> None:
    with flying("px4", "--no-gps", speed=1.0) as client:
        mocap = client.plugin(Mocap)
        estimate = VisionPositionEstimate(position_body=PositionBody(1.0, 2.0, 0.0), pose_covariance=UNKNOWN)
        assert is_believed(client, lambda: mocap.set_vision_position_estimate(estimate), 1.0, 2.0, 60.0)
        client.action.set_gps_global_origin(LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M)
        odometry = Odometry(
            frame_id=Odometry.MavFrame.LOCAL_FRD,
            position_body=PositionBody(-1.0, 0.5, 0.0),
            q=Quaternion(1.0, 0.0, 0.0, 0.0),
            pose_covariance=UNKNOWN,
            velocity_covariance=UNKNOWN,
            reset_counter=1,
            estimator_type=Odometry.MavEstimatorType.VIO,
        )
        assert is_believed(client, lambda: mocap.set_odometry(odometry), -1.0, 0.5, 60.0)
        client.await_telemetry("health", lambda health: mocap.set_odometry(odometry) and health.is_local_position_ok)
        capture = AttitudePositionMocap(
            q=Quaternion(1.0, 0.0, 0.0, 0.0), position_body=PositionBody(9.0, 9.0, 0.0), pose_covariance=UNKNOWN
        )
        assert not is_believed(client, lambda: mocap.set_attitude_position_mocap(capture), 9.0, 9.0, 2.0)


def test_ardupilot_believes_vision_odometry_and_motion_capture() -> None:
    with flying("ardupilot", "--no-gps", speed=1.0) as client:
        mocap = client.plugin(Mocap)
        estimate = VisionPositionEstimate(position_body=PositionBody(1.0, 2.0, 0.0), pose_covariance=UNKNOWN)
        assert is_believed(client, lambda: mocap.set_vision_position_estimate(estimate), 1.0, 2.0, 60.0)
        capture = AttitudePositionMocap(
            q=Quaternion(1.0, 0.0, 0.0, 0.0), position_body=PositionBody(1.5, 2.5, 0.0), pose_covariance=UNKNOWN
        )
        assert is_believed(client, lambda: mocap.set_attitude_position_mocap(capture), 1.5, 2.5, 20.0)


# -- power --------------------------------------------------------------------------------------------------------------


@STYLES
def test_a_reboot_is_seen_and_parameters_outlive_it(style: str) -> None:
    name = "RTL_RETURN_ALT" if style == "px4" else "RTL_ALT_M"
    with flying(style) as client:
        client.await_armable()
        param = client.plugin(Param)
        param.set_param_float(name, 9.0)
        client.telemetry.set_rate_attitude_euler(10.0)
        before = client.await_telemetry("attitude_euler", lambda angles: angles.timestamp_us > 3_000_000)
        client.action.reboot()
        deadline = time.monotonic() + 20.0
        while True:
            client.telemetry.set_rate_attitude_euler_async(10.0, lambda *_: None)
            angles = client.await_telemetry("attitude_euler", lambda _: True, within_s=20.0)
            if angles.timestamp_us < before.timestamp_us:
                break
            assert time.monotonic() < deadline
        assert param.get_param_float(name) == 9.0
        client.await_armable()
        client.action.arm()


def test_a_shutdown_ends_the_simulation_in_px4_style() -> None:
    with flying("px4") as client:
        client.await_armable()
        client.action.shutdown()
        deadline = time.monotonic() + 15.0
        while client.system.is_connected():
            assert time.monotonic() < deadline
            time.sleep(0.1)
