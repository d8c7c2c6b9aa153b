"""Simulated sensors: noisy readings of the truth.

`suite` samples them together; each has a rate, a latency, noise and faults.
"""

__all__ = [
    "airspeed",
    "barometer",
    "battery",
    "compass",
    "depth",
    "dvl",
    "estimator",
    "fix",
    "gimbal",
    "imu",
    "magnetic_field",
    "noise",
    "range_finder",
    "readings",
    "sensor",
    "suite",
    "wheels",
]
