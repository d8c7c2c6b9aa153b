"""Partial orders drawn with box characters: layers from left to right, wires between them, rails inside a box.

Boxes, layers and wires on a grid of characters, independent of Textual.
"""

__all__ = ["canvas", "layout", "rails"]
