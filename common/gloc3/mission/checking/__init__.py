"""Checks a mission against a platform before it is sent, and again onboard.

`checker` runs all checks and returns all findings at once; `plan_check` does so for other programs' plans,
`separation_check` compares the ways of several
vehicles, `place_check` judges places on Earth, and `estimate` computes times, path and energy. `terrain_check` has the
heights of a path over the ground.
"""

__all__ = ["checker", "estimate", "plan_check", "separation_check", "terrain_check"]
