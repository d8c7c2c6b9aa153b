"""Mission executor: a pure state machine with events and the time as inputs, and requests as outputs.

`executor` is its interface; the other modules are its parts.
"""

__all__ = ["amending", "board", "executor", "items", "requests", "restore", "snapshot", "steering"]
