"""The commands of the onboard package: `gloc3 onboard`, `platform`, `doctor`, `preset`, `signing`, `odometry`.

Each command is a file; options are shared structures.
"""

__all__ = ["onboard_options"]
