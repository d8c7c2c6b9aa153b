"""The simulated vehicles: their models and the table of all of them.

`table` has a row for each vehicle, `simulator` advances one with its autopilot.
"""

from typing import Final

from gloc3_sitl.vehicles.hummingbird import HUMMINGBIRD
from gloc3_sitl.vehicles.model import MultirotorModel
from gloc3_sitl.vehicles.pelican import PELICAN

MULTIROTORS: Final = {"pelican": PELICAN, "hummingbird": HUMMINGBIRD}
"""Models by name."""

__all__ = [
    "HUMMINGBIRD",
    "MULTIROTORS",
    "PELICAN",
    "MultirotorModel",
    "dvl_server",
    "fixed_wing_model",
    "ground_model",
    "lift_rotor_model",
    "line_server",
    "scene",
    "sensor_server",
    "simulator",
    "surface_model",
    "table",
    "underwater",
]
