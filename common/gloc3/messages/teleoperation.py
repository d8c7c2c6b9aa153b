"""Teleoperation: the velocity that an operator requests, at 10 Hz, and the vehicle's response.

Topics, below the platform's name: `velocity_demand` (station to platform; `demand/STATION` on the network),
`motion_demand` (the command interface server to the controller), `ci/teleoperation` (the controller to the stations).

A demand is best effort: only the newest is used, none is stored or repeated, and each expires after `EXPIRES_S`.
"""

from typing import Final

from gloc3.messages.command_interface import StationRole
from gloc3.messages.envelope import Message

DEMAND_HZ: Final = 10.0
"""How often a station sends the demand while the operator keeps the dead-man's key."""
EXPIRES_S: Final = 0.5
"""A demand that is older is none: the vehicle comes to rest and keeps its place."""

Velocity = tuple[int, int, int]
"""Surge (ahead), sway (to the right), heave (up), in cm/s: in the level frame that turns with the vehicle's heading."""
AT_REST: Final[Velocity] = (0, 0, 0)


class VelocityDemand(Message, frozen=True):
    """Requested velocity of the vehicle."""

    sender: str
    """The station's id."""
    session: int
    """A random number (32 bits) for each time that an operator takes to the keys; sequences count within it."""
    sequence: int
    velocity_cm_s: Velocity = AT_REST
    yaw_rate_cdeg_s: int = 0
    """Clockwise, in hundredths of degrees a second."""
    role: StationRole = StationRole.OPERATOR
    """Its sender's; set by the platform's end of the link that brought it, whatever was sent."""
    way: str = ""
    """How it came: set there too."""
    member: str = ""
    """Of the network: whose rights it has; set there too."""


class TeleoperationState(Message, frozen=True):
    """Response of the vehicle to the demands, published while the action `teleoperate` is under way."""

    t_s: float
    action_id: str
    is_live: bool
    """The last demand has not expired."""
    session: int
    """Of the last demand that was taken; 0 before the first."""
    sequence: int
    """And its number; -1 before the first."""
    velocity_cm_s: Velocity
    """What is wanted now: within the limits, at rest where nothing is live."""
    measured_cm_s: Velocity
    yaw_rate_cdeg_s: int
    """What is wanted now."""
    measured_yaw_rate_cdeg_s: int
    reason: str = ""
    """Why it does not follow the demand."""
