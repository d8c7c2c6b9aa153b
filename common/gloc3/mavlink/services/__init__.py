"""The MAVLink microservices, client and server beside each other, without I/O and told the time.

Missions, parameters, files, logs, commands, calibration, time, versions, heartbeats and status texts.
"""
