"""Transports of MAVLink bytes: UDP, TCP, serial lines and memory.

`endpoints` opens any of them by its URL, as MAVSDK writes them.
"""

__all__ = ["endpoints", "memory", "serial_line"]
