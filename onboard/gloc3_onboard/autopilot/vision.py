"""External vision: our pose as the MAVLink message of PX4 and ArduPilot, and the origin of its frame.

Frames: ArduPilot accepts only MAV_FRAME_LOCAL_FRD with a velocity in MAV_FRAME_BODY_FRD. PX4 accepts these too, but
takes
its heading only from MAV_FRAME_LOCAL_NED. The x axis of our frame points north, so both apply. The estimator type is
VIO for every source of the pose, since PX4 refuses others.
"""

from typing import Final, NamedTuple

from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.frames import Vector3, rotate_back
from gloc3.messages.vehicle import Pose

BODY_FRD: Final = 12
VIO: Final = 3
_ROWS: Final = (0, 6, 11, 15, 18, 20)
"""Places of the diagonal in the upper triangle of a 6 by 6 matrix, rows first."""


class Spread(NamedTuple):
    """Standard deviations that a `Pose` does not contain."""

    attitude_rad: float = 0.02
    velocity_m_s: float = 0.05


def odometry_message(pose: Pose, boot_us: int, spread: Spread, frame: int) -> MavlinkMessage:
    """ODOMETRY of a valid pose.

    Args:
        pose: pose in the platform's NED frame.
        boot_us: its time of validity on the autopilot's clock, in microseconds since boot.
        spread: standard deviations that the pose lacks.
        frame: MAV_FRAME of the position for the autopilot's family.
    """
    n, e, d = pose.position_ned_m
    forward, right, down = rotate_back(pose.ned_from_frd, pose.velocity_ned_m_s)
    p, q, r = pose.rate_frd_rad_s
    attitude, velocity = spread.attitude_rad**2, spread.velocity_m_s**2
    return codec.message(
        "ODOMETRY",
        time_usec=boot_us,
        frame_id=frame,
        child_frame_id=BODY_FRD,
        x=n,
        y=e,
        z=d,
        q=pose.ned_from_frd,
        vx=forward,
        vy=right,
        vz=down,
        rollspeed=p,
        pitchspeed=q,
        yawspeed=r,
        pose_covariance=_triangle(pose.position_std_m, attitude),
        velocity_covariance=_triangle((spread.velocity_m_s,) * 3, velocity),
        reset_counter=pose.reset_counter % 256,
        estimator_type=VIO,
        quality=min(max(round(100.0 * pose.quality), 1), 100),
    )


def origin_message(origin_geo: tuple[float, float, float], target: Address) -> MavlinkMessage:
    """SET_GPS_GLOBAL_ORIGIN: without satellites the autopilot cannot know its origin, and does not arm."""
    latitude, longitude, altitude = origin_geo
    return codec.message(
        "SET_GPS_GLOBAL_ORIGIN",
        target_system=target.system,
        latitude=round(latitude * 1e7),
        longitude=round(longitude * 1e7),
        altitude=round(altitude * 1e3),
    )


def _triangle(deviations: Vector3, rest: float) -> tuple[float, ...]:
    numbers = [0.0] * 21
    for row, deviation in zip(_ROWS[:3], deviations, strict=True):
        numbers[row] = deviation * deviation
    for row in _ROWS[3:]:
        numbers[row] = rest
    return tuple(numbers)
