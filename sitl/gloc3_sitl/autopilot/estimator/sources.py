"""Aiding sources of the estimate, their measurements and their states."""

from dataclasses import dataclass
from typing import Final

import msgspec

from gloc3.messages.frames import GeoPoint, Vector3


class AidingSource:
    """Bits of the aiding sources of the inertial solution; each can be enabled and disabled in flight.

    They are plain integers: the operators of `IntFlag` would be expensive in the inner loops.
    """

    FIX: Final = 1
    """Satellite fix: position, velocity, height."""
    BAROMETER: Final = 2
    MAGNETOMETER: Final = 4
    EXTERNAL_POSITION: Final = 8
    """Horizontal position of external odometry."""
    EXTERNAL_HEIGHT: Final = 16
    EXTERNAL_VELOCITY: Final = 32
    EXTERNAL_YAW: Final = 64
    RANGE_HEIGHT: Final = 128
    """The range finder as height, over flat ground."""
    DEPTH: Final = 256
    """The barometer as the only height, under water: satellites provide none."""


DEFAULT_SOURCES: Final = AidingSource.FIX | AidingSource.BAROMETER | AidingSource.MAGNETOMETER


@dataclass(slots=True)
class AidingState:
    """State of an aiding source."""

    accepted_s: float = -1e9
    """Time of the last accepted measurement."""
    refused_since_s: float | None = None
    """Since when its measurements have failed the gate without a break."""
    refused_s: float = -1e9
    """Time of the last refused one."""
    accepted: int = 0
    """Number of accepted measurements."""
    test_ratio: float = 0.0
    """Last squared innovation over its gate; above 1 it was refused."""

    def judge(self, ratio: float, now_s: float) -> bool:
        """Books a measurement; true where it passes."""
        self.test_ratio = ratio
        if ratio <= 1.0:
            self.accepted_s = now_s
            self.accepted += 1
            self.refused_since_s = None
            return True
        self.refused_s = now_s
        if self.refused_since_s is None:
            self.refused_since_s = now_s
        return False

    def is_stuck(self, now_s: float) -> bool:
        """Whether rejections have lasted so long that the estimate, not the source, must be wrong."""
        return self.refused_since_s is not None and now_s - self.refused_since_s > 1.5


class Fix(msgspec.Struct, frozen=True, kw_only=True):
    """A satellite fix, already free of the receiver's own format."""

    t_s: float
    """Time of validity."""
    place: GeoPoint
    velocity_ned_m_s: Vector3
    horizontal_accuracy_m: float
    vertical_accuracy_m: float
    speed_accuracy_m_s: float
    fix_type: int
    """As in GPS_RAW_INT: 3 = 3D, 6 = RTK fixed."""
    satellites: int


USUAL_DEVIATION: Final = 0.1
"""Of odometry that comes without a deviation."""


class ExternalOdometry(msgspec.Struct, frozen=True, kw_only=True):
    """Position, velocity and heading from outside, in the estimator's NED (or turned by an unknown heading: then without yaw)."""

    t_s: float
    position_ned_m: Vector3 | None = None
    velocity_ned_m_s: Vector3 | None = None
    yaw_rad: float | None = None
    yaw_is_from_north: bool = True
    """False where the heading counts from the odometer's own frame."""
    position_deviation_m: float = USUAL_DEVIATION
    velocity_deviation_m_s: float = USUAL_DEVIATION
    reset_counter: int = 0
