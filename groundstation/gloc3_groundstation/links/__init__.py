"""The station's links: MAVLink over any transport, the network of platforms, acoustic modems.

One heartbeat leaves on a link, whoever uses it.
"""

__all__ = ["acoustic_way", "link", "link_snapshot", "links", "network_way"]
