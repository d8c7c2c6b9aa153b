"""Simulated worlds: their place, their ground, and what a camera sees of them."""

from gloc3_sitl.world.world import World

__all__ = ["World"]
