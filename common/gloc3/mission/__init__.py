"""Missions: partial orders of tasks, which are partial orders of actions (paper §III-A)."""
