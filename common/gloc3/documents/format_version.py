"""Version of the format of mission and platform files: `gloc3: 1` in a file, and in the name of its schema.

It changes only where a file of the earlier format would be read wrongly; keys that are added leave it as it is.
"""

from typing import Annotated, Any, Final

import msgspec

from gloc3.documents.document import Document
from gloc3.errors import InputError

KEY: Final = "gloc3"
VERSION: Final = 1
"""Newest format that is read; a file without one is of the first."""
FormatVersion = Annotated[int, msgspec.Meta(ge=1, le=VERSION)]
STAMP: Final[dict[str, Any]] = {KEY: VERSION}
"""First key of a file that is written."""


def schema_id(kind: str, version: int = VERSION, *, variant: str = "") -> str:
    """URN of a schema, which is its `$id`: a name, from which nothing is fetched.

    Args:
        kind: what it describes, such as `mission`.
        version: of the format.
        variant: what the schema is narrowed to, such as a platform; empty for the whole format.
    """
    return ":".join(filter(None, ("urn:gloc3:schema", kind, str(version), variant)))


def check_format(document: Document) -> None:
    """Checks that a file is not of a newer format, whose keys would only be reported as unknown.

    Raises:
        InputError: it is of a newer one.
    """
    node = document.root.children.get(KEY)
    if node is not None and type(node.value) is int and node.value > VERSION:
        message = f"the file has format {node.value}; this version of GLOC3 reads formats up to {VERSION}"
        hint = "update GLOC3, or use a file of an earlier format"
        raise InputError([document.finding((KEY,), message, hint)])
