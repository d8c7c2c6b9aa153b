"""Missions for people: the command `gloc3 mission`, drawings, tables of capabilities.

Nothing here changes a mission.
"""

__all__ = ["show"]
