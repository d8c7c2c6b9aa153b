"""The onboard process: logs, records, storage and the computer, besides links and components.

`gloc3_onboard.assembly` wires it.
"""

__all__ = [
    "computer",
    "event_narration",
    "journal",
    "log_files",
    "memory",
    "metrics",
    "options",
    "process",
    "run_log",
    "runner",
    "storage",
    "taps",
    "vitals",
]
