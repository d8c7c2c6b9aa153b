"""Where the body was, and how it moved, during a measurement: from the pose and the height at that time."""

import math
from typing import Annotated, NamedTuple

from gloc3.component.settings import Bounds, Settings
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, rotate_back, to_euler
from gloc3.messages.perception import LaserScan
from gloc3.messages.vehicle import HeightAboveGround, Pose
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Mount, Tilt, Twist


class PlacementSettings(Settings, frozen=True):
    """Settings of every component that places what was measured."""

    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = 0.25
    """A pose that is older than this at the time of a scan does not count."""
    height_limit_s: Annotated[float, Bounds(0.05, 5.0)] = 0.5
    """A height that is older does not count; without one, the floor may be taken for an obstacle when the body tilts."""


class ScanPlacementSettings(PlacementSettings, frozen=True):
    """Settings of every component that places scans."""

    mount_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the scanner on the body, in metres."""
    mount_yaw_deg: Annotated[float, Bounds(-180.0, 180.0)] = 0.0
    """Direction of its middle beam, clockwise from ahead, in degrees."""

    @property
    def mount(self) -> Mount:
        """How the scanner is mounted."""
        return Mount(self.mount_frd_m, math.radians(self.mount_yaw_deg))


class ScanPlacement(NamedTuple):
    """The body at the end of a scan."""

    tilt: Tilt
    pose: Planar
    """North, east, heading."""
    motion: Planar
    """During the scan, in the axes of the body."""
    height_m: float
    """Above the origin of the pose's frame."""
    twist: Twist


def place_scan(
    scan: Envelope[LaserScan],
    pose: Envelope[Pose] | None,
    height: Envelope[HeightAboveGround] | None,
    settings: PlacementSettings,
) -> ScanPlacement | None:
    """Where the body was at a scan; None where there is no valid pose at that time."""
    return place_body(scan.t_s, pose, height, settings, scan.payload.duration_s)


def place_body(
    t_s: float,
    pose: Envelope[Pose] | None,
    height: Envelope[HeightAboveGround] | None,
    settings: PlacementSettings,
    duration_s: float = 0.0,
) -> ScanPlacement | None:
    """Where the body was at a time, and how it moved in the `duration_s` before; None without a valid pose of that time."""
    if pose is None or not pose.payload.is_valid or abs(t_s - pose.t_s) > settings.pose_limit_s:
        return None
    place = pose.payload
    roll, pitch, yaw = to_euler(place.ned_from_frd)
    above_m = None
    if height is not None and height.payload.is_valid and t_s - height.t_s <= settings.height_limit_s:
        above_m = height.payload.height_m * math.cos(roll) * math.cos(pitch)
    later_s = t_s - pose.t_s
    north, east, down = (
        at + speed * later_s for at, speed in zip(place.position_ned_m, place.velocity_ned_m_s, strict=True)
    )
    rate = place.rate_frd_rad_s[2]
    velocity_frd_m_s = rotate_back(place.ned_from_frd, place.velocity_ned_m_s)
    forward, right, _ = velocity_frd_m_s
    return ScanPlacement(
        Tilt(roll, pitch, above_m),
        Planar(north, east, yaw + rate * later_s),
        Planar(forward, right, rate).part(duration_s),
        -down,
        Twist(velocity_frd_m_s, place.rate_frd_rad_s),
    )
