"""What the stations are told of motion and place: in the platform's frame, in few bytes."""

from math import inf, isfinite, nan, radians
from typing import Any

import msgspec
import pytest

from gloc3.exchange.tunnel.events import Counters
from gloc3.exchange.tunnel.frames import Status
from gloc3.exchange.tunnel.layout import MAX_PAYLOAD
from gloc3.exchange.tunnel.status import StatusSender
from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.frames import from_euler
from gloc3.messages.motion import MotionSummary
from gloc3.messages.vehicle import AutopilotState, Pose, Setpoint
from gloc3.messages.wire import type_name
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform
from gloc3_onboard.command_server.summaries import motion_summary, site_summary, vehicle_summary
from gloc3_onboard.command_server.vehicle_state import KeptHome, VehicleState

ORIGIN = (39.5528, 2.6285, 2.0)
POSE = Pose(
    position_ned_m=(3.0, 1.0, -2.0),
    velocity_ned_m_s=(0.5, 0.0, -0.1),
    ned_from_frd=from_euler(radians(5.0), radians(-3.0), radians(-90.0)),
    position_std_m=(0.3, 0.1, 0.2),
    origin_geo=ORIGIN,
)


@pytest.fixture(scope="module")
def pelican() -> Platform:
    return load_platform("pelican_rtk")


def turned(platform: Platform, bearing_deg: float) -> Platform:
    frames = {
        name: msgspec.structs.replace(row, x_axis_bearing_deg=bearing_deg) for name, row in platform.frames.items()
    }
    return msgspec.structs.replace(platform, frames=frames)


def received(message: Pose | Setpoint, t_s: float) -> Envelope[Any]:
    return Envelope("pelican/x", Source("pelican", "x", 1), 0, t_s, "", type_name(type(message)), message)


def snapshot(platform: Platform, pose: Pose = POSE) -> VehicleState:
    found = VehicleState(platform, KeptHome((0.0, -1.0, 0.0), ORIGIN))
    found.update_pose(received(pose, 10.0))
    return found


def reported(platform: Platform, known: VehicleState, now_s: float = 10.0) -> MotionSummary:
    found = motion_summary(platform, known, now_s)
    assert found is not None
    return found


def test_motion_is_told_in_the_platforms_frame_and_in_hundredths(pelican: Platform) -> None:
    motion = reported(pelican, snapshot(pelican))
    assert motion.position_cm == (300, -100, 200)
    assert motion.velocity_cm_s == (50, 0, 10)
    assert motion.attitude_cdeg == (500, -300, 27000)
    assert motion.covariance_cm2 == (900, 0, 100)
    assert motion.height_std_cm == 20
    assert motion.is_pose_valid


def test_a_turned_frame_turns_position_velocity_and_covariance(pelican: Platform) -> None:
    east = turned(pelican, 90.0)
    motion = reported(east, snapshot(east))
    assert motion.position_cm == (100, 300, 200)
    assert motion.velocity_cm_s == (0, 50, 10)
    assert motion.covariance_cm2 == (100, 0, 900)
    north_east = turned(pelican, 45.0)
    assert reported(north_east, snapshot(north_east)).covariance_cm2 == (500, 400, 500)


def test_the_setpoint_is_told_while_it_is_flown(pelican: Platform) -> None:
    known = snapshot(pelican)
    assert reported(pelican, known).setpoint_cm is None
    wanted = Setpoint(action_id="a", position_ned_m=(4.0, 1.0, -2.5), velocity_ned_m_s=(0.5, 0.0, 0.0), yaw_rad=-0.1)
    known.update_setpoint(received(wanted, 10.0))
    motion = reported(pelican, known, 10.3)
    assert motion.setpoint_cm == (400, -100, 250)
    assert motion.setpoint_velocity_cm_s == (50, 0, 0)
    assert motion.setpoint_heading_cdeg == 35427
    assert reported(pelican, known, 10.6).setpoint_cm is None


def test_nothing_is_told_before_there_is_a_pose(pelican: Platform) -> None:
    empty = VehicleState(pelican, None)
    assert motion_summary(pelican, empty, 1.0) is None
    assert site_summary(pelican, empty) is None


def test_the_site_is_the_frame_on_earth_and_home(pelican: Platform) -> None:
    site = site_summary(pelican, snapshot(pelican))
    assert site is not None
    assert (site.frame, site.x_axis_bearing_deg, site.origin_geo) == ("hold", 0.0, ORIGIN)
    assert site.home_m == (0.0, 1.0, 0.0)
    elsewhere = snapshot(pelican, msgspec.structs.replace(POSE, origin_geo=(1.0, 2.0, 3.0)))
    unnamed = site_summary(pelican, elsewhere)
    assert unnamed is not None
    assert unnamed.frame == ""


def test_both_fit_one_frame_of_a_radio_far_from_the_origin(pelican: Platform) -> None:
    far = msgspec.structs.replace(POSE, position_ned_m=(5123.4, -4321.9, -812.3), position_std_m=(9.0, 8.0, 7.0))
    known = snapshot(turned(pelican, 33.0), far)
    known.home = KeptHome((123.45, -67.89, 1.23), ORIGIN)
    known.autopilot = AutopilotState(is_connected=True, battery_v=22.2, battery_a=31.4)
    point, speed = (5125.0, -4320.0, -800.0), (12.0, -11.0, 3.0)
    known.update_setpoint(
        received(Setpoint(action_id="a", position_ned_m=point, velocity_ned_m_s=speed, yaw_rad=3.0), 10.0)
    )
    messages = reported(pelican, known), site_summary(pelican, known)
    sender = StatusSender(Counters())
    for channel, message in enumerate(messages, start=200):
        assert message is not None
        source = Source("pelican", "command_server", 1)
        envelope = Envelope("pelican/ci/x", source, 100_000, 54_321.125, "", type_name(type(message)), message)
        sender.offer(channel, envelope)
        frame = sender.next_frame()
        assert isinstance(frame, Status)
        assert len(frame.encode(0xFFFFFFFF)) <= MAX_PAYLOAD


@pytest.mark.parametrize("wild", [nan, inf, -inf, 1e300])
def test_numbers_beyond_reason_are_told_as_something_that_can_be_told(pelican: Platform, wild: float) -> None:
    pose = msgspec.structs.replace(
        POSE,
        position_ned_m=(wild, 0.0, 0.0),
        velocity_ned_m_s=(0.0, wild, 0.0),
        ned_from_frd=(wild, 0.0, 0.0, wild),
        position_std_m=(wild, 1.0, wild),
    )
    known = snapshot(pelican, msgspec.structs.replace(POSE, position_std_m=(wild, 1.0, wild)))
    known.update_pose(received(pose, 10.0))
    known.update_setpoint(received(Setpoint(action_id="go", position_ned_m=(1.0, wild, 0.0), yaw_rad=0.0), 10.0))
    motion = reported(pelican, known)
    assert len(msgspec.msgpack.encode(motion)) < 300
    assert motion.position_cm[0] == (300 if not isfinite(wild) else 2**31 - 1)
    assert motion.setpoint_cm is None or abs(motion.setpoint_cm[1]) == 2**31 - 1
    assert vehicle_summary(pelican, known, 10.0).heading_deg in range(360)
