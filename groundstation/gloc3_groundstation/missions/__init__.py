"""Missions at the station: opened, checked, edited, saved, drawn, and steered item by item.

Immutable drafts, forms and outlines; the desk sends them, the screens draw them.
"""

__all__ = ["draft", "files", "first_waypoint", "forms", "outline", "place_edits", "plans"]
