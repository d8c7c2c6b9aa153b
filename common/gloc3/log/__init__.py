"""The data log (DESIGN §10): MCAP files with crash-safe writing, reading of damaged files, plots and replay.

Recorders use `record`, all others read through `reader`; reports have their own package.
"""

__all__ = [
    "autopilot_log",
    "description",
    "disk_file",
    "fields",
    "info",
    "json_schema",
    "payloads",
    "pictures",
    "reader",
    "record",
    "selection",
    "sending",
]
