"""The station's links: MAVLink over any transport, the network of platforms, acoustic modems.

One heartbeat leaves on a link, whoever uses it.
"""
