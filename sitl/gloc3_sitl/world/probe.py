"""Range of a downward range finder in a world."""

from typing import Final

from gloc3.messages.frames import IDENTITY, rotate
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world.placing import Placing
from gloc3_sitl.world.world import World


class WorldProbe:
    """Distance along the body's down axis to the first surface or box."""

    def __init__(self, world: World) -> None:
        self._geometry: Final = world.geometry
        self._placing: Final = Placing(world)

    def __call__(self, truth: Truth, below_m: float) -> float:
        """The distance from so far below the centre of gravity; infinity if there is nothing."""
        place = self._placing.body(truth).mounted((0.0, 0.0, below_m), IDENTITY)
        beam = rotate(place.local_from_here, (0.0, 0.0, 1.0))
        return self._geometry.range_m(place.position_m, beam, truth.t_s)
