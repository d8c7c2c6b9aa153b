"""The mission executor: a pure machine that is given facts and the time, and returns requests.

`executor` is its face; everything else is a part of it.
"""

__all__ = ["board", "executor", "items", "requests", "restore", "snapshot"]
