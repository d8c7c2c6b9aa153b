"""Component 191 for other people's software: commands, missions, parameters, files, metadata, control.

Stations of others use component 191; `routing` passes MAVLink on, `station_link` carries our own command link.
"""

__all__ = [
    "acoustic_link",
    "autopilot_reporter",
    "companion",
    "files",
    "link_watch",
    "parameter_table",
    "routing",
    "station_link",
]
