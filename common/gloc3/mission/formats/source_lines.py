"""Comments in a converted mission that name the item, and its line in the plan, of each action and waypoint."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from msgspec import structs

from gloc3.errors import Finding
from gloc3.mission.formats.items import ForeignPlan

_ACTION: Final = re.compile(r"^      (\w+):$")
"""An action of the one task, as `dump` writes it."""
_WAYPOINT: Final = re.compile(r"^            - \[")
_COMMENT: Final = re.compile(r"  # item \d+, line (\d+)$")


def with_sources(text: str, number_of: Mapping[str, int], numbers: Sequence[int], plan: ForeignPlan) -> str:
    """A converted mission with its comments.

    Args:
        text: the mission.
        number_of: the item of each action.
        numbers: the items of all waypoints, in their order.
        plan: that it was made of.
    """
    left = iter(numbers)
    lines = []
    for line in text.splitlines():
        named = _ACTION.match(line)
        if named is not None and named[1] in number_of:
            line += _comment(number_of[named[1]], plan)
        elif _WAYPOINT.match(line):
            line += _comment(next(left), plan)
        lines.append(line)
    return "\n".join(lines) + "\n"


def _comment(number: int, plan: ForeignPlan) -> str:
    line = plan.line_of(number)
    return f"  # item {number}, line {line}" if line else f"  # item {number}"


def in_source(findings: Iterable[Finding], text: str, converted: str, file: str) -> tuple[Finding, ...]:
    """Findings about a converted mission, with the lines of the plan that it was made of.

    Args:
        findings: with lines of the mission.
        text: the mission, with its comments.
        converted: name of the mission in findings.
        file: the plan.
    """
    lines = text.splitlines()
    return tuple(_moved(one, lines, file) if one.file == converted else one for one in findings)


def _moved(finding: Finding, lines: Sequence[str], file: str) -> Finding:
    """Names the item of the line itself, or of the next one above that has an item."""
    for line in reversed(lines[: finding.line]):
        found = _COMMENT.search(line)
        if found is not None:
            return structs.replace(finding, file=file, line=int(found[1]), column=1)
    return structs.replace(finding, file=file, line=0, column=0)
