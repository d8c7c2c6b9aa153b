"""MAVLink: `codec` and `parser` turn bytes into frames and messages, `router` passes frames on between links, `signing` signs them.

`transport` carries the bytes; `services` are the microservices, driven by a `node` as plain objects without I/O.
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
    "signing",
    "signing_key",
    "tlog",
]
