"""The processors of the example platforms, one component a file.

They are found through entry points and reach each other by topics only. `map` also tells whether a known map fits its settings.
"""

__all__ = ["map"]
