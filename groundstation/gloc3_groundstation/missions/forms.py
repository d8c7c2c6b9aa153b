"""Forms for the arguments of an action: typed fields with unit, bounds and default, and parsing of their texts."""

import re
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Final

import msgspec

from gloc3.component.description import FieldLine, fields_of
from gloc3.documents.document import parse
from gloc3.documents.schema import in_words
from gloc3.errors import Gloc3Error, InputError
from gloc3.messages.units import split_unit
from gloc3.mission.model.abilities import abilities, nameable
from gloc3.mission.model.arguments import Arguments, argument_kinds
from gloc3.mission.model.waypoint_options import options_of
from gloc3.platform.platform import Capability, Platform

PAIRS: Final = {
    "waypoints_m": "waypoints",
    "position_m": "position",
    "at_m": "at",
    "area_m": "area",
    "wall_m": "wall",
    "to_m": "to",
}
"""Arguments in a local frame, and their counterparts in frame geo."""
LISTS: Final = ("waypoints_m", "area_m", "wall_m", "to_m")
"""Those of them that are several positions."""
FLAT: Final = ("at_m", "area_m", "wall_m", "to_m")
"""Those of them whose positions have no height."""


class FieldShape(StrEnum):
    """Input shapes of a field."""

    VALUE = "value"
    POSITION = "position"
    POSITIONS = "positions"


class FormField(msgspec.Struct, frozen=True, kw_only=True):
    """One argument."""

    name: str
    label: str
    unit: str = ""
    shape: FieldShape = FieldShape.VALUE
    hint: str = ""
    """What is typed, with its bounds."""
    doc: str = ""
    default: str = ""
    """As typed text; empty where a value is required, or the default is null."""
    is_required: bool = False
    choices: tuple[str, ...] = ()
    """The values that are possible, where they are few."""


class CapabilityForm(msgspec.Struct, frozen=True, kw_only=True):
    """All arguments of a capability."""

    capability: str
    doc: str
    fields: tuple[FormField, ...]
    claims: tuple[str, ...] = ()


class FormError(Gloc3Error):
    """Invalid input; `field` is the argument's name, empty where all of them together are meant."""

    def __init__(self, field: str, reason: str) -> None:
        super().__init__(reason)
        self.field: Final = field


def capabilities(platform: Platform | None) -> Mapping[str, Capability]:
    """Capabilities by name: of the platform, or all known ones where its file is not here."""
    if platform is not None:
        return {name: row for name, row in nameable(abilities(platform)).items() if name != "wait"}
    return {name: Capability(arguments=name, performed_by="") for name in argument_kinds() if name != "wait"}


def form_for(capability: str, row: Capability, *, is_geo: bool) -> CapabilityForm:
    """Form of a capability.

    Args:
        capability: its name.
        row: its row in the platform.
        is_geo: positions are latitude, longitude and height; otherwise x, y and height in a local frame.
    """
    kind = argument_kinds().get(row.arguments)
    if kind is None:
        return CapabilityForm(
            capability=capability, doc="its arguments are not known here", fields=(), claims=row.claims
        )
    unwanted = set(PAIRS) if is_geo else set(PAIRS.values())
    shown = [line for line in fields_of(kind) if line.name not in unwanted]
    fields = [_field(line, row.options.get(line.name, ()), is_geo=is_geo) for line in shown]
    options = options_of(kind)
    fields.sort(key=lambda field: (not field.is_required, field.name in options))
    return CapabilityForm(capability=capability, doc=_first_line(kind), fields=tuple(fields), claims=row.claims)


def arguments_of(form: CapabilityForm, row: Capability, typed: Mapping[str, str]) -> dict[str, Any]:
    """Parses the arguments as in a mission file; empty fields have their defaults.

    Raises:
        FormError: a value is invalid; with the field.
    """
    found: dict[str, Any] = {}
    for field in form.fields:
        text = typed.get(field.name, "").strip()
        if not text:
            if field.is_required:
                raise FormError(field.name, f"{field.label} must be given")
            continue
        found[field.name] = _value(field, text)
    kind = argument_kinds().get(row.arguments, Arguments)
    try:
        msgspec.convert(found, kind)
    except msgspec.ValidationError as error:
        path = str(error).partition(" - at `$")[2]
        name = re.match(r"\.?(\w*)", path)
        raise FormError(name.group(1) if name else "", in_words(error)) from None
    return found


def _field(line: FieldLine, options: tuple[str, ...], *, is_geo: bool) -> FormField:
    name, place = line.name, "latitude, longitude, height" if is_geo else "x, y, height"
    label, unit = split_unit(name)
    shape, hint = FieldShape.VALUE, line.bounds
    local = _local(name)
    where = place.removesuffix(", height") if local in FLAT else place
    if local in LISTS:
        shape, hint = FieldShape.POSITIONS, f"{where}; {where}; …"
    elif local in PAIRS:
        shape, hint = FieldShape.POSITION, where
    elif name == "heading":
        hint = f"along, hold, degrees, or {{look_at: [{place}]}}"
    choices = options or tuple(re.findall(r"'([^']*)'", line.type)) if name != "heading" else ()
    default = "" if line.default is None else str(line.default)
    return FormField(
        name=name,
        label=label.replace("_", " "),
        unit=unit if shape is FieldShape.VALUE else "",
        shape=shape,
        hint=" | ".join(choices) if choices else hint.replace(">= ", "≥ ").replace("<= ", "≤ "),
        doc=_plain_doc(line.doc) if shape is FieldShape.VALUE and name != "heading" else "",
        default=default or (choices[0] if len(choices) == 1 else ""),
        is_required=line.is_required or (shape is not FieldShape.VALUE and local != "at_m"),
        choices=choices,
    )


def _value(field: FormField, text: str) -> Any:
    """What was typed, read as in a mission file; positions need no brackets."""
    match field.shape:
        case FieldShape.POSITION:
            return _position(field, text)
        case FieldShape.POSITIONS if not text.startswith("["):
            return [_position(field, part) for part in text.split(";") if part.strip()]
    try:
        return parse(f"value: {text}", field.name).value["value"]
    except InputError as error:
        raise FormError(field.name, error.findings[0].message) from None


def _position(field: FormField, text: str) -> list[float]:
    parts = text.strip().strip("[]").replace(",", " ").split()
    wanted = 2 if _local(field.name) in FLAT else 3
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        raise FormError(field.name, f"{text.strip()!r} is no position: {wanted} numbers") from None
    if len(numbers) != wanted:
        raise FormError(field.name, f"{text.strip()!r}: {len(numbers)} numbers where {wanted} are needed")
    return numbers


def _local(name: str) -> str:
    """An argument by its name in a local frame."""
    return next((local for local, geo in PAIRS.items() if geo == name), name)


def _plain_doc(doc: str) -> str:
    return doc.replace("`", "").replace("None for", "empty for").replace("None:", "empty:")


def _first_line(kind: type[Arguments]) -> str:
    return (kind.__doc__ or "").strip().partition("\n")[0].partition(";")[0]
