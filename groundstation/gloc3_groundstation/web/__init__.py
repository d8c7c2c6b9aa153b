"""The station in a browser, and the live view for Foxglove.

Both are view servers on loopback unless an address is given.
"""

__all__ = ["access", "certificate", "live_view", "map_view", "server", "terminal_view", "tiles"]
