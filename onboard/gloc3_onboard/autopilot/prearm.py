"""Has an autopilot that would not arm say why, now and then: unasked it says so rarely, or only when it is told to arm."""

from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, CommandClient
from gloc3.messages.vehicle import AutopilotState

RUN_PREARM_CHECKS: Final = 401
PERIOD_S: Final = 15.0
FIRST_S: Final = 4.0
"""After it has come: what it lacks in its first seconds is no news."""


class PrearmQuestions:
    """Asks through the client of its owner; an autopilot that does not know the question is not asked again."""

    def __init__(self, client: CommandClient) -> None:
        self._client = client
        self._asked: CommandCall | None = None
        self._is_known = True
        self._next_s: float | None = None

    def restart(self) -> None:
        """The autopilot is another one, or has restarted."""
        if self._asked is not None:
            self._client.abandon(self._asked)
        self._asked, self._is_known, self._next_s = None, True, None

    def ended(self, call: CommandCall) -> None:
        """A call has come back from the client; those that are not from here are ignored."""
        if call is self._asked and call.result is not None:
            self._asked = None
            self._is_known = call.result is not CommandResult.UNSUPPORTED

    def tick(self, target: Address, state: AutopilotState, now_s: float) -> None:
        """Asks where there is something to be told."""
        if self._next_s is None:
            self._next_s = now_s + FIRST_S
        if state.is_armed or state.is_armable or not self._is_known or self._asked is not None or now_s < self._next_s:
            return
        self._next_s = now_s + PERIOD_S
        try:
            self._asked = self._client.send_long(target, RUN_PREARM_CHECKS, now_s=now_s)
        except Refused:  # somebody else asks
            return
