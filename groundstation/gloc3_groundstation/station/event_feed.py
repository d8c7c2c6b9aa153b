"""Events of platforms in order, each shown once; those missed while out of contact are requested."""

from collections.abc import Iterator, Mapping
from typing import Final

import msgspec

from gloc3.messages.command_interface import CiReply, Outcome, ReadReports
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import CiEvent, ContactSummary

REQUEST_AGAIN_S: Final = 3.0
"""Delay before an unanswered request is repeated, s, once the platform is in contact."""
PAGE: Final = 40
SUMMARY_WITHIN_S: Final = 2.0
REPORTED_SILENCE_S: Final = 3.0
"""Age from which an event is shown with its age, s."""


class FeedEvent(msgspec.Struct, frozen=True):
    """An event that is to be shown now."""

    severity: Severity
    source: str
    text: str
    age_s: float
    """Age of the event on arrival, as far as it is known; 0 for a current one."""
    cause: str = ""
    """What it follows from; empty for what stands for itself."""


class _Row(msgspec.Struct, frozen=True, array_like=True):
    number: int
    severity: int
    source: str
    text: str
    t_s: float
    cause: str = ""


class Cursor(msgspec.Struct, frozen=True):
    """Up to where a platform's events have been shown; it outlives the station."""

    store: int
    number: int


class _Line:
    """One platform's events."""

    def __init__(self, cursor: Cursor | None) -> None:
        self.store = cursor.store if cursor is not None else 0
        self.shown: int | None = cursor.number if cursor is not None else None
        """All up to this number have been shown; None as long as that is not known."""
        self.early: dict[int, CiEvent] = {}
        """What came before its turn."""
        self.at_once: set[int] = set()
        """Events shown before it was known which ones are missing."""
        self.last = 0
        """Highest known number."""
        self.requested_s = float("-inf")
        self.is_requesting = False
        self.needs_receipt = False
        self.held_until_s = float("-inf")
        """After a silence, events are held until this time, so that the summary is shown first."""

    def begin(self, store: int) -> None:
        """Handles a new numbering of the platform's events."""
        self.store, self.shown, self.last = store, None, 0
        self.early.clear()
        self.at_once.clear()


class EventFeed:
    """Event feed without I/O: orders received events for display, and requests missing ones.

    Args:
        cursors: last events of each platform that an earlier life of the station has shown.
    """

    def __init__(self, cursors: Mapping[str, Cursor] | None = None) -> None:
        self._lines = {name: _Line(cursor) for name, cursor in (cursors or {}).items()}

    def cursors(self) -> dict[str, Cursor]:
        """Up to where the events of each platform have been shown."""
        lines = self._lines.items()
        return {name: Cursor(line.store, line.shown) for name, line in lines if line.shown is not None}

    def note_contact(self, platform: str, now_s: float) -> None:
        """Handles a new contact after a silence: the summary of the platform's state is shown first."""
        if platform in self._lines:
            self._lines[platform].held_until_s = now_s + SUMMARY_WITHIN_S

    def missing(self, platform: str) -> int:
        """How many events are known to have happened, and were not shown."""
        line = self._lines.get(platform)
        return 0 if line is None or line.shown is None else max(0, line.last - line.shown)

    def is_behind(self, platform: str, now_s: float) -> bool:
        """Whether something that happened out of contact is still to be shown, the summary first of all."""
        line = self._lines.get(platform)
        return line is not None and (now_s < line.held_until_s or self.missing(platform) > 0)

    def release(self, platform: str, now_s: float) -> list[FeedEvent]:
        """What was held back for a summary that has not come."""
        line = self._lines.get(platform)
        if line is None or line.shown is None or not line.early or now_s < line.held_until_s:
            return []
        return list(self._drain(line))

    def event(self, platform: str, event: CiEvent, now_s: float) -> list[FeedEvent]:
        """Handles an event; returns the events to show now, in order."""
        if not event.number:
            return [_now(event)]
        line = self._line(platform, event.store)
        line.last = max(line.last, event.number)
        if line.shown is None:  # nothing is known of what was before: it is not held back for that
            if event.number in line.at_once:
                return []
            line.at_once.add(event.number)
            return [_now(event)]
        if event.number > line.shown:
            line.early[event.number] = event
        return [] if now_s < line.held_until_s else list(self._drain(line))

    def contact(self, platform: str, contact: ContactSummary) -> list[FeedEvent]:
        """Handles a platform's state summary at the start of a contact."""
        line = self._line(platform, contact.store)
        if line.shown is None:
            line.shown = contact.delivered
        line.held_until_s = float("-inf")
        line.needs_receipt = line.needs_receipt or contact.delivered < line.shown
        line.last = max(line.last, contact.last)
        line.requested_s = float("-inf")
        return list(self._drain(line))

    def wanted(self, platform: str, now_s: float) -> ReadReports | None:
        """Request to send to a platform now; None while nothing is missing, or a request is under way."""
        line = self._lines.get(platform)
        if line is None or line.shown is None or line.is_requesting or now_s < line.requested_s + REQUEST_AGAIN_S:
            return None
        if line.last <= line.shown and not line.needs_receipt:
            return None
        line.is_requesting, line.requested_s = True, now_s
        return ReadReports(store=line.store, after=line.shown, most=PAGE)

    def answered(
        self, platform: str, requested: ReadReports, reply: CiReply, platform_s: float | None
    ) -> list[FeedEvent]:
        """Handles the answer to a request; returns the events to show now, in order.

        Args:
            platform: its name.
            requested: the request.
            reply: the answer.
            platform_s: the platform's time; None where it is unknown.
        """
        line = self._lines[platform]
        line.is_requesting = False
        if reply.outcome is not Outcome.ACCEPTED or line.store != requested.store or line.shown is None:
            return []
        line.requested_s = float("-inf")
        try:
            rows = msgspec.convert(reply.result.get("reports"), list[_Row])
            store, last = msgspec.convert((reply.result.get("store"), reply.result.get("last")), tuple[int, int])
        except msgspec.ValidationError as error:
            line.needs_receipt, line.last = False, line.shown
            text = f"what {platform} has kept cannot be read: {error}"
            return [FeedEvent(Severity.WARNING, "", text, 0.0)]
        if store != line.store:
            line.begin(store)
            line.shown = 0
        line.last = max(line.last, last)
        reported: list[FeedEvent] = []
        for row in rows:
            lost = row.number - line.shown - 1
            if lost < 0:
                continue
            if lost and (missing := lost - sum(line.shown < number < row.number for number in line.early)):
                reported.append(FeedEvent(Severity.WARNING, "", f"{missing} events before were not kept onboard", 0.0))
            reported += self._drain(line, below=row.number)
            if row.number <= line.shown:
                continue
            line.early.pop(row.number, None)
            line.shown = row.number
            age_s = 0.0 if platform_s is None else max(0.0, platform_s - row.t_s)
            if row.number not in line.at_once:
                reported.append(FeedEvent(Severity(row.severity), row.source, row.text, age_s, row.cause))
        reported += self._drain(line)
        if not rows:
            line.last = max([line.shown, *line.early])
        line.needs_receipt = bool(rows) and line.last <= line.shown
        return reported

    def _line(self, platform: str, store: int) -> _Line:
        line = self._lines.setdefault(platform, _Line(None))
        if line.store != store:
            line.begin(store)
        return line

    @staticmethod
    def _drain(line: _Line, below: int | None = None) -> Iterator[FeedEvent]:
        """Events whose turn has come; with `below`, all early ones up to that number."""
        assert line.shown is not None
        if below is not None:
            for number in sorted(number for number in line.early if number < below):
                line.shown = number
                if number not in line.at_once:
                    yield _now(line.early[number])
        while line.shown + 1 in line.early:
            line.shown += 1
            if line.shown not in line.at_once:
                yield _now(line.early[line.shown])
        for number in [number for number in line.early if number <= line.shown]:
            del line.early[number]
        if line.at_once and max(line.at_once) <= line.shown:
            line.at_once.clear()


def _now(event: CiEvent) -> FeedEvent:
    return FeedEvent(event.severity, event.source, event.text, 0.0, event.cause)


def with_age(reported: FeedEvent, age: str) -> str:
    """Text of an event, with its age where it is old."""
    return f"{reported.text} ({age} ago)" if reported.age_s >= REPORTED_SILENCE_S else reported.text
