"""Repeated requests to an autopilot: messages at the rates that we need, and the reasons why it cannot be armed."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3.mavlink.services.interval import REQUEST_MESSAGE, SET_MESSAGE_INTERVAL
from gloc3_onboard.autopilot.style import GPS_GLOBAL_ORIGIN, MessageStream

RETRY_S: Final = 1.0
SILENT_S: Final = 5.0
"""Time without a granted message after which it is requested again, s."""
SLOW: Final = 0.5
"""So is one that has come at less than this share of its rate for as long: stations of others set rates, too."""


class StreamRequests:
    """Requests message rates, and repeats the requests for missing messages.

    A rate is requested even if the message comes unrequested, since its rate would differ.
    """

    def __init__(self, client: MavCommandClient) -> None:
        self.refused: list[str] = []
        """Reasons of refused messages since the list was last emptied; these are not requested again."""
        self._client = client
        self._waiting: deque[MessageStream] = deque()
        self._promised: dict[int, MessageStream] = {}
        self._received_s: dict[int, float] = {}
        self._counts: dict[int, tuple[float, int]] = {}
        """Since when messages are counted, and how many have come."""
        self._requested: tuple[MessageStream, CommandCall] | None = None
        self._next_s = 0.0

    def request_all(self, streams: Sequence[MessageStream]) -> None:
        """Asks for everything, as at the begin and after a restart of the autopilot."""
        if self._requested is not None:
            self._client.abandon(self._requested[1])
        self._requested, self._next_s = None, 0.0
        self._waiting = deque(streams)
        self._promised.clear()

    def request(self, stream: MessageStream) -> None:
        """Asks for one more message, or for one at another rate."""
        self._promised.pop(stream.message_id, None)
        self._waiting.append(stream)

    def received(self, message_id: int, now_s: float) -> None:
        """A message has come."""
        self._received_s[message_id] = now_s
        since_s, count = self._counts.get(message_id, (now_s, 0))
        self._counts[message_id] = since_s, count + 1

    def ended(self, call: CommandCall, now_s: float) -> None:
        """A call has come back from the client; those that are not from here are ignored."""
        if self._requested is None or call is not self._requested[1] or call.result is None:
            return
        stream, self._requested = self._requested[0], None
        if call.result is CommandResult.ACCEPTED:
            self._promised[stream.message_id] = stream
            self._received_s[stream.message_id] = now_s
            self._counts[stream.message_id] = now_s, 0
        elif call.result in (CommandResult.NO_ANSWER, CommandResult.TEMPORARILY_REJECTED):
            self._waiting.append(stream)
            self._next_s = now_s + RETRY_S
        else:
            name = codec.name_of(stream.message_id) or f"message {stream.message_id}"
            self.refused.append(f"to send {name} at {stream.rate_hz:g} Hz: {call.result.words}")

    def tick(self, target: Address, now_s: float) -> None:
        """Asks for the next one."""
        if self._requested is not None or now_s < self._next_s:
            return
        if not self._waiting:
            self._next_s = now_s + RETRY_S
            for number in [n for n, stream in self._promised.items() if self._is_missing(stream, now_s)]:
                self._waiting.append(self._promised.pop(number))
        if self._waiting:
            stream = self._waiting.popleft()
            values = (float(stream.message_id), 1e6 / stream.rate_hz)
            try:
                self._requested = stream, self._client.send_long(target, SET_MESSAGE_INTERVAL, values, now_s=now_s)
            except Refused:  # somebody else asks for one
                self._waiting.appendleft(stream)

    def _is_missing(self, stream: MessageStream, now_s: float) -> bool:
        """Whether a message stays away, or comes too seldom."""
        number = stream.message_id
        since_s, count = self._counts[number]
        if now_s - since_s <= SILENT_S:
            return now_s - self._received_s[number] > SILENT_S
        self._counts[number] = now_s, 0
        return count < SLOW * stream.rate_hz * (now_s - since_s)


class RepeatedRequest:
    """Sends one command periodically while needed; stops if the autopilot does not support it.

    Args:
        client: sends the command.
        command: MAV_CMD.
        values: its parameters.
        first_s: delay from the autopilot's appearance to the first command.
        period_s: period of the repetitions.
    """

    def __init__(
        self, client: MavCommandClient, command: int, values: tuple[float, ...] = (), *, first_s: float, period_s: float
    ) -> None:
        self._client, self._command, self._values = client, command, values
        self._first_s, self._period_s = first_s, period_s
        self._requested: CommandCall | None = None
        self._is_known = True
        self._next_s: float | None = None

    def restart(self) -> None:
        """The autopilot is another one, or has restarted."""
        if self._requested is not None:
            self._client.abandon(self._requested)
        self._requested, self._is_known, self._next_s = None, True, None

    def ended(self, call: CommandCall) -> None:
        """A call has come back from the client; those that are not from here are ignored."""
        if call is self._requested and call.result is not None:
            self._requested = None
            self._is_known = call.result is not CommandResult.UNSUPPORTED

    def tick(self, target: Address, now_s: float, *, is_wanted: bool) -> None:
        """Sends it where it is due."""
        if self._next_s is None:
            self._next_s = now_s + self._first_s
        if not is_wanted or not self._is_known or self._requested is not None or now_s < self._next_s:
            return
        self._next_s = now_s + self._period_s
        try:
            self._requested = self._client.send_long(target, self._command, self._values, now_s=now_s)
        except Refused:  # somebody else sends one
            return


def prearm_checks(client: MavCommandClient) -> RepeatedRequest:
    """Requests the reasons against arming. Those of an autopilot's first seconds are ignored."""
    return RepeatedRequest(client, 401, first_s=4.0, period_s=15.0)  # RUN_PREARM_CHECKS


def origin_request(client: MavCommandClient) -> RepeatedRequest:
    """Requests the origin of the local frame, which PX4 sends unasked only when it changes."""
    return RepeatedRequest(client, REQUEST_MESSAGE, (float(GPS_GLOBAL_ORIGIN),), first_s=0.5, period_s=2.0)
