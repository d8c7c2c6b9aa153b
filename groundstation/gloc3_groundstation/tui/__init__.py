"""The station's terminal: it renders snapshots of the fleet. It is independent of MAVLink, and only it uses Textual.

The session opens `app`; every screen is built from `screen` and `view`.
"""

__all__ = ["app", "keys", "screen", "view"]
