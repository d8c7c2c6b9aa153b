"""Interface of a gimbal to the driver that points it."""

from math import pi
from typing import NamedTuple, Protocol

from gloc3.mavlink.message import Address


class GimbalTarget(NamedTuple):
    """Write: where a gimbal is to point, or how it is to turn."""

    pitch_rad: float = 0.0
    """From the horizon; with `is_rate` in rad/s."""
    yaw_rad: float = 0.0
    """Likewise, from the nose or from north."""
    is_from_north: bool = False
    """Whether the yaw is measured from north, and kept when the vehicle turns."""
    is_rate: bool = False
    is_neutral: bool = False
    """Go to the neutral position, whatever the angles are."""


class GimbalAttitude(NamedTuple):
    """Reported attitude."""

    t_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    is_from_north: bool
    """Whether the yaw is measured from north, else from the nose."""
    flags: int = 0
    """GIMBAL_DEVICE_FLAGS."""
    failures: int = 0
    """GIMBAL_DEVICE_ERROR_FLAGS."""


class GimbalProperties(NamedTuple):
    """What a gimbal can do."""

    device: int
    """Its MAVLink component, or the number by which its manager knows it."""
    pitch_limits_rad: tuple[float, float] = (-pi, pi)
    yaw_limits_rad: tuple[float, float] = (-pi, pi)
    """From the nose."""
    capability_flags: int = 0
    """GIMBAL_DEVICE_CAP_FLAGS."""
    manager: int = 0
    """MAVLink component of the manager that it belongs to; 0 if this process is its manager."""


class GimbalDevice(Protocol):
    """Interface of a gimbal. Nothing blocks, and all may be called from any thread."""

    own: Address
    """MAVLink address of this process, which owns the gimbal while an action points it."""

    def open(self) -> None:
        """Begins to look for a gimbal."""

    def properties(self) -> GimbalProperties | None:
        """The gimbal; None while none has been found."""

    def attitude(self) -> GimbalAttitude | None:
        """The latest attitude; None before the first."""

    def other_owner(self) -> str:
        """Who points it at another manager; empty for nobody, or this process."""

    def point(self, target: GimbalTarget) -> None:
        """Sends a target."""
