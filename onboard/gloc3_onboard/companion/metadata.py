"""MAVLink component metadata of the onboard computer, served over MAVLink FTP.

There is no event file: components report texts, whereas MAVLink events carry numbers of predefined texts.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

from gloc3 import __version__
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.files.ftp import checksum
from gloc3_onboard.companion.parameter_table import CompanionParameter

GENERAL: Final = "general.json"
PARAMETERS: Final = "parameters.json"
FOLDER: Final = "/metadata"
_PARAMETER_TYPE: Final = 1
"""COMP_METADATA_TYPE_PARAMETER."""


class Metadata:
    """The files, and the message that names the first of them.

    Args:
        own: MAVLink address of the component.
        platform: the platform's name.
        rows: every parameter.
    """

    def __init__(self, own: Address, platform: str, rows: Sequence[CompanionParameter]) -> None:
        parameters = msgspec.json.encode({"version": 3, "parameters": [_parameter(row) for row in rows]})
        general = msgspec.json.encode(
            {
                "version": 1,
                "vendorName": "GLOC3",
                "modelName": f"GLOC3 onboard computer of {platform}",
                "firmwareVersion": __version__,
                "metadataTypes": [
                    {"type": _PARAMETER_TYPE, "uri": _uri(own, PARAMETERS), "fileCrc": checksum([parameters])}
                ],
            }
        )
        self.files: Final[Mapping[str, bytes]] = {GENERAL: general, PARAMETERS: parameters}
        """By name, in the folder of the metadata."""
        self._uri, self._crc = _uri(own, GENERAL), checksum([general])

    def message(self, boot_ms: int) -> MavlinkMessage:
        """COMPONENT_METADATA."""
        return message("COMPONENT_METADATA", time_boot_ms=boot_ms, file_crc=self._crc, uri=self._uri)


def _uri(own: Address, name: str) -> str:
    return f"mftp://[;comp={own.component}]{FOLDER}/{name}"


def _parameter(row: CompanionParameter) -> dict[str, Any]:
    reported: dict[str, Any] = {
        "name": row.name,
        "type": "Float",
        "shortDesc": f"{row.component or 'onboard computer'}: {row.setting or 'rate_hz'}",
        "default": row.value,
        "group": row.component or "onboard computer",
    }
    optional = {"longDesc": row.text, "units": row.unit, "min": row.low, "max": row.high}
    reported |= {key: value for key, value in optional.items() if value not in (None, "")}
    return reported | ({"decimalPlaces": 0, "increment": 1} if row.is_whole else {})
