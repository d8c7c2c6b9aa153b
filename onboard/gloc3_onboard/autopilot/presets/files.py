"""Preset files of autopilot parameters, and their differences from a vehicle; applied on request only."""

import math
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec

from gloc3.documents import schema
from gloc3.documents.document import load_bytes, parse
from gloc3.errors import Finding, InputError, nearest
from gloc3.mavlink.services.parameter import LONGEST_NAME
from gloc3.messages.vehicle import Style, VehicleClass

SAME: Final = 1e-6
"""Values that differ by no more than this share are the same: they travel as 32-bit floats."""

ParameterName = Annotated[str, msgspec.Meta(pattern=rf"^[A-Z][A-Z0-9_]{{0,{LONGEST_NAME - 1}}}$")]


class PresetValue(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One parameter of a preset."""

    value: float
    why: str = ""
    also: dict[ParameterName, float] = {}
    """The names that it has in other versions, with the value there: whichever the vehicle has is set."""

    def values(self, name: str) -> dict[str, float]:
        """The value by every name that it may have; `name` is that of the row."""
        return {name: self.value, **self.also}


class Preset(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A preset file."""

    preset: str
    style: Style
    vehicle: VehicleClass
    parameters: dict[ParameterName, PresetValue]
    restart: tuple[str, ...] = ()
    """Parameters that count only after a restart of the autopilot."""

    def values(self) -> dict[str, float]:
        """Every name that a vehicle may have, with its value."""
        return {name: value for row, wanted in self.parameters.items() for name, value in wanted.values(row).items()}


class PresetChange(NamedTuple):
    """Effect of a preset on one parameter of a vehicle."""

    name: str
    now: float | None
    """None where the vehicle does not have it, or has not answered."""
    wanted: float
    why: str
    problem: str = ""

    @property
    def is_needed(self) -> bool:
        """Whether it has another value."""
        return self.now is not None and not is_same(self.now, self.wanted)

    def __str__(self) -> str:
        why = f"   # {self.why}" if self.why else ""
        if self.now is None:
            return f"! {self.name}: {self.problem or 'the autopilot does not have it'}"
        if not self.is_needed:
            return f"  {self.name} {self.now:g}{why}"
        return f"- {self.name} {self.now:g}\n+ {self.name} {self.wanted:g}{why}"


def is_same(one: float, other: float) -> bool:
    """Whether two values are the same within the protocol's precision."""
    return math.isclose(one, other, rel_tol=SAME, abs_tol=1e-9)


def diff(preset: Preset, now: Mapping[str, float], problems: Mapping[str, str]) -> list[PresetChange]:
    """Changes that the preset makes on a vehicle, in the order of the file.

    Args:
        preset: the preset.
        now: the vehicle's values.
        problems: reasons why others could not be read.
    """
    changes = []
    for row, wanted in preset.parameters.items():
        values = wanted.values(row)
        name = next((one for one in values if one in now), row)
        changes.append(PresetChange(name, now.get(name), values[name], wanted.why, problems.get(name, "")))
    return changes


def preset_files() -> dict[str, Path]:
    """The presets that ship with GLOC3, by name."""
    folder = Path(str(files("gloc3_onboard.autopilot.presets")))
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}


def load_preset(name: str) -> Preset:
    """Reads a preset by path, or by the name of one that ships with GLOC3.

    Raises:
        InputError: there is none, or something is wrong in it.
    """
    path, known = Path(name), preset_files()
    if not path.suffix and not path.exists():
        if name not in known:
            raise InputError([Finding(file=name, message="no such preset", hint=nearest(name, sorted(known)))])
        path = known[name]
    document = parse(load_bytes(path), str(path))
    findings: list[Finding] = []
    preset = schema.check(document.root, Preset, str(path), findings)
    if preset is not None:
        findings += [
            document.finding(
                ("restart", index), f"{each} is not among the parameters", nearest(each, sorted(preset.parameters))
            )
            for index, each in enumerate(preset.restart)
            if each not in preset.parameters
        ]
    if preset is None or findings:
        raise InputError(findings)
    return preset
