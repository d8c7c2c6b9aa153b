"""Checks a mission against a platform before it is sent, and again onboard.

`checker` runs all checks and returns all findings at once; `estimate` computes times, path and energy.
"""

__all__ = ["checker", "estimate"]
