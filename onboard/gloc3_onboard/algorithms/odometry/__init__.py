"""Dead reckoning, wheel odometry, turns by gyros, and odometer reports composed into a pose.

Plain classes that receive the time.
"""

__all__ = ["chain", "dead_reckoner", "gyro_turn", "held_motion", "velocity_trust", "wheel_odometer"]
