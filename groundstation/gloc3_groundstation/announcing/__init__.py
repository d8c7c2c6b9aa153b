"""Alerts that the operator hears: the terminal's bell, and speech by a program of the computer.

`announcements` decides what is announced, `speech` speaks.
"""

__all__ = ["announcements", "speech"]
