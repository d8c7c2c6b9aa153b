"""The panes of the services screen, one per file, and their common base.

Each pane belongs to the services screen and calls the vehicle's desk.
"""

__all__ = ["calibration", "console", "files", "logs", "motors", "pane", "parameters", "plans", "rates"]
