"""What can be asked of a platform, as data: each capability with its arguments, their units, bounds and an example."""

import inspect
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from gloc3.component_description import fields_of
from gloc3.errors import Gloc3Error, nearest
from gloc3.mission.arguments import Arguments, argument_kinds
from gloc3.mission.checker import Circumstances
from gloc3.platform import Capability, Platform
from gloc3.units import split_unit


class ArgumentLine(msgspec.Struct, frozen=True, kw_only=True):
    """One argument."""

    name: str
    type: str
    unit: str = ""
    bounds: str = ""
    default: Any = None
    """None where a value must be given, or nothing is the default."""
    is_required: bool = False
    choices: tuple[str, ...] = ()
    """What the platform allows; empty where it says nothing."""
    doc: str = ""


class CapabilityLine(msgspec.Struct, frozen=True, kw_only=True):
    """One capability."""

    name: str
    doc: str
    """The first line tells what it does."""
    kind: str
    """The kind of its arguments."""
    package: str
    """The Python package that brings the kind."""
    moves: bool
    claims: tuple[str, ...]
    """Resources that it has for itself while it runs."""
    example: str
    """Its arguments in a mission file."""
    power_w: float = 0.0
    arguments: tuple[ArgumentLine, ...] = ()
    performed_by: str = ""
    """The platform's component; empty without a platform, and for what the executor does itself."""
    needs: tuple[str, ...] = ()
    """Topics, components or capabilities that must be alive."""

    @property
    def summary(self) -> str:
        """What it does, in one line."""
        return self.doc.partition("\n")[0]


def capability_lines(platform: Platform | None) -> tuple[CapabilityLine, ...]:
    """The capabilities of a platform, or (without one) the installed kinds of arguments, by name."""
    return tuple(_lines(Circumstances(platform=platform).capabilities()))


def capability_line(name: str, platform: Platform | None) -> CapabilityLine:
    """One of them.

    Raises:
        Gloc3Error: there is none of that name.
    """
    found = {line.name: line for line in capability_lines(platform)}
    if name not in found:
        where = f"{platform.platform} has" if platform is not None else "there is"
        raise Gloc3Error(f"{where} no capability {name!r} ({nearest(name, list(found))})")
    return found[name]


def _lines(rows: Mapping[str, Capability]) -> Iterator[CapabilityLine]:
    kinds = argument_kinds()
    for name, row in sorted(rows.items()):
        kind = kinds[row.arguments]
        yield CapabilityLine(
            name=name,
            doc=inspect.getdoc(kind) or "",
            kind=row.arguments,
            package=kind.__module__.partition(".")[0],
            moves=kind.moves,
            claims=row.claims,
            example=f"{{{name}: {kind.example}}}",
            power_w=kind.power_w,
            arguments=tuple(_arguments(kind, row.options)),
            performed_by=row.performed_by,
            needs=row.needs,
        )


def _arguments(kind: type[Arguments], options: Mapping[str, tuple[str, ...]]) -> Iterator[ArgumentLine]:
    for field in fields_of(kind):
        yield ArgumentLine(
            name=field.name,
            type=field.type,
            unit=split_unit(field.name)[1],
            bounds=field.bounds,
            default=field.default,
            is_required=field.is_required,
            choices=options.get(field.name, ()),
            doc=field.doc,
        )
