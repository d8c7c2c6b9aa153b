"""The presets of autopilot parameters that ship with GLOC3."""
