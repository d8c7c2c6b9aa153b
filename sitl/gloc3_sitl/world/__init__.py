"""Simulated worlds: position, ground, and camera views.

`world` reads a world file; cameras, scanners and probes observe it.
"""

from gloc3_sitl.world.world import World

__all__ = [
    "World",
    "camera",
    "depth_camera",
    "field_probe",
    "geometry",
    "imager",
    "laser",
    "placing",
    "probe",
    "rig",
    "tracker",
    "world",
]
