"""`docs/reference/events.md`: what vehicles and stations report, with its severity, and the conditions of alerts."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from tests.house.table import as_text, table
from tests.house.texts import Function, ModuleTexts, assigned

from gloc3.messages.envelope import Severity

ROOT: Final = Path(__file__).parents[2]
SOURCES: Final = ("common", "onboard", "groundstation")
CHAPTERS: Final = (
    ("gloc3.component", "Every component"),
    ("gloc3.mission.executing", "Missions"),
    ("gloc3_onboard.command_server", "The command interface server"),
    ("gloc3_onboard.autopilot", "The autopilot"),
    ("gloc3_onboard.companion", "Links and landing watchdog"),
    ("gloc3_onboard", "The onboard processes"),
    ("gloc3_groundstation", "The station"),
)
"""Beginnings of modules, the longer ones first, with titles."""
HEAD: Final = """\
An event has a severity of MAVLink, a source and a text. The source is a component, or `mission`, `supervision`,
`autopilot_link`, `companion`, `station_link` or `network`; events of the station itself have none. Component events of
severity notice and worse reach the stations (`event_severity` of `command_server`), and all are in the log
(`gloc3 log info RUN --events`). Warnings and worse are also alerts.

`{name}` and `…` stand for what differs from case to case. Of several severities, the case decides. Errors of a component
are events with the text of the error, and are not listed.
"""
ALERTS_HEAD: Final = """\
An alert of the list below lasts as long as its cause, and until it is acknowledged. Other packages add theirs by the
[entry point](entry-points.md) `gloc3.alert_rules`.
"""
REPORTERS: Final = (
    *("event", "report", "_report", "report_supervision", "_report_text", "_refuse_text"),
    *("note", "_note"),
)
"""Functions that take a severity and then a text."""
MESSAGES: Final = ("Event", "CiEvent", "MissionEvent", "FeedEvent")
"""Messages with a severity and a text."""
ALERTS: Final = ("AlertCause", "VehicleProblem")
"""Alerts: their name, severity and text are the last three values."""

OWN: Final = "its own"
"""Severity of what others have sent."""


class EventRow(NamedTuple):
    """One row of the page."""

    severity: str
    says: str
    name: str = ""
    """Of an alert."""


def lines() -> Iterator[str]:
    """The page."""
    yield HEAD
    for title, found in events().items():
        yield f"## {title}\n"
        yield from table(("severity", "text"), ((row.severity, as_text(row.says)) for row in found))
    yield "## Alerts\n"
    yield ALERTS_HEAD
    cells = ((as_text(row.name), row.severity, as_text(row.says)) for row in alerts())
    yield from table(("alert", "severity", "text"), cells)


def events() -> dict[str, list[EventRow]]:
    """Events by the title of their chapter."""
    found: dict[str, set[EventRow]] = {title: set() for _, title in CHAPTERS}
    for name, reported in _reported().items():
        title = next((title for begin, title in CHAPTERS if f"{name}.".startswith(f"{begin}.")), None)
        if title is not None:
            found[title].update(row for row in reported if not row.name)
    return {title: sorted(some, key=_order) for title, some in found.items()}


def alerts() -> list[EventRow]:
    """Conditions of the station's alerts."""
    found = {row for reported in _reported().values() for row in reported if row.name}
    return sorted(found, key=lambda row: (row.name, *_order(row)))


@cache
def _reported() -> dict[str, list[EventRow]]:
    """What each module reports."""
    return {name: list(rows(name, text)) for name, text in _modules()}


def rows(module: str, source: str) -> Iterator[EventRow]:
    """What the calls in a module report; what only passes on a text of others is left out.

    Args:
        module: its name.
        source: its text.
    """
    tree = ast.parse(source)
    texts = ModuleTexts(module, tree)
    for function in ast.walk(tree):
        if isinstance(function, Function):
            for call in ast.walk(function):
                if isinstance(call, ast.Call) and (parts := _parts(call)) is not None:
                    name, severity, text = parts
                    levels = _severities(severity, function)
                    if name is not None and not levels:
                        levels = [OWN]
                    for says in texts.of(text, function) if levels else ():
                        if not re.fullmatch(r"\{\w+\}|…", says):
                            yield EventRow(", ".join(levels), says, _label(name, function, texts))


def _parts(call: ast.Call) -> tuple[ast.expr | None, ast.expr, ast.expr] | None:
    """Name (of an alert), severity and text of a call."""
    function = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    named = {one.arg: one.value for one in call.keywords if one.arg}
    if function in ALERTS:
        values = [*call.args, *named.values()]
        return values[-3], values[-2], values[-1]
    if function in MESSAGES and "severity" in named:
        return None, named["severity"], named["text"]
    if function in REPORTERS:
        for severity, text in zip(call.args, call.args[1:], strict=False):
            if _may_be_severity(severity):
                return None, severity, text
    return None


def _may_be_severity(node: ast.expr) -> bool:
    if isinstance(node, ast.Call):
        return getattr(node.func, "id", "") == "Severity"
    return (isinstance(node, ast.Name) and node.id == "severity") or bool(_levels(node))


def _levels(node: ast.AST) -> list[str]:
    return [
        one.attr.lower()
        for one in ast.walk(node)
        if isinstance(one, ast.Attribute) and isinstance(one.value, ast.Name) and one.value.id == "Severity"
    ]


def _severities(node: ast.expr, function: Function) -> list[str]:
    """The severities that an expression may have, the worst first."""
    if isinstance(node, ast.Call):
        return [OWN]
    found = _levels(node)
    if isinstance(node, ast.Name):
        given = assigned(node.id, function, node.lineno)
        if any(isinstance(one, ast.Call) for one in given):
            return [OWN]
        found = [level for one in given for level in _levels(one)]
    return sorted(set(found), key=lambda level: Severity[level.upper()])


def _label(name: ast.expr | None, function: Function, texts: ModuleTexts) -> str:
    """Name of an alert: a text, or the members of `Cause` that it may be."""
    if name is None:
        return ""
    members = [
        one.attr.lower()
        for one in ast.walk(name)
        if isinstance(one, ast.Attribute) and isinstance(one.value, ast.Name) and one.value.id == "Cause"
    ]
    if isinstance(name, ast.Call) and getattr(name.func, "id", "") == "component_cause":
        return "component {name}"
    return " or ".join(members) or " or ".join(texts.of(name, function))


def _order(row: EventRow) -> tuple[int, str]:
    worst = row.severity.split(",")[0]
    return Severity.DEBUG + 1 if worst == OWN else Severity[worst.upper()], row.says


def _modules() -> Iterator[tuple[str, str]]:
    """Names and texts of the modules."""
    for package in SOURCES:
        for file in sorted((ROOT / package).rglob("*.py")):
            module = ".".join(file.relative_to(ROOT / package).with_suffix("").parts).removesuffix(".__init__")
            text = file.read_text(encoding="utf-8")
            if "Severity." in text or any(f"{alert}(" in text for alert in ALERTS):
                yield module, text
