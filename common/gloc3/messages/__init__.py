"""Messages: the envelope, the messages of vehicles, perception and the command interface, and topics as rows of data.

Units, frames and the wire format stand beside them. Nothing here does I/O.
"""

__all__ = [
    "command_interface",
    "envelope",
    "frames",
    "hosts",
    "link_traffic",
    "motion",
    "neighbours",
    "perception",
    "preflight",
    "readiness",
    "software",
    "standard_topics",
    "status_fields",
    "summaries",
    "teleoperation",
    "topics",
    "units",
    "vehicle",
    "watch",
    "wire",
]
