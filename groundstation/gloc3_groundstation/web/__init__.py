"""The station in a browser, and the live view for Foxglove.

Both are view servers on loopback unless an address is given.
"""

__all__ = ["live_view", "server", "terminal_view"]
