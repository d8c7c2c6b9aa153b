"""The vehicles that can be simulated, by name."""

from typing import Final

from gloc3_sitl.vehicles.model import MultirotorModel
from gloc3_sitl.vehicles.pelican import PELICAN

VEHICLES: Final = {"pelican": PELICAN}
"""Models by the name that platform files use."""

__all__ = ["PELICAN", "VEHICLES", "MultirotorModel"]
