"""Component metadata of the autopilot: the general file, and the description of its parameters."""

import lzma
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import MavlinkMessage
from gloc3.mavlink.services.files.ftp import checksum
from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.mavlink.units import boot_ms
from gloc3_sitl.autopilot.parameters import AutopilotParameter, ParameterKind, ParameterStore

GENERAL: Final = "etc/extras/component_general.json.xz"
PARAMETERS: Final = "etc/extras/parameters.json.xz"
_PARAMETERS_TYPE, _EVENTS_TYPE = 1, 4
"""COMP_METADATA_TYPE."""
_KINDS: Final = {ParameterKind.INT8: "Int8", ParameterKind.INT16: "Int16", ParameterKind.INT32: "Int32"}


def packed(content: object) -> bytes:
    """A file of metadata as PX4 stores it."""
    return lzma.compress(msgspec.json.encode(content), lzma.FORMAT_XZ, lzma.CHECK_CRC32)


def parameters_file(parameters: ParameterStore) -> bytes:
    """The description of the parameters."""
    return packed({"version": 1, "parameters": [_described(row) for row in parameters.rows.values()]})


def general_file(events_path: str, files: Mapping[str, bytes]) -> bytes:
    """The general file, which names the others.

    Args:
        events_path: of the metadata of the events.
        files: the others by path.
    """
    kinds = {PARAMETERS: _PARAMETERS_TYPE, events_path: _EVENTS_TYPE}
    types = [
        {"type": kinds[path], "uri": f"mftp://{path}", "fileCrc": checksum([data])} for path, data in files.items()
    ]
    return packed({"version": 1, "metadataTypes": types})


def metadata_message(autopilot: Autopilot, general: bytes) -> MavlinkMessage:
    """COMPONENT_METADATA."""
    crc = checksum([general])
    return message("COMPONENT_METADATA", time_boot_ms=boot_ms(autopilot), file_crc=crc, uri=f"mftp://{GENERAL}")


def _described(row: AutopilotParameter) -> dict[str, Any]:
    text, _, unit = row.what.rpartition(", ")
    has_unit = bool(text) and unit in _UNITS
    return {
        "name": row.name,
        "type": _KINDS.get(row.kind, "Float"),
        "shortDesc": text if has_unit else row.what,
        "units": unit if has_unit else "",
        "default": row.default,
        "min": row.minimum,
        "max": row.maximum,
        "group": row.name.partition("_")[0],
    }


_UNITS: Final = frozenset({"m", "s", "ms", "m/s", "m/s^2", "m/s^3", "deg", "deg/s", "%", "mAh", "V", "Hz"})
