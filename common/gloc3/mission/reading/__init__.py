"""Mission files in and out: YAML becomes a mission in NED, or a list of findings with places.

Definitions and libraries are expanded here; the JSON Schema is derived from the same types.
"""

__all__ = ["library", "mission_schema", "mission_site", "reader", "writer"]
