"""The autopilot behind MAVLink: `link` holds the conversation with it, `device` is what samplers and drivers use.

`ardupilot` and `px4` are tables of what differs between the families and their vehicle classes.
"""

__all__ = [
    "arm_authority",
    "device",
    "families",
    "health_words",
    "link",
    "link_reports",
    "sensors",
    "signing_setup",
    "telemetry",
]
