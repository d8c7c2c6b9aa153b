"""YAML files that people write: read with the place of everything in them, checked against types, described by JSON Schema.

Errors are findings with file, line, column and a hint, never a traceback.
"""

__all__ = ["characters", "document", "document_edit", "format_version", "json_schema", "schema", "yaml_nodes"]
