"""The data log (DESIGN §10): MCAP files with crash-safe writing, reading of damaged files, plots and replay.

Recorders use `record`, all others read through `reader`; reports have their own package.
"""

__all__ = [
    "autopilot_log",
    "description",
    "disk_file",
    "fields",
    "foxglove",
    "info",
    "payloads",
    "reader",
    "record",
    "selection",
]
