"""Units, as the endings of names say them: `speed_m_s` is in metres a second."""

from collections.abc import Mapping
from typing import Final

UNITS: Final[Mapping[str, str]] = {
    "_rad_s2": "rad/s²",
    "_rad_s": "rad/s",
    "_deg_s": "°/s",
    "_m_s2": "m/s²",
    "_m_s": "m/s",
    "_n_m": "N m",
    "_rad": "rad",
    "_deg": "°",
    "_percent": "%",
    "_hz": "Hz",
    "_kg": "kg",
    "_pa": "Pa",
    "_wh": "Wh",
    "_px": "px",
    "_m": "m",
    "_s": "s",
    "_n": "N",
    "_v": "V",
    "_a": "A",
    "_w": "W",
}
"""Endings of names, the longer ones first."""


def split_unit(name: str) -> tuple[str, str]:
    """Name without its unit suffix, and the unit (empty for none): `speed_m_s` is `speed` in `m/s`."""
    for ending, unit in UNITS.items():
        if name.endswith(ending) and len(name) > len(ending):
            return name.removesuffix(ending), unit
    return name, ""
