"""Real autopilot firmwares on GLOC3's physics, sensors and worlds.

`run` serves a real firmware in wall time, `in_step` in the clock of a flight.
"""

__all__ = ["body", "in_step", "run"]
