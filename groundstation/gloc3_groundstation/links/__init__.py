"""The station's links: MAVLink over any transport, other stations, the network of platforms, acoustic modems.

Exactly one station heartbeat is sent on each link.
"""

__all__ = ["acoustic_route", "forwarding", "link", "link_snapshot", "links", "network_route", "vehicle_wire"]
