"""The capabilities of a platform with their arguments, units, bounds and an example: as data, and in a terminal."""

import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import msgspec

from gloc3.cli.tables import console, print_table, value_text
from gloc3.component.description import fields_of
from gloc3.errors import Gloc3Error, nearest
from gloc3.messages.units import split_unit
from gloc3.mission.checking.checker import Circumstances
from gloc3.mission.model.abilities import nameable
from gloc3.mission.model.arguments import Arguments, argument_kinds
from gloc3.platform.platform import Capability, Platform

_WORDS: Final = {"float": "number", "int": "whole number", "str": "text", "bool": "true or false"}


class ArgumentLine(msgspec.Struct, frozen=True, kw_only=True):
    """One argument."""

    name: str
    type: str
    unit: str = ""
    bounds: str = ""
    default: Any = None
    """None where a value is required, or the default is null."""
    is_required: bool = False
    choices: tuple[str, ...] = ()
    """What the platform allows; empty where it says nothing."""
    doc: str = ""


class CapabilityLine(msgspec.Struct, frozen=True, kw_only=True):
    """A capability with its arguments."""

    name: str
    doc: str
    """The first line is its summary."""
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
    """The platform's component; empty without a platform, and for capabilities of the executor itself."""
    needs: tuple[str, ...] = ()
    """Topics, components or capabilities that must be alive."""

    @property
    def summary(self) -> str:
        """What it does, in one line."""
        return self.doc.partition("\n")[0]


def capability_lines(platform: Platform | None) -> tuple[CapabilityLine, ...]:
    """The capabilities of a platform, or (without one) the installed kinds of arguments, by name."""
    return tuple(_lines(nameable(Circumstances(platform=platform).capabilities())))


def capability_line(name: str, platform: Platform | None) -> CapabilityLine:
    """One capability of a platform, or one installed kind of arguments.

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


def list_capabilities(lines: Sequence[CapabilityLine], platform: Platform | None) -> None:
    """Prints a row for each capability."""
    if platform is None:
        print_table(["kind", "package", "claims", "what it does"], [[*_first(line), line.summary] for line in lines])
    else:
        columns = ["capability", "performed by", "claims", "needs", "what it does"]
        rows = [
            [line.name, line.performed_by or "the executor", *_listed(line.claims, line.needs), line.summary]
            for line in lines
        ]
        print_table(columns, rows)
    on = f" --platform {platform.platform}" if platform is not None else ""
    shown = next((line.name for line in lines if line.arguments), lines[0].name)
    console().print(f"\nfor the arguments of one: gloc3 mission capabilities {shown}{on}")


def explain(line: CapabilityLine, platform: Platform | None) -> None:
    """A capability with its arguments."""
    to = console()
    to.print(f"[bold]{line.name}[/bold], of the package {line.package}", highlight=False)
    to.print(line.doc, markup=False)
    to.print(f"\nin a mission file, as an action called step:\n  step: {line.example}", markup=False)
    if platform is not None:
        by = line.performed_by or "the executor itself"
        to.print(f"\non {platform.platform}: performed by {by}", markup=False)
    for title, names in (("claims", line.claims), ("needs", line.needs)):
        if names:
            to.print(f"{title}: {', '.join(names)}", markup=False)
    if line.power_w:
        to.print(f"draws: {line.power_w:g} W while it runs", markup=False)
    if line.arguments:
        columns = ["argument", "unit", "values", "default", ""]
        print_table(columns, [[one.name, one.unit, _values(one), _default(one), one.doc] for one in line.arguments])
    else:
        to.print("\nit takes no arguments", markup=False)


def _first(line: CapabilityLine) -> list[str]:
    return [line.name, line.package, ", ".join(line.claims)]


def _listed(*names: Sequence[str]) -> list[str]:
    return [", ".join(one) for one in names]


def _values(line: ArgumentLine) -> str:
    """What may be written, with the bounds."""
    if line.choices:
        return " | ".join(line.choices)
    text = re.sub(r"tuple\[(.*), \.\.\.\]", r"list of \1", line.type.removesuffix(" | None"))
    text = re.sub(r"tuple\[([^\]]*)\]", r"[\1]", text).replace("'", "")
    for technical, plain in _WORDS.items():
        text = re.sub(rf"\b{technical}\b", plain, text)
    return f"{text}{', ' if line.bounds else ''}{line.bounds}"


def _default(line: ArgumentLine) -> str:
    return "(required)" if line.is_required else value_text(line.default)
