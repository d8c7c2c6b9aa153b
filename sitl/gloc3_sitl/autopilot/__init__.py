"""The embedded autopilot: a flight controller in the style of PX4 or of ArduPilot, without I/O and told the time.

`autopilot` is stepped by the simulator; styles, control and behaviours are rooms of their own.
"""
