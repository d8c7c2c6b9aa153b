"""The processes and hosts of a platform: start, management, time and supervision.

`host_process` runs on every other computer, `child_main` in child processes; `other_processes` is the clock host's
side.
"""

__all__ = ["host_process", "loop", "other_processes", "shared"]
