"""Proves a mission against a platform before it goes anywhere, and again onboard.

`checker` runs all checks and returns all findings at once; `estimate` gives times, path and energy.
"""

__all__ = ["checker", "estimate"]
