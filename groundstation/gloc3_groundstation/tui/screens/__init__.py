"""The screens, one a file; `table` holds a row for each.

A new screen is a file here and a row in `table`.
"""

__all__ = ["mission", "plugged", "table"]
