"""Requests of stations in a platform's log, each with its sender and its outcome."""

from typing import Any, Final

import msgspec

from gloc3.log.reader import LogReader
from gloc3.messages.command_interface import QUERIES, AnyBody, CiReply, CiRequest, Elsewhere
from gloc3.messages.envelope import Envelope

LONG: Final = 60
"""Characters of an argument that are shown."""
UNANSWERED: Final = "unanswered"


class CommandInfo(msgspec.Struct, frozen=True, kw_only=True):
    """One request."""

    t_s: float
    """When it was received, in seconds since boot of the clock host."""
    sender: str
    role: str
    way: str
    """The link that it came by."""
    what: str
    outcome: str
    """An `Outcome`, or that nothing was answered."""
    reason: str = ""


def list_commands(reader: LogReader, *, has_queries: bool = False) -> list[CommandInfo]:
    """Requests of a log, in the order of arrival; repeats are merged.

    Args:
        reader: the log.
        has_queries: whether requests that only read are listed, too.
    """
    requested: dict[tuple[str, int, int], tuple[float, CiRequest]] = {}
    for entry in reader.entries("ci/request"):
        request = entry.envelope.payload
        if isinstance(request, CiRequest) and not isinstance(request.body, Elsewhere):
            key = request.sender, request.boot, request.sequence
            if has_queries or not isinstance(request.body, QUERIES):
                requested.setdefault(key, (entry.now_s, request))
    answers: dict[tuple[str, int, int], Any] = {}
    for entry in reader.entries("ci/reply"):
        envelope: Envelope[Any] = entry.envelope
        reply = envelope.payload
        if isinstance(reply, CiReply):
            answers[reply.sender, reply.boot, reply.sequence] = reply
    found = []
    for key, (t_s, request) in requested.items():
        answer = answers.get(key)
        found.append(
            CommandInfo(
                t_s=t_s,
                sender=request.sender,
                role=request.role,
                way=request.way,
                what=words(request.body),
                outcome=answer.outcome if answer is not None else UNANSWERED,
                reason=answer.reason if answer is not None else "",
            )
        )
    return found


def words(body: AnyBody) -> str:
    """Short text for a request: its name, and its contents."""
    text = [_short(value) for value in msgspec.structs.asdict(body).values() if value not in ("", None, False, {}, [])]
    return " ".join([type(body).__name__, *text])


def render_commands(commands: list[CommandInfo]) -> str:
    """The list for a terminal."""
    lines = []
    for one in commands:
        who = f"{one.role} {one.sender}" + (f" ({one.way})" if one.way else "")
        outcome = one.outcome + (f": {one.reason}" if one.reason else "")
        lines.append(f"{one.t_s:10.2f} s  {who}: {one.what}: {outcome}")
    return "\n".join(lines) or "no station sent a command"


def _short(value: Any) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= LONG else f"{text[: LONG - 1]}…"
