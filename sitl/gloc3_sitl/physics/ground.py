"""Ground height under a simulated vehicle, from the world."""

from typing import Final

from gloc3_sitl.physics.body import VehicleBody
from gloc3_sitl.world import World

PERIOD_STEPS: Final = 10
"""Physics steps between two ground samples."""
_STEP_UP_M: Final = 0.3
"""What is higher above the vehicle than this is not ground that it has sunk into, but something that it is under."""


def raise_ground(body: VehicleBody, world: World, now_s: float, *, is_diving: bool = False) -> None:
    """Brings the ground under the vehicle to the height of the box or slope below it.

    Args:
        body: the vehicle.
        world: where it is.
        now_s: the time.
        is_diving: the ground is the floor of the water.
    """
    truth = body.truth()
    x, y, height = world.local(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
    lowest_m = world.water.floor_m if is_diving else 0.0
    ground_m = world.height_at(x, y, now_s, height + _STEP_UP_M, lowest_m)
    body.set_ground(world.frame.origin.altitude_m + ground_m)
