"""The presets of autopilot parameters that ship with GLOC3.

The YAML files beside this page are the presets.
"""

__all__ = ["files", "session"]
