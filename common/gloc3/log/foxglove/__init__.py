"""What Foxglove reads of a log: its schemas beside our messages, its scene, and a layout.

The recorder writes them, and the live view serves them.
"""

__all__ = ["layout", "scene", "schemas"]
