"""A simulated vehicle in its world, for read-only use."""

from typing import Protocol

from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World


class Scene(Protocol):
    """Place of the vehicle, its time, and its surroundings."""

    @property
    def world(self) -> World:
        """Where it is."""

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""

    def truth(self) -> Truth:
        """What the vehicle really does now."""
