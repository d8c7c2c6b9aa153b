"""Missions and maps as lines: the graph of tasks, details, map, height profile.

Pure functions of a view.
"""

__all__ = ["detail", "graph", "lines", "map", "map_edit", "profile", "traffic"]
