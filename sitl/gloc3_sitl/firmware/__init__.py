"""Real autopilot firmwares on GLOC3's physics, sensors and worlds.

`run` serves a real firmware in wall time, `in_step` in a flight's virtual time.
"""

__all__ = ["body", "in_step", "run"]
