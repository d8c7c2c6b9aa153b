"""Messages for the tests of the onboard components: short ways to say where a vehicle is and what it is doing."""

import itertools
from typing import Any, TypeVar

from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.frames import Quaternion, Vector3
from gloc3.messages.vehicle import (
    AutopilotPose,
    AutopilotState,
    FlightMode,
    LandedState,
    MotionGrant,
    MotionLimits,
    Pose,
    Setpoint,
    Style,
)

M = TypeVar("M", bound=Message)

LEVEL: Quaternion = (1.0, 0.0, 0.0, 0.0)
LIMITS = MotionLimits(
    speed_m_s=3.0,
    climb_m_s=1.0,
    acceleration_m_s2=2.5,
    height_min_m=0.3,
    height_max_m=30.0,
    home_ned_m=(0.0, 0.0, 0.0),
)
SOURCE = Source("bench", "test", 0)
_sequence = itertools.count()


def at(t_s: float, message: M, topic: str = "") -> Envelope[M]:
    """A message in its envelope."""
    return Envelope(topic, SOURCE, next(_sequence), t_s, "", type(message).__name__, message)


def pose(north: float = 0.0, east: float = 0.0, height: float = 2.0, **fields: Any) -> Pose:
    """Where the vehicle is; at rest unless said otherwise."""
    values = {"velocity_ned_m_s": (0.0, 0.0, 0.0), "ned_from_frd": LEVEL, **fields}
    return Pose(position_ned_m=(north, east, -height), **values)


def autopilot_pose(north: float = 0.0, east: float = 0.0, height: float = 2.0, **fields: Any) -> AutopilotPose:
    """The autopilot's own estimate."""
    values = {"velocity_ned_m_s": (0.0, 0.0, 0.0), "ned_from_frd": LEVEL, "rate_frd_rad_s": (0.0, 0.0, 0.0), **fields}
    return AutopilotPose(position_ned_m=(north, east, -height), **values)


def flying(mode: FlightMode = FlightMode.HOLD, **fields: Any) -> AutopilotState:
    """An autopilot in the air."""
    values = {"is_armed": True, "landed": LandedState.IN_AIR, "mode_name": str(mode), **fields}
    return AutopilotState(is_connected=True, style=Style.PX4, mode=mode, **values)


def standing(mode: FlightMode = FlightMode.HOLD, **fields: Any) -> AutopilotState:
    """An autopilot on the ground, disarmed and armable."""
    return flying(mode, **{"is_armed": False, "landed": LandedState.ON_GROUND, "is_armable": True, **fields})


def setpoint(
    position: Vector3 | None = (0.0, 0.0, -2.0), velocity: Vector3 | None = None, owner: str = "go", yaw: float = 0.0
) -> Setpoint:
    """A setpoint of an owner."""
    return Setpoint(action_id=owner, position_ned_m=position, velocity_ned_m_s=velocity, yaw_rad=yaw)


def grant(owner: str = "go", component: str = "waypoints") -> MotionGrant:
    """Motion for an owner."""
    return MotionGrant(action_id=owner, component=component)
