"""The vehicle services as lines: parameters, plans, calibration, lists.

Pure functions of a view.
"""

__all__ = ["calibration", "frame", "lists", "parameters", "plans"]
