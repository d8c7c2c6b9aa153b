"""The whole stack in one process on one virtual clock, for `gloc3 fly` and flight tests.

The only package that imports all three applications.
"""

__all__ = [
    "flight",
    "fly",
    "messages",
    "mission_file",
    "outputs",
    "path_error",
    "plan",
    "report",
    "sim_devices",
    "sim_imu",
    "sim_rig",
    "truth_log",
    "watch",
]
