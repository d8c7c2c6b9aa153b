"""Poses of the vehicle and its mounted devices in the frame of a world."""

from math import radians
from typing import Final, NamedTuple

from gloc3.messages.frames import Quaternion, Vector3, conjugate, from_euler, from_rotation_vector, multiply, rotate
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world.world import World


class WorldPlacement(NamedTuple):
    """A place and the axes there."""

    local_from_here: Quaternion
    """Rotation of those axes to the world's (x, y, height)."""
    position_m: Vector3
    """`[x, y, height]`."""

    def mounted(self, position_m: Vector3, here_from_there: Quaternion) -> "WorldPlacement":
        """Placement of an object mounted at a position and attitude in these axes."""
        x, y, height = self.position_m
        dx, dy, dz = rotate(self.local_from_here, position_m)
        return WorldPlacement(multiply(self.local_from_here, here_from_there), (x + dx, y + dy, height + dz))


class Placing:
    """Finds the place of a vehicle's centre of gravity, with the axes of its body."""

    def __init__(self, world: World) -> None:
        self._world: Final = world
        # Local axes are those of NED turned by the bearing, then half a turn about x.
        bearing = from_euler(0.0, 0.0, radians(world.frame.x_axis_bearing_deg))
        self.local_from_ned: Final = conjugate(multiply(bearing, (0.0, 1.0, 0.0, 0.0)))
        """Rotation of the NED of the world's frame to its own axes."""

    def body(self, truth: Truth, later_s: float = 0.0) -> WorldPlacement:
        """The place at a truth, or a moment later or earlier, at the truth's speed and turn rate."""
        x, y, height = self._world.local(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
        local_from_frd = multiply(self.local_from_ned, truth.attitude_wxyz)
        height += truth.standing_height_m
        if later_s == 0.0:
            return WorldPlacement(local_from_frd, (x, y, height))
        vx, vy, vz = rotate(self.local_from_ned, truth.velocity_ned_m_s)
        p, q, r = truth.rate_frd_rad_s
        turned = multiply(local_from_frd, from_rotation_vector((p * later_s, q * later_s, r * later_s)))
        return WorldPlacement(turned, (x + vx * later_s, y + vy * later_s, height + vz * later_s))
