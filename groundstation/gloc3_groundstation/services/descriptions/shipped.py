"""Descriptions of parameters that GLOC3 ships: those that an operator changes most, of PX4 and ArduPilot."""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Final, NamedTuple

import msgspec

from gloc3_groundstation.services.descriptions.parameter_info import Infos, info_of, read_infos
from gloc3_groundstation.services.snapshot import Firmware

PX4: Final = "PX4 1.16"
ARDUPILOT: Final = "ArduPilot 4.6 and 4.7"
_MULTIROTORS: Final = frozenset({2, 3, 4, 13, 14, 15, 29, 35, 43})
"""MAV_TYPE of what flies ArduPilot's Copter; other vehicles have other meanings under the same names."""


class _Shipped(NamedTuple):
    files: tuple[str, ...]
    version: str


_PLAIN: Final[Mapping[Firmware, _Shipped]] = {
    Firmware.PX4: _Shipped(("px4",), PX4),
    Firmware.ARDUPILOT: _Shipped(("ardupilot",), ARDUPILOT),
}
_COPTER: Final = _Shipped(("ardupilot", "arducopter"), ARDUPILOT)


def shipped_infos(firmware: Firmware, vehicle_type: int) -> Infos:
    """Shipped descriptions for a vehicle; none for a firmware that is not known.

    Args:
        firmware: of the vehicle.
        vehicle_type: MAV_TYPE.
    """
    is_copter = firmware is Firmware.ARDUPILOT and vehicle_type in _MULTIROTORS
    found = _COPTER if is_copter else _PLAIN.get(firmware)
    return {} if found is None else _read(found)


@cache
def _read(shipped: _Shipped) -> Infos:
    folder = files(__package__)
    read = (read_infos((folder / f"{name}.json").read_bytes(), f"{name}.json") for name in shipped.files)
    origin = f"GLOC3's table for {shipped.version}"
    return {name: msgspec.structs.replace(info, origin=origin) for infos in read for name, info in infos.items()}


def layered(own: Infos, shipped: Infos) -> Infos:
    """A vehicle's own descriptions, and shipped ones of what it does not describe."""
    return {**{name: info for name, info in shipped.items() if info_of(own, name) is None}, **own}
