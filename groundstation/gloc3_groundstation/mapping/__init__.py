"""Data of the map and the charts, without the terminal: histories, requested paths, placements.

Pure geometry and histories: the screens draw them.
"""

__all__ = ["ground", "handles", "history", "occupied", "progress", "projection", "requested", "tracks"]
