"""JSON Schema of the lines that `gloc3 station --headless --json` prints."""

from typing import Final

from gloc3.documents.format_version import schema_id
from gloc3.documents.json_schema import Schema, document, ref, struct_schema
from gloc3_groundstation.reporting.lines import KINDS, SCHEMA, EndLine, NarrationLine
from gloc3_groundstation.reporting.outcomes import RunOutcome

DESCRIPTION: Final = (
    "One line of `gloc3 station --headless --json`, an object by its kind. Within a version fields keep their names and "
    "meanings; kinds and fields may be added, so programs ignore what they do not know."
)


def lines_schema() -> Schema:
    """Schema of one line."""
    definitions: dict[str, Schema] = {}
    for kind, data in KINDS.items():
        own = struct_schema(EndLine if kind == "end" else NarrationLine, {})
        definitions[data.__name__] = struct_schema(data, definitions)
        fields = own["properties"]
        fields["schema"] |= {"const": SCHEMA}
        fields["kind"] = {"const": kind}
        fields["data"] = ref(data.__name__)
        fields["utc"] |= {"format": "date-time"}
        if kind == "end":
            fields["outcome"] |= {"enum": [outcome.value for outcome in RunOutcome]}
        definitions[f"line {kind}"] = {
            "type": "object",
            "description": definitions[data.__name__]["description"],
            "properties": fields,
            "required": list(fields),
        }
    choice: Schema = {"oneOf": [ref(f"line {kind}") for kind in KINDS]}
    return document(schema_id("station-lines", SCHEMA), "GLOC3 station lines", DESCRIPTION, choice, definitions)
