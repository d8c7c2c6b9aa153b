"""Setpoints from the modes to the control loops: one every 20 ms, in NED or as an attitude."""

from math import nan
from typing import Final

import msgspec

from gloc3.messages.frames import Quaternion, Vector3

FREE: Final[Vector3] = (nan, nan, nan)
"""No wish in any axis."""


class MotionSetpoint(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Position, velocity and acceleration, each axis of each either a number or NaN for "no wish".

    A velocity beside a position is fed forward; a velocity alone is flown. An axis without position and velocity is
    flown by acceleration alone.
    """

    position_ned_m: Vector3 = FREE
    velocity_ned_m_s: Vector3 = FREE
    acceleration_ned_m_s2: Vector3 = (0.0, 0.0, 0.0)
    yaw_rad: float = nan
    """Heading clockwise from north; NaN keeps the heading, or turns it by the rate."""
    yaw_rate_rad_s: float = 0.0
    is_landed: bool = False
    """Landed with motors idling; only rates are controlled."""


class AttitudeSetpoint(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """An attitude with a thrust, or body rates with a thrust."""

    ned_from_frd: Quaternion | None = None
    """Wanted attitude; None flies the rates alone."""
    rate_frd_rad_s: Vector3 = (0.0, 0.0, 0.0)
    thrust: float = 0.0
    """Collective thrust, 0..1 of full."""


class DriveSetpoint(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """A speed and a heading, for what cannot go sideways; or throttle and steering as they are."""

    speed_m_s: float = 0.0
    """Forward; negative drives backwards."""
    heading_rad: float = nan
    """Clockwise from north; NaN turns by the rate alone."""
    turn_rate_rad_s: float = 0.0
    is_at_rest: bool = False
    """At zero speed: the drives stop once the vehicle stands."""
    is_direct: bool = False
    """Throttle and steering go to the drives as they are."""
    throttle: float = 0.0
    """-1 to 1."""
    steering: float = 0.0
    """Right positive, -1 to 1."""


class WingSetpoint(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Bank, height and airspeed for flight on wings, or direct values for parts of them."""

    roll_rad: float = 0.0
    """To the right."""
    down_m: float = nan
    """Height wanted, as NED down; NaN where only the climb is."""
    climb_m_s: float = 0.0
    """How fast that height changes."""
    airspeed_m_s: float = nan
    """NaN is that of cruise."""
    pitch_rad: float = nan
    """NaN leaves it to the balance of energy."""
    throttle: float = nan
    """0 to 1; NaN leaves it to the sum of energy."""
    heading_rad: float = nan
    """Heading steered by the rudder on the ground, rad; NaN in flight."""
    is_direct: bool = False
    """Sticks go to the rudders as they are."""
    aileron: float = 0.0
    elevator: float = 0.0
    rudder: float = 0.0
    """-1 to 1: right, nose up, nose right."""


Setpoint = MotionSetpoint | AttitudeSetpoint | DriveSetpoint | WingSetpoint

LANDED: Final = MotionSetpoint(is_landed=True)
"""Motors idle on the ground."""
