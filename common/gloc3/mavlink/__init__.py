"""MAVLink: `codec` and `parser` turn bytes into frames and messages, `router` forwards frames, `signing` signs them.

`shell` is a vehicle's shell; `transport` carries the bytes; `services` are the microservices, plain objects without I/O that a `node` drives.
"""

__all__ = [
    "codec",
    "fair_share",
    "flight_modes",
    "message",
    "node",
    "outlet",
    "parser",
    "round_trip",
    "router",
    "service",
    "shell",
    "signing",
    "signing_key",
    "tlog",
]
