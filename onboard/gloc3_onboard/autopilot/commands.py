"""Commands to one autopilot: the newest of a kind replaces older ones, each is answered, and none is sent late."""

import itertools
from collections.abc import Callable
from typing import Final

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3_onboard.autopilot.style import MavCommand
from gloc3_onboard.sensors.devices import CommandAnswer

KEPT: Final = 64
"""Answers that are kept."""
REASON_S: Final = 0.3
"""Time to wait for the reason of a refusal, s: autopilots send it as a separate text."""
NO_OWNER: Final = "no autopilot is connected"


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
        self._calls: dict[int, tuple[CommandCall, float]] = {}
        """Commands under way, with the time at which each was sent."""
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

    def send(self, ticket: int, command: MavCommand, target: Address | None, now_s: float) -> None:
        """Sends a command now; it supersedes an older one of its kind under way."""
        if target is None:
            self.put(ticket, CommandAnswer(False, NO_OWNER))
            return
        for older, (call, _) in list(self._calls.items()):
            if call.command == command.number:
                self._drop(older, "superseded by a later command")
        call = self._client.send_long(target, command.number, command.parameters, now_s=now_s)
        self._calls[ticket] = (call, now_s)

    def abandon(self, reason: str) -> None:
        """Sends nothing again."""
        for ticket in list(self._calls):
            self._drop(ticket, reason)

    def _drop(self, ticket: int, reason: str) -> None:
        self._client.abandon(self._calls.pop(ticket)[0])
        self.put(ticket, CommandAnswer(False, reason))

    def ended(self, call: CommandCall, now_s: float) -> None:
        """A call has come back from the client; those that are not from here are ignored."""
        if call.result is None:
            return
        for ticket, (known, sent_s) in list(self._calls.items()):
            if known is not call:
                continue
            del self._calls[ticket]
            if call.result is CommandResult.ACCEPTED:
                self.put(ticket, CommandAnswer(True, ""))
            else:
                self._refused.append((now_s + REASON_S, ticket, call, sent_s))

    def tick(self, now_s: float) -> None:
        """Completes refusals with the autopilot's status texts."""
        while self._refused and now_s >= self._refused[0][0]:
            _, ticket, call, sent_s = self._refused.pop(0)
            assert call.result is not None
            text = "; ".join(self._texts(sent_s))
            self.put(ticket, CommandAnswer(False, call.result.words + (f": {text}" if text else "")))
