"""The autopilot's MAVLink front end: links, streams, commands and setpoints."""
