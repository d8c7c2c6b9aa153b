"""GLOC3: a control software architecture for unmanned vehicles, built from one generic component.

`errors`, `clock` and `installed` serve every room; nothing here imports the applications.
"""

__version__ = "0.1.0"

__all__ = ["amounts", "clock", "errors", "installed", "line_of_sight", "loading", "plan_wire", "rtcm3"]
