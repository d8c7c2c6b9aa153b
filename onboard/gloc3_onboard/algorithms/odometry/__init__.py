"""Dead reckoning, wheel odometry, and odometer reports composed into a pose.

Plain classes that receive the time.
"""

__all__ = ["chain", "dead_reckoner", "velocity_trust", "wheel_odometer"]
