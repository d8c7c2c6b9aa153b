"""Dead reckoning and wheel odometry, and odometer reports put end to end.

Plain classes, told the time.
"""

__all__ = ["chain", "dead_reckoner", "velocity_trust", "wheel_odometer"]
