"""Dead reckoning, wheel odometry, and odometer reports composed into a pose.

Plain classes, told the time.
"""

__all__ = ["chain", "dead_reckoner", "velocity_trust", "wheel_odometer"]
