"""The autopilot's own log of a flight, in the format of its family.

Others use `flight_log`, which writes it; `ulog` and `dataflash` are the formats of PX4 and ArduPilot for `records`.
"""

__all__ = ["dataflash", "flight_log", "records", "ulog"]
