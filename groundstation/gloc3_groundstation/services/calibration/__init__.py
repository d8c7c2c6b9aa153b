"""Calibration of a vehicle: sensors, transmitter and ESCs, step by step.

`calibrations` starts them, the other modules are the procedures that the station itself leads.
"""

__all__ = ["calibrations"]
