"""Lists of numbers in a calibration file, each mistake with its place."""

import math
from collections.abc import Sequence
from typing import Any

from gloc3.documents.document import Document, Where
from gloc3.errors import Finding, nearest


class Values:
    """Reads values from a document and collects its errors.

    Each method gives None, and adds a finding, where the value is missing or of another shape.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self.findings: list[Finding] = []

    def wrong(self, where: Where, message: str, hint: str = "") -> None:
        """Adds a finding about the value at a path."""
        self.findings.append(self.document.finding(where, message, hint))

    def warn(self, where: Where, message: str, hint: str = "") -> None:
        """Adds a doubt about the value at a path."""
        self.findings.append(self.document.finding(where, message, hint, is_warning=True))

    def value(self, where: Where) -> Any:
        """The plain value at a path; None where there is none."""
        value = self.document.value
        for step in where:
            is_key = isinstance(value, dict) and step in value
            is_index = isinstance(value, list) and isinstance(step, int) and step < len(value)
            if not (is_key or is_index):
                return None
            value = value[step]
        return value

    def first(self, where: Where, names: Sequence[str]) -> Where | None:
        """The path of the first of several names that is there."""
        value = self.value(where)
        found = [name for name in names if isinstance(value, dict) and name in value]
        return (*where, found[0]) if found else None

    def missing(self, where: Where, name: str) -> None:
        """Adds that a key is missing, with the key that is perhaps meant."""
        value = self.value(where)
        known = [key for key in value if isinstance(key, str)] if isinstance(value, dict) else []
        self.wrong(where, f"{name!r} is missing", nearest(name, known) if known else "")

    def numbers(self, where: Where, counts: Sequence[int], what: str) -> list[float] | None:
        """A flat list of numbers.

        Args:
            where: the path.
            counts: how many there may be.
            what: the list, in words.
        """
        value = self.value(where)
        if value is None:
            self.missing(where[:-1], str(where[-1]))
            return None
        if not isinstance(value, list):
            self.wrong(where, f"{what} must be a list of numbers", "write [1.0, 2.0, ...]")
            return None
        for index, item in enumerate(value):
            if isinstance(item, bool) or not isinstance(item, int | float) or not math.isfinite(item):
                self.wrong((*where, index), f"{item!r} is not a number")
                return None
        if len(value) not in counts:
            wanted = " or ".join(str(count) for count in counts)
            self.wrong(where, f"{what}: {len(value)} numbers, expected {wanted}")
            return None
        return [float(item) for item in value]

    def matrix(self, where: Where, rows: int, columns: int, what: str) -> list[list[float]] | None:
        """A matrix, as rows of numbers or as a mapping with `rows`, `cols` and `data`."""
        value = self.value(where)
        if isinstance(value, dict):
            data = self.numbers((*where, "data"), (rows * columns,), what)
            size = (value.get("rows"), value.get("cols"))
            if data is not None and size != (rows, columns):
                self.wrong(where, f"{what} is {size[0]} by {size[1]}, expected {rows} by {columns}")
                return None
            return None if data is None else [data[row * columns : (row + 1) * columns] for row in range(rows)]
        if isinstance(value, list) and len(value) != rows:
            self.wrong(where, f"{what} has {len(value)} rows, expected {rows}")
            return None
        if not isinstance(value, list):
            self.wrong(where, f"{what} must be a matrix", f"{rows} rows of {columns} numbers")
            return None
        found = [self.numbers((*where, row), (columns,), f"row {row + 1} of {what}") for row in range(rows)]
        return [row for row in found if row is not None] if all(row is not None for row in found) else None
