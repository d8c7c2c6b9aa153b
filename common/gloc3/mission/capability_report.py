"""Shows capabilities in a terminal: all in a table, or one with everything that a mission's author needs of it."""

import re
from collections.abc import Sequence
from typing import Final

from gloc3.mission.capability_lines import ArgumentLine, CapabilityLine
from gloc3.platform import Platform
from gloc3.tables import console, print_table, value_text

_WORDS: Final = {"float": "number", "int": "whole number", "str": "text", "bool": "true or false"}


def list_capabilities(lines: Sequence[CapabilityLine], platform: Platform | None) -> None:
    """A row for each, and how to learn more."""
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
    console().print(f"\nwhat one of them takes: gloc3 mission capabilities {shown}{on}")


def explain(line: CapabilityLine, platform: Platform | None) -> None:
    """One capability."""
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
