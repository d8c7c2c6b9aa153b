"""Descriptions of parameters: from the vehicle's own files, from files of a firmware, and those that GLOC3 ships.

The service of parameters reads them; `px4.json`, `ardupilot.json` and `arducopter.json` hold what is shipped.
"""

__all__ = ["component_metadata", "parameter_info", "shipped"]
