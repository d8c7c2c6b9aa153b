"""The onboard process: logs, records, storage and the computer, besides links and components.

`gloc3_onboard.assembly` wires it.
"""

__all__ = [
    "computer",
    "event_narration",
    "log_files",
    "memory",
    "options",
    "process",
    "run_log",
    "runner",
    "storage",
    "taps",
    "vitals",
]
