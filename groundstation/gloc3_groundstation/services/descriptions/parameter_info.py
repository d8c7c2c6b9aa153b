"""Descriptions of parameters: bounds, unit, meaning; read from the firmware's own files.

PX4 describes its parameters in `parameters.json` (often packed as `.xz`; the vehicle itself has one), ArduPilot in
`apm.pdef.xml` or `apm.pdef.json`.
"""

import lzma
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, TypeGuard
from xml.etree import ElementTree as ET

import msgspec

from gloc3.documents.characters import first_steering, harmless
from gloc3.documents.document import load_bytes
from gloc3.errors import UNREADABLE, Finding, InputError

MAX_BYTES: Final = 40_000_000
"""Of a description, unpacked."""
_XZ: Final = b"\xfd7zXZ\x00"
_INDEXED: Final = re.compile(r"\{n\}")


class ParameterInfo(msgspec.Struct, frozen=True, kw_only=True):
    """A firmware's description of one of its parameters."""

    title: str = ""
    description: str = ""
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    increment: float | None = None
    default: float | None = None
    values: Mapping[float, str] = {}
    """What each value means, where only some make sense."""
    bits: Mapping[int, str] = {}
    """What each bit means."""
    group: str = ""
    is_read_only: bool = False
    needs_restart: bool = False
    origin: str = ""
    """Who describes it, where that is not the vehicle's own firmware."""


Infos = Mapping[str, ParameterInfo]


def load_infos(path: Path) -> Infos:
    """Reads a firmware's description of its parameters.

    Raises:
        InputError: it cannot be read, or is none.
    """
    return read_infos(load_bytes(path, MAX_BYTES), str(path))


def read_infos(data: bytes, file: str) -> Infos:
    """Reads a firmware's description of its parameters, packed or not.

    A parameter whose name has control characters is left out; in texts, each is replaced.

    Raises:
        InputError: it is none.
    """
    data = unpack(data, file)
    begin = data.lstrip()[:1]
    if begin == b"<":
        return dict(_read_xml(data, file))
    if begin == b"{":
        return dict(_read_json(data, file))
    raise _refused(file, "this is no description of parameters", "choose parameters.json or apm.pdef.xml")


def unpack(data: bytes, file: str) -> bytes:
    """A file as it is, or unpacked where it is packed with xz.

    Raises:
        InputError: it cannot be unpacked, or becomes too large.
    """
    if not data.startswith(_XZ):
        return data
    unpacker = lzma.LZMADecompressor(memlimit=256_000_000)
    try:
        unpacked = unpacker.decompress(data, MAX_BYTES)
    except lzma.LZMAError as error:
        raise _refused(file, f"it cannot be unpacked: {error}", "fetch it again") from error
    if not unpacker.eof:
        raise _refused(file, "it is cut off, or too large", "fetch it again")
    return unpacked


def _read_json(data: bytes, file: str) -> Iterator[tuple[str, ParameterInfo]]:
    try:
        value = msgspec.json.decode(data)
    except UNREADABLE as error:
        raise _refused(file, f"it is no JSON: {error}") from error
    rows = value.get("parameters")
    if isinstance(rows, list):  # PX4
        yield from (found for row in rows if isinstance(row, dict) and (found := _px4(row)) is not None)
        return
    for group, rows in value.items():  # ArduPilot: groups of names
        if isinstance(rows, dict):
            for name, row in rows.items():
                if isinstance(row, dict) and _is_name(name):
                    yield name, _ardupilot(group, row)


def _px4(row: dict[str, Any]) -> tuple[str, ParameterInfo] | None:
    name = row.get("name")
    if not _is_name(name):
        return None
    values = [one for one in _rows(row.get("values")) if _number(one.get("value")) is not None]
    bits = [one for one in _rows(row.get("bitmask")) if isinstance(one.get("index"), int)]
    info = ParameterInfo(
        title=_text(row.get("shortDesc")),
        description=_text(row.get("longDesc")),
        unit=_text(row.get("units")),
        minimum=_number(row.get("min")),
        maximum=_number(row.get("max")),
        increment=_number(row.get("increment")),
        default=_number(row.get("default")),
        values={float(one["value"]): _text(one.get("description")) for one in values},
        bits={one["index"]: _text(one.get("description")) for one in bits},
        group=_text(row.get("group")),
        is_read_only=row.get("volatile") is True or row.get("readOnly") is True,
        needs_restart=row.get("rebootRequired") is True,
    )
    return name, info


def _ardupilot(group: str, row: Mapping[str, Any]) -> ParameterInfo:
    limits = row.get("Range")
    low, high = (limits.get("low"), limits.get("high")) if isinstance(limits, dict) else _pair(_text(limits))
    values, bits = row.get("Values"), row.get("Bitmask")
    numbered = [(_number(key), _text(text)) for key, text in values.items()] if isinstance(values, dict) else []
    flags = [(_number(key), _text(text)) for key, text in bits.items()] if isinstance(bits, dict) else []
    return ParameterInfo(
        title=_text(row.get("DisplayName")),
        description=_text(row.get("Description")),
        unit=_text(row.get("Units")),
        minimum=_number(low),
        maximum=_number(high),
        increment=_number(row.get("Increment")),
        values={number: text for number, text in numbered if number is not None},
        bits={int(number): text for number, text in flags if number is not None},
        group=_text(group),
        is_read_only=_text(row.get("ReadOnly")).lower() == "true",
        needs_restart=_text(row.get("RebootRequired")).lower() == "true",
    )


def _read_xml(data: bytes, file: str) -> Iterator[tuple[str, ParameterInfo]]:
    if b"<!ENTITY" in data:
        raise _refused(file, "it defines entities, which no description of parameters needs")
    try:
        root = ET.fromstring(data)
    except ET.ParseError as error:
        line, column = error.position
        words = str(error).partition(":")[0]
        raise InputError(
            [Finding(file=file, line=line, column=column + 1, message=f"it is no XML: {words}")]
        ) from error
    except LookupError as error:
        raise _refused(file, f"it is no XML: {error}") from error
    for group in root.iter("parameters"):
        for param in group.iter("param"):
            name = param.get("name", "").rpartition(":")[2]
            row: dict[str, Any] = {
                "DisplayName": param.get("humanName"),
                "Description": param.get("documentation"),
                "Values": {one.get("code", ""): one.text for one in param.iter("value")},
                "Bitmask": {one.get("code", ""): one.text for one in param.iter("bit")},
            }
            row |= {one.get("name", ""): one.text for one in param.findall("field") if one.get("name") != "Bitmask"}
            if _is_name(name):
                yield name, _ardupilot(group.get("name", ""), row)


def info_of(infos: Infos, name: str) -> ParameterInfo | None:
    """The description of a parameter; one that is written once for many, as `MOT{n}_MIN`, is found for each."""
    found = infos.get(name)
    if found is None and any(character.isdigit() for character in name):
        for number in re.finditer(r"\d+", name):
            found = infos.get(f"{name[: number.start()]}{{n}}{name[number.end() :]}")
            if found is not None:
                return msgspec.structs.replace(found, title=_INDEXED.sub(number[0], found.title))
    return found


def _rows(value: Any) -> list[dict[str, Any]]:
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []


def _is_name(value: Any) -> TypeGuard[str]:
    return isinstance(value, str) and value != "" and not first_steering(value)


def _text(value: Any) -> str:
    return harmless(value.strip()) if isinstance(value, str) else ""


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return number if abs(number) < float("inf") else None


def _pair(text: str) -> tuple[str | None, str | None]:
    parts = text.split()
    return (parts[0], parts[1]) if len(parts) == 2 else (None, None)


def _refused(file: str, message: str, hint: str = "") -> InputError:
    return InputError([Finding(file=file, message=message, hint=hint)])
