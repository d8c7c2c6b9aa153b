"""The panes of the services screen, one a file, and what they have in common.

Each pane belongs to the screen of services and talks to the vehicle's desk.
"""

__all__ = ["calibration", "files", "logs", "pane", "parameters", "plans", "rates"]
