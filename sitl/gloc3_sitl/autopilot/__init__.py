"""The embedded autopilot: a flight controller in the style of PX4 or ArduPilot, without I/O and without a clock.

`autopilot` is stepped by the simulator; styles, control and behaviours are rooms of their own.
"""

__all__ = [
    "airframe",
    "autopilot",
    "craft",
    "mission",
    "modes",
    "onboard_files",
    "parameters",
    "periods",
    "pilot",
    "plans",
    "sources",
    "surroundings",
    "tuning",
    "vehicle_class",
    "verdict",
]
