"""Component 191 for other people's software: commands, missions, parameters, files, metadata, control.

Other ground stations use component 191; `routing` forwards MAVLink, `station_link` carries our command link.
"""

__all__ = [
    "acoustic_link",
    "autopilot_reporter",
    "cameras",
    "companion",
    "files",
    "landing_watchdog",
    "link_rights",
    "link_watch",
    "parameter_table",
    "routing",
    "station_link",
]
