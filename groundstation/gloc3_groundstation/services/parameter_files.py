"""Files of parameters: QGroundControl's `.params`, MAVProxy's `.parm` and Mission Planner's `.param`.

The three differ in how a line is written, and all are read the same way: comments begin with `#`; QGroundControl has
five columns between tabs (system, component, name, value, type), the others a name and a value, between blanks or a
comma. The format is detected line by line, so that a file that was edited by hand can be read, too.
"""

import math
import re
import struct
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import Final

import msgspec

from gloc3.cli.counting import counted
from gloc3.documents.document import load_bytes
from gloc3.errors import Finding, InputError
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.parameter import LONGEST_NAME, Parameter, ParameterType

MAX_BYTES: Final = 5_000_000
MOST_FINDINGS: Final = 20
_NAME: Final = re.compile(rf"[A-Za-z_][A-Za-z0-9_.\-]{{0,{LONGEST_NAME - 1}}}")
_HEX: Final = re.compile(r"[+-]?0[xX][0-9A-Fa-f]{1,8}")
_FIXED: Final = re.compile(r"-?\d+\.\d{6}")
_FIXED_STEP: Final = 0.51e-6
_WORD: Final = re.compile(r"[^\s,]+")


class ParameterFormat(StrEnum):
    """File formats; the value is the suffix."""

    QGROUNDCONTROL = ".params"
    MAVPROXY = ".parm"
    MISSION_PLANNER = ".param"


class FileParameter(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter as a file has it."""

    name: str
    value: float
    line: int
    column: int = 1
    """Position of its value."""
    type: ParameterType | None = None
    """None where the file does not contain it."""
    is_rounded: bool = False
    """Whether the file's program writes six decimals and no more."""

    def is_same(self, value: float) -> bool:
        """Whether a vehicle's value is equal, within the precision of the file."""
        return _single(self.value) == _single(value) or (self.is_rounded and abs(self.value - value) <= _FIXED_STEP)


class SavedParameters(msgspec.Struct, frozen=True, kw_only=True):
    """A file that was read."""

    file: str
    parameters: tuple[FileParameter, ...]
    warnings: tuple[Finding, ...] = ()


def load_parameter_file(path: Path) -> SavedParameters:
    """Reads a file of parameters.

    Raises:
        InputError: with everything that is wrong in it.
    """
    return read_parameter_file(load_bytes(path, MAX_BYTES), str(path))


def read_parameter_file(data: bytes, file: str) -> SavedParameters:
    """Reads a file of parameters in any of the formats.

    Raises:
        InputError: with everything that is wrong in it.
    """
    if len(data) > MAX_BYTES:
        raise InputError([Finding(file=file, message="it is too large", hint="is this the right file?")])
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        hint = "a file of parameters is plain text"
        raise InputError([Finding(file=file, message="not UTF-8 text", hint=hint)]) from error
    reader = _Reader(file)
    for number, line in enumerate(lines, start=1):
        reader.read_line(number, line)
        if len(reader.findings) >= MOST_FINDINGS:
            break
    if not reader.found and not reader.findings:
        reader.findings.append(Finding(file=file, message="there are no parameters in it"))
    if reader.findings:
        raise InputError(sorted(reader.findings))
    return SavedParameters(file=file, parameters=tuple(reader.found.values()), warnings=tuple(reader.warnings))


def write_parameter_file(
    parameters: Iterable[Parameter], form: ParameterFormat, target: Address, remarks: Iterable[str] = ()
) -> str:
    """Writes a file of parameters, in the order of their names.

    Args:
        parameters: its contents.
        form: its format.
        target: the vehicle that they belong to.
        remarks: comments at the beginning.
    """
    lines = [f"# {' '.join(remark.split())}" for remark in remarks]
    if form is ParameterFormat.QGROUNDCONTROL:
        lines += ["#", "# Vehicle-Id Component-Id Name Value Type"]
    for one in sorted(parameters, key=lambda one: one.name):
        value = spell(one)
        match form:
            case ParameterFormat.QGROUNDCONTROL:
                lines.append(f"{target.system}\t{target.component}\t{one.name}\t{value}\t{int(one.type)}")
            case ParameterFormat.MAVPROXY:
                lines.append(f"{one.name:<16} {value}")
            case ParameterFormat.MISSION_PLANNER:
                lines.append(f"{one.name},{value}")
    return "\n".join(lines) + "\n"


def spell(parameter: Parameter) -> str:
    """A parameter's value in the fewest digits that are read as the same again."""
    value = parameter.value
    if parameter.type is not ParameterType.REAL32 or (value == int(value) if math.isfinite(value) else False):
        return str(int(value)) if abs(value) < 1e15 else repr(value)
    for digits in range(1, 10):
        text = f"{value:.{digits}g}"
        if math.isnan(value) or _single(float(text)) == _single(value):
            return text
    return repr(value)


class _Reader:
    """Takes line after line."""

    def __init__(self, file: str) -> None:
        self.found: dict[str, FileParameter] = {}
        self.findings: list[Finding] = []
        self.warnings: list[Finding] = []
        self._file = file

    def read_line(self, number: int, line: str) -> None:
        content = line.partition("#")[0]
        words = [(match[0], match.start() + 1) for match in _WORD.finditer(content)]
        if not words:
            return
        if words[0][0].startswith("@"):
            hint = "copy the lines of that file into this one"
            self._find(number, words[0][1], f"{words[0][0]} is not followed", hint)
        elif len(words) == 5 and words[0][0].isdigit() and words[1][0].isdigit():
            self._add(number, words[2], words[3], words[4])
        elif len(words) == 2 or (len(words) == 3 and words[2][0] == "@READONLY"):
            self._add(number, words[0], words[1])
        else:
            column = words[min(2, len(words) - 1)][1]
            hint = "a name and a value, or QGroundControl's five columns"
            self._find(number, column, f"a line of {counted(len(words), 'column')} is not understood", hint)

    def _add(
        self, number: int, name: tuple[str, int], value: tuple[str, int], kind: tuple[str, int] | None = None
    ) -> None:
        if _NAME.fullmatch(name[0]) is None:
            hint = f"1 to {LONGEST_NAME} letters, digits and _"
            self._find(number, name[1], f"{name[0][:40]!r} is no name of a parameter", hint)
            return
        read = _number(value[0])
        if read is None:
            self._find(number, value[1], f"{value[0][:40]!r} is no number that a parameter can hold")
            return
        known = None
        if kind is not None:
            known = _type(kind[0])
            if known is None:
                self._find(number, kind[1], f"{kind[0][:40]!r} is no type of a parameter", "1 to 6, or 9 for a float")
                return
            if known is not ParameterType.REAL32 and read != int(read):
                self._find(number, value[1], f"{value[0][:40]} is not whole, but {name[0]} is an integer")
                return
        before = self.found.get(name[0])
        if before is not None and before.value != read:
            message = f"{name[0]} appears again, with another value than in line {before.line}"
            self._find(number, name[1], message, "take one of them out")
        elif before is not None:
            finding = Finding(
                file=self._file, line=number, column=name[1], message=f"{name[0]} appears twice", is_warning=True
            )
            self.warnings.append(finding)
        else:
            self.found[name[0]] = FileParameter(
                name=name[0],
                value=read,
                line=number,
                column=value[1],
                type=known,
                is_rounded=_FIXED.fullmatch(value[0]) is not None,
            )

    def _find(self, line: int, column: int, message: str, hint: str = "") -> None:
        self.findings.append(Finding(file=self._file, line=line, column=column, message=message, hint=hint))


def _number(text: str) -> float | None:
    if _HEX.fullmatch(text):
        return float(int(text, 16))
    if len(text) > 60 or "_" in text:
        return None
    try:
        value = float(text)
        struct.pack("<f", value)
    except (ValueError, OverflowError):
        return None
    return value if math.isfinite(value) else None


def _type(text: str) -> ParameterType | None:
    number = int(text) if text.isascii() and text.isdigit() and len(text) <= 2 else 0
    return ParameterType(number) if number in ParameterType._value2member_map_ else None


def _single(value: float) -> float:
    """As a 32-bit float holds it."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])
