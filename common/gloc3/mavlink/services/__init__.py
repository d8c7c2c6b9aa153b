"""The MAVLink microservices, client and server beside each other, without I/O or a clock of their own.

Missions, parameters, files, logs, commands, calibration, corrections, time, versions, heartbeats and status texts.
"""

__all__ = [
    "calibration",
    "calibration_ardupilot",
    "calibration_px4",
    "command",
    "command_client",
    "command_server",
    "corrections",
    "heartbeat",
    "interval",
    "mission_client",
    "mission_server",
    "mission_transfers",
    "parameter",
    "parameter_client",
    "parameter_server",
    "plan",
    "statustext",
    "timesync",
    "version",
]
