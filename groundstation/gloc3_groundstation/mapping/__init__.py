"""What the map and the charts draw, without the terminal: histories, requested paths, and where everything lies.

Pure geometry and histories: the screens draw them.
"""

__all__ = ["ground", "history", "mission_texts", "progress", "projection", "requested", "tracks"]
