"""The widgets of the terminal: panels of lines, lists, pictures, editors, tables.

Each redraws only changes.
"""

__all__ = [
    "canvas",
    "canvas_panel",
    "entry",
    "graph_panel",
    "lines",
    "long_list",
    "mission_text",
    "panel",
    "picture_panel",
    "tables",
    "vehicle_rows",
]
