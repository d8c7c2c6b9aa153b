"""How the vehicle moves and where its frame lies, in few bytes, for the map and the charts of the stations."""

from functools import lru_cache
from math import degrees, isfinite
from typing import Final

from gloc3.messages.frames import GeoPoint, LocalFrame, Vector3, to_euler
from gloc3.messages.motion import MotionSummary, SiteSummary, Whole3
from gloc3.messages.vehicle import Pose
from gloc3.platform.platform import Platform
from gloc3_onboard.command_server.facts import VehicleFacts

SETPOINT_OLD_S: Final = 0.5
"""A setpoint that is older is no longer flown: the driver has stopped."""
LARGEST: Final = 2**31 - 1
"""Whole numbers are told no larger than this, some 21,000 km."""
UNPLACED: Final = LocalFrame(GeoPoint(0.0, 0.0, 0.0))
"""North, west, height: what is told where no frame of the platform begins at the origin of NED."""


def local_frame(platform: Platform, pose: Pose) -> tuple[str, LocalFrame]:
    """The platform's frame whose origin is that of NED; without a name where it has none there."""
    for name, row in platform.frames.items():
        if row.origin.geo == pose.origin_geo:
            return name, _frame(*row.origin.geo, row.x_axis_bearing_deg)
    return "", UNPLACED


def motion_summary(platform: Platform, facts: VehicleFacts, now_s: float) -> MotionSummary | None:
    """How the vehicle moves; None while there is no pose."""
    pose = facts.pose
    if pose is None:
        return None
    _, frame = local_frame(platform, pose)
    roll, pitch, yaw = to_euler(pose.ned_from_frd)
    setpoint = facts.setpoint if now_s - facts.setpoint_s <= SETPOINT_OLD_S else None
    position, velocity, heading = None, None, None
    if setpoint is not None:
        position = None if setpoint.position_ned_m is None else _hundredths(frame, setpoint.position_ned_m)
        velocity = None if setpoint.velocity_ned_m_s is None else _hundredths(frame, setpoint.velocity_ned_m_s)
        heading = None if setpoint.yaw_rad is None else _cdeg(setpoint.yaw_rad) % 36000
    autopilot = facts.autopilot
    return MotionSummary(
        t_s=round(now_s, 3),
        attitude_cdeg=(_cdeg(roll), _cdeg(pitch), _cdeg(yaw) % 36000),
        position_cm=_hundredths(frame, pose.position_ned_m),
        velocity_cm_s=_hundredths(frame, pose.velocity_ned_m_s),
        is_pose_valid=facts.is_pose_fresh(now_s),
        setpoint_cm=position,
        setpoint_velocity_cm_s=velocity,
        setpoint_heading_cdeg=heading,
        covariance_cm2=_covariance_cm2(frame, pose.position_std_m),
        height_std_cm=_whole(100.0 * pose.position_std_m[2]),
        battery_cv=_whole(100.0 * autopilot.battery_v) if autopilot is not None else 0,
        battery_ca=_whole(100.0 * autopilot.battery_a) if autopilot is not None else 0,
    )


def site_summary(platform: Platform, facts: VehicleFacts) -> SiteSummary | None:
    """Where the frame lies; None while there is no pose."""
    if facts.pose is None:
        return None
    name, frame = local_frame(platform, facts.pose)
    home = None
    if facts.home_ned_m is not None:
        x, y, height = frame.from_ned(facts.home_ned_m)
        home = round(x, 2), round(y, 2), round(height, 2)
    return SiteSummary(
        frame=name, x_axis_bearing_deg=frame.x_axis_bearing_deg, origin_geo=facts.pose.origin_geo, home_m=home
    )


@lru_cache(maxsize=16)
def _frame(latitude_deg: float, longitude_deg: float, altitude_m: float, bearing_deg: float) -> LocalFrame:
    return LocalFrame(GeoPoint(latitude_deg, longitude_deg, altitude_m), bearing_deg)


def _hundredths(frame: LocalFrame, vector_ned: Vector3) -> Whole3:
    x, y, height = frame.from_ned(vector_ned)
    return _whole(100.0 * x), _whole(100.0 * y), _whole(100.0 * height)


def _cdeg(angle_rad: float) -> int:
    return _whole(100.0 * degrees(angle_rad))


def _whole(value: float) -> int:
    """The nearest whole number that can be told; 0 for what is no number."""
    return round(min(max(value, -LARGEST), LARGEST)) if isfinite(value) else 0


def _covariance_cm2(frame: LocalFrame, std_ned_m: Vector3) -> Whole3 | None:
    """Standard deviations north and east as the covariance of x and y; None where they are not known."""
    if std_ned_m[0] <= 0.0 and std_ned_m[1] <= 0.0:
        return None
    cosine, sine, _ = frame.from_ned((1.0, 0.0, 0.0))
    north, east = 1e4 * std_ned_m[0] * std_ned_m[0], 1e4 * std_ned_m[1] * std_ned_m[1]
    xx, yy = cosine**2 * north + sine**2 * east, sine**2 * north + cosine**2 * east
    return _whole(xx), _whole(cosine * sine * (north - east)), _whole(yy)
