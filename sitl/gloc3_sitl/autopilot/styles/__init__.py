"""The two styles of autopilot: PX4's and ArduPilot's modes, parameters and behaviour, as data.

One file a style, with its parameters.
"""

__all__ = ["ardupilot", "ardusub", "plane", "px4", "px4_vtol", "quadplane", "rover"]
