"""The station's terminal: it renders snapshots of the fleet. Nothing here knows MAVLink; nothing outside knows Textual.

`app` is opened by the session; `screen` and `view` are what every screen is made of.
"""

__all__ = ["app", "keys", "screen", "view"]
