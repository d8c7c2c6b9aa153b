"""The onboard process: what it holds open besides links and components: logs, records, storage, the computer itself.

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
