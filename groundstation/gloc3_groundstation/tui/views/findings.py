"""Findings of the mission check, each with its position."""

from typing import Final, NamedTuple

from gloc3.errors import Finding
from gloc3_groundstation.missions.draft import Draft
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, wrapped

PLACE: Final = 8


class FindingRow(NamedTuple):
    """A line of the list; `number` counts the findings from 0, -1 in the further lines of one."""

    line: Line
    number: int


def findings_title(draft: Draft | None, *, is_checking: bool) -> str:
    """State of the check: errors and warnings, or why there is none."""
    if draft is None:
        return ""
    if is_checking:
        return "being checked…"
    warnings = len(draft.requested) - draft.errors
    also = f", {warnings} warning{'s' if warnings > 1 else ''}" if warnings else ""
    if draft.is_fixed:
        return f"this cannot be read as a mission{also}"
    if draft.errors:
        return f"{draft.errors} error{'s' if draft.errors > 1 else ''}{also}"
    return f"fit to fly{f' on {draft.platform}' if draft.platform else ''}{also}"


def finding_rows(draft: Draft | None, width: int) -> list[FindingRow]:
    """Findings; the first line of each has its position `line:column`."""
    if draft is None:
        return []
    if not draft.requested:
        text = "no findings" if draft.platform else "no findings in the file itself"
        return [FindingRow((Span(f" {text}", Tone.GOOD),), -1)]
    rows: list[FindingRow] = []
    for index, finding in enumerate(draft.requested):
        rows += _rows(finding, index, width)
    return rows


def _rows(finding: Finding, index: int, width: int) -> list[FindingRow]:
    place = f"{finding.line}:{finding.column}" if finding.line else "file"
    sign, tone = ("▲", Tone.WARN) if finding.is_warning else ("✗", Tone.BAD)
    text = finding.message + (f" ({finding.hint})" if finding.hint else "")
    texts = wrapped(" ".join(text.split()), max(16, width - PLACE - 4))
    first = FindingRow((Span(f" {sign} ", tone), Span(f"{place:<{PLACE}}", tone), Span(texts[0])), index)
    rest = [FindingRow((Span(" " * (PLACE + 3)), Span(text)), -1) for text in texts[1:]]
    return [first, *rest]
