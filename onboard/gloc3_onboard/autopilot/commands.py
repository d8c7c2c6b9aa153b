"""Commands to one autopilot: the newest of a kind replaces older ones, each is answered, and none is sent late."""

import itertools
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3_onboard.autopilot.style import NAV_LAND, NAV_RETURN, NAV_TAKEOFF, SET_MODE, MavCommand
from gloc3_onboard.sensors.devices import CommandAnswer

KEPT: Final = 64
"""Answers that are kept."""
MODE_COMMANDS: Final = frozenset({SET_MODE, NAV_LAND, NAV_TAKEOFF, NAV_RETURN})
"""Commands that choose the mode: of these only the latest is repeated, or an older one would undo it."""
REASON_S: Final = 0.3
"""Time to wait for the reason of a refusal, s: autopilots send it as a separate text."""
AGAIN_S: Final = 0.5
"""Time between a refusal that may end soon and the next attempt, s."""
PASSING: Final = (CommandResult.FAILED, CommandResult.TEMPORARILY_REJECTED)
NO_OWNER: Final = "no autopilot is connected"


class _Sent(NamedTuple):
    """A command under way."""

    command: MavCommand
    target: Address
    sent_s: float
    """Time of the first attempt, since when texts may say why it is refused."""
    until_s: float
    """Time until which a refusal that may end is followed by another attempt."""


class CommandDesk:
    """Sends commands and stores their answers by ticket.

    A command is sent immediately or never: one that waited for an autopilot or an older command of its kind would run
    unexpectedly.

    Args:
        client: the command protocol; driven by its owner.
        texts: returns the autopilot's status texts since a time that may be reasons.
    """

    def __init__(self, client: MavCommandClient, texts: Callable[[float], list[str]]) -> None:
        self._client = client
        self._texts = texts
        self._tickets = itertools.count(1)
        self._calls: dict[int, tuple[CommandCall, _Sent]] = {}
        self._again: dict[int, tuple[float, _Sent]] = {}
        """Commands that are sent again, each at its time."""
        self._waiting: deque[tuple[int, _Sent]] = deque()
        """Commands to outputs that wait for an older one of their kind."""
        self._refused: list[tuple[float, int, CommandCall, float]] = []
        self._answers: dict[int, CommandAnswer] = {}

    def ticket(self) -> int:
        """A new ticket; callable from any thread."""
        return next(self._tickets)

    def answer(self, ticket: int) -> CommandAnswer | None:
        """The answer to a command; None if pending. Callable from any thread."""
        return self._answers.get(ticket)

    def put(self, ticket: int, answer: CommandAnswer) -> None:
        """Keeps an answer; the oldest ones make room."""
        self._answers[ticket] = answer
        while len(self._answers) > KEPT:
            del self._answers[next(iter(self._answers))]

    def send(
        self, ticket: int, command: MavCommand, target: Address | None, now_s: float, *, patience_s: float = 0.0
    ) -> None:
        """Sends a command now; it supersedes an older one of its kind under way.

        Args:
            ticket: for its answer.
            command: what to send.
            target: the autopilot; None if there is none.
            now_s: the time.
            patience_s: how long a refusal that may end soon is followed by another attempt, s.
        """
        if target is None:
            self.put(ticket, CommandAnswer(False, NO_OWNER))
            return
        for older, (_, sent) in [*self._calls.items(), *self._again.items()]:
            if sent.command.number == command.number or {sent.command.number, command.number} <= MODE_COMMANDS:
                self._drop(older, "superseded by a later command")
        self._call(ticket, _Sent(command, target, now_s, now_s + patience_s), now_s)

    def send_in_turn(self, ticket: int, command: MavCommand, target: Address | None, now_s: float) -> None:
        """Sends a command after those of its kind that are under way: it concerns another output, and replaces none."""
        if target is None:
            self.put(ticket, CommandAnswer(False, NO_OWNER))
            return
        self._waiting.append((ticket, _Sent(command, target, now_s, now_s)))
        self._send_waiting(now_s)

    def _send_waiting(self, now_s: float) -> None:
        busy = {sent.command.number for _, sent in self._calls.values()}
        for ticket, sent in list(self._waiting):
            if sent.command.number not in busy:
                busy.add(sent.command.number)
                self._waiting.remove((ticket, sent))
                self._call(ticket, sent._replace(sent_s=now_s), now_s)

    def _call(self, ticket: int, sent: _Sent, now_s: float) -> None:
        command = sent.command
        call = self._client.send_long(
            sent.target, command.number, command.parameters, now_s=now_s, is_repeatable=command.is_repeatable
        )
        self._calls[ticket] = (call, sent)

    def abandon(self, reason: str) -> None:
        """Sends nothing again."""
        for ticket in (*self._calls, *self._again, *(ticket for ticket, _ in self._waiting)):
            self._drop(ticket, reason)
        self._waiting.clear()

    def _drop(self, ticket: int, reason: str) -> None:
        if ticket in self._calls:
            self._client.abandon(self._calls.pop(ticket)[0])
        self._again.pop(ticket, None)
        self.put(ticket, CommandAnswer(False, reason))

    def ended(self, call: CommandCall, now_s: float) -> None:
        """A call has come back from the client; those that are not from here are ignored."""
        if call.result is None:
            return
        for ticket, (known, sent) in list(self._calls.items()):
            if known is not call:
                continue
            del self._calls[ticket]
            if call.result is CommandResult.ACCEPTED:
                self.put(ticket, CommandAnswer(True, ""))
            elif sent.command.instead is not None:
                self._call(ticket, sent._replace(command=sent.command.instead), now_s)
            elif call.result in PASSING and now_s + AGAIN_S <= sent.until_s:
                self._again[ticket] = (now_s + AGAIN_S, sent)
            else:
                self._refused.append((now_s + REASON_S, ticket, call, sent.sent_s))
        self._send_waiting(now_s)

    def tick(self, now_s: float) -> None:
        """Makes further attempts, and completes refusals with the autopilot's status texts."""
        for ticket, (at_s, sent) in list(self._again.items()):
            if now_s >= at_s:
                del self._again[ticket]
                self._call(ticket, sent, now_s)
        while self._refused and now_s >= self._refused[0][0]:
            _, ticket, call, sent_s = self._refused.pop(0)
            assert call.result is not None
            text = "; ".join(self._texts(sent_s))
            self.put(ticket, CommandAnswer(False, call.result.words + (f": {text}" if text else "")))
