"""A vehicle's parameters as a screen shows them: an immutable table to search, check and compare, without a link."""

from collections.abc import Iterator, Mapping
from enum import StrEnum
from fnmatch import fnmatchcase
from math import isfinite
from typing import Final

import msgspec

from gloc3.errors import Finding, Refused, nearest
from gloc3.mavlink.services.parameter import Parameter, ParameterType, parameter
from gloc3_groundstation.services.descriptions.parameter_info import Infos, ParameterInfo, info_of
from gloc3_groundstation.services.parameter_files import FileParameter, SavedParameters, spell

_NOTHING: Final = ParameterInfo()


class ParameterRow(msgspec.Struct, frozen=True, kw_only=True):
    """One parameter."""

    parameter: Parameter
    """As last reported by the vehicle."""
    first: float
    """What it was when the list was fetched."""
    info: ParameterInfo = _NOTHING

    @property
    def name(self) -> str:
        """Its name."""
        return self.parameter.name

    @property
    def value(self) -> float:
        """Its value."""
        return self.parameter.value

    @property
    def text(self) -> str:
        """Its value in as few digits as it needs."""
        return spell(self.parameter)

    @property
    def meaning(self) -> str:
        """What the value means, where the firmware says so; else empty."""
        found = self.info.values.get(self.value)
        if found is not None:
            return found
        if self.info.bits and self.parameter.type is not ParameterType.REAL32:
            number = int(self.value)
            return ", ".join(text for bit, text in sorted(self.info.bits.items()) if number >> bit & 1)
        return ""

    @property
    def group(self) -> str:
        """What belongs together: as the firmware says, or else the first part of the name."""
        return self.info.group or self.name.partition("_")[0]

    @property
    def is_changed(self) -> bool:
        """Whether it is another value than when the list was fetched."""
        return not self.parameter.is_same(Parameter(self.name, self.first, self.parameter.type))

    @property
    def is_default(self) -> bool | None:
        """Whether it is as the firmware brings it; None where that is not known."""
        default = self.info.default
        return None if default is None else FileParameter(name=self.name, value=default, line=0).is_same(self.value)


class DiffKind(StrEnum):
    """Differences of a file and a vehicle in one parameter."""

    DIFFERENT = "different"
    SAME = "same"
    NOT_ALLOWED = "not allowed"
    """The file's value does not fit the vehicle; it is not written."""
    ONLY_IN_FILE = "only in the file"
    ONLY_ON_VEHICLE = "only on the vehicle"


class DiffRow(msgspec.Struct, frozen=True, kw_only=True):
    """One parameter of a comparison."""

    name: str
    kind: DiffKind
    vehicle: float | None = None
    file: float | None = None
    line: int = 0
    """Of the file; 0 where the parameter is not in it."""
    reason: str = ""
    """Why it is not allowed."""


class ParameterChange(msgspec.Struct, frozen=True):
    """A value that shall be written."""

    name: str
    value: float


class ParameterDiff(msgspec.Struct, frozen=True, kw_only=True):
    """Changes that loading a file would make."""

    file: str
    rows: tuple[DiffRow, ...]
    warnings: tuple[Finding, ...] = ()

    def of(self, *kinds: DiffKind) -> tuple[DiffRow, ...]:
        """The rows of some kinds."""
        return tuple(row for row in self.rows if row.kind in kinds)

    def changes(self, left_out: frozenset[str] = frozenset()) -> tuple[ParameterChange, ...]:
        """What has to be written, but for the names that shall stay as they are."""
        return tuple(
            ParameterChange(row.name, row.file)
            for row in self.of(DiffKind.DIFFERENT)
            if row.name not in left_out and row.file is not None
        )


class ParameterTable(msgspec.Struct, frozen=True, kw_only=True):
    """All parameters reported by a vehicle, in the order of their names."""

    rows: Mapping[str, ParameterRow] = {}
    is_complete: bool = False
    """Whether the whole list has been fetched."""

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[ParameterRow]:
        return iter(self.rows.values())

    def __getitem__(self, name: str) -> ParameterRow:
        try:
            return self.rows[name]
        except KeyError:
            raise Refused(f"the vehicle has no parameter {name!r}: {nearest(name, list(self.rows))}") from None

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups that there are, in order."""
        return tuple(sorted({row.group for row in self}))

    def find(
        self, text: str = "", *, group: str = "", changed: bool = False, not_default: bool = False
    ) -> list[ParameterRow]:
        """Finds parameters; those whose name begins with the text come first.

        Args:
            text: words that all occur in name or title, in any case; or a pattern for the name with `*` and `?`.
            group: only of this group.
            changed: only those that were changed since the list was fetched.
            not_default: only those known to differ from the firmware's default.
        """
        words = text.lower().split()
        found: list[tuple[int, ParameterRow]] = []
        for row in self:
            if (group and row.group != group) or (changed and not row.is_changed):
                continue
            if not_default and row.is_default is not False:
                continue
            rank = _rank(row, words)
            if rank is not None:
                found.append((rank, row))
        return [row for _, row in sorted(found, key=lambda one: one[0])]

    def check(self, name: str, value: float, *, force: bool = False) -> Parameter:
        """A parameter with a new value, if it may be that.

        Args:
            name: which.
            value: the new one.
            force: also beyond the bounds that the firmware describes, though never infinite or beyond those of its type.

        Raises:
            Refused: there is no such parameter, or it may not be that; with the bounds.
        """
        row = self[name]
        wanted = parameter(name, value, row.parameter.type)
        info = row.info
        if wanted.is_same(row.parameter):
            return wanted
        if not isfinite(wanted.value):
            raise Refused(f"{name} must be a number, not {value:g}")
        if force:
            return wanted
        unit = f" {info.unit}" if info.unit else ""
        if info.is_read_only:
            raise Refused(f"{name} is read-only")
        if info.minimum is not None and wanted.value < info.minimum and not _is_close(wanted.value, info.minimum):
            raise Refused(f"{name} must be at least {info.minimum:g}{unit}, not {spell(wanted)}")
        if info.maximum is not None and wanted.value > info.maximum and not _is_close(wanted.value, info.maximum):
            raise Refused(f"{name} must be at most {info.maximum:g}{unit}, not {spell(wanted)}")
        return wanted

    def parse(self, name: str, text: str) -> float:
        """Parses a typed value: a number, or the name of a value.

        Raises:
            Refused: it is neither of them.
        """
        row, text = self[name], text.strip()
        for value, meaning in row.info.values.items():
            if text.lower() == meaning.lower():
                return value
        try:
            return float(int(text, 16)) if text.lower().startswith("0x") else float(text)
        except ValueError:
            names = list(row.info.values.values())
            hint = f"; {nearest(text, names)}" if names else ""
            raise Refused(f"{text!r} is no value for {name}{hint}") from None

    def compare(self, file: SavedParameters) -> ParameterDiff:
        """Changes that a file would make on the vehicle; rows are in the order of the file, then of the names."""
        rows = [self._compare(one) for one in file.parameters]
        named = {one.name for one in file.parameters}
        rows += [
            DiffRow(name=row.name, kind=DiffKind.ONLY_ON_VEHICLE, vehicle=row.value)
            for row in self
            if row.name not in named
        ]
        return ParameterDiff(file=file.file, rows=tuple(rows), warnings=file.warnings)

    @classmethod
    def of(cls, reported: Mapping[str, Parameter], infos: Infos, *, is_complete: bool) -> "ParameterTable":
        """The table of a list that was just fetched."""
        rows = {
            name: ParameterRow(
                parameter=reported[name], first=reported[name].value, info=info_of(infos, name) or _NOTHING
            )
            for name in sorted(reported)
        }
        return ParameterTable(rows=rows, is_complete=is_complete)

    def with_value(self, reported: Parameter) -> "ParameterTable":
        """The table after one parameter was reported again."""
        row = self.rows.get(reported.name)
        if row is None:
            rows = {**self.rows, reported.name: ParameterRow(parameter=reported, first=reported.value)}
            return ParameterTable(rows=dict(sorted(rows.items())), is_complete=self.is_complete)
        return msgspec.structs.replace(
            self, rows={**self.rows, reported.name: msgspec.structs.replace(row, parameter=reported)}
        )

    def with_infos(self, infos: Infos) -> "ParameterTable":
        """The table with the firmware's descriptions."""
        rows = {
            name: msgspec.structs.replace(row, info=info_of(infos, name) or _NOTHING) for name, row in self.rows.items()
        }
        return msgspec.structs.replace(self, rows=rows)

    def _compare(self, one: FileParameter) -> DiffRow:
        row = self.rows.get(one.name)
        if row is None:
            return DiffRow(name=one.name, kind=DiffKind.ONLY_IN_FILE, file=one.value, line=one.line)
        kind, reason = DiffKind.DIFFERENT, ""
        if one.is_same(row.value):
            kind = DiffKind.SAME
        else:
            try:
                self.check(one.name, one.value)
            except Refused as error:
                kind, reason = DiffKind.NOT_ALLOWED, str(error)
        return DiffRow(name=one.name, kind=kind, vehicle=row.value, file=one.value, line=one.line, reason=reason)


def _rank(row: ParameterRow, words: list[str]) -> int | None:
    """How well a parameter matches a search, 0 the best; None where it does not."""
    name = row.name.lower()
    if not words:
        return 0
    rank = 0
    for word in words:
        if "*" in word or "?" in word:
            if not fnmatchcase(name, word):
                return None
        elif name.startswith(word):
            continue
        elif word in name:
            rank = max(rank, 1)
        elif word in row.info.title.lower():
            rank = max(rank, 2)
        else:
            return None
    return rank


def _is_close(left: float, right: float) -> bool:
    """Whether two values differ by no more than a 32-bit float's precision."""
    return abs(left - right) <= 1e-6 * max(abs(left), abs(right))
