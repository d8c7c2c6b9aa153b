"""Autopilots behind MAVLink: what PX4 and ArduPilot have in common, and where they differ."""
