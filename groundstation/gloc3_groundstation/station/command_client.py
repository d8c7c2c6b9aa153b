"""Client of the command interface: a station's requests to platforms, over any exchange and clock."""

import asyncio
import re
from typing import Any, Final

from msgspec.structs import replace

from gloc3.errors import Finding, Gloc3Error, NoContact, Refused
from gloc3.exchange.base import Exchange, Publisher
from gloc3.exchange.tunnel.events import Undelivered
from gloc3.messages.command_interface import (
    QUERIES,
    AnyBody,
    CiReply,
    CiRequest,
    Control,
    ControlVerb,
    Emergency,
    EmergencyVerb,
    Hello,
    LoadMission,
    Outcome,
    Query,
    ReadMission,
    RequestTask,
    StationRole,
    Steer,
    Verb,
)
from gloc3.messages.envelope import Envelope
from gloc3.messages.software import own_software
from gloc3.messages.teleoperation import VelocityDemand
from gloc3.network.platform_clocks import PlatformClocks

PATIENCE_S: Final = 2.0
"""Longest wait for a reply before it is queried."""
SLOWEST_BYTES_S: Final = 1000.0
"""Assumed rate for a mission's text, so that its reply is not queried while it is still being sent."""
TIMEOUT_S: Final = 16.0
"""Longer than the link's retries, so that nothing is executed after the operator was shown *unknown*."""
EMERGENCY_TIMEOUT_S: Final = 6.0
"""The same for emergencies, which the link gives up sooner."""

NOT_DELIVERED: Final = "not delivered"
_FINDING: Final = re.compile(r"(?P<file>.+?):(?P<line>\d+):(?P<column>\d+): (?P<warning>warning: )?(?P<message>.*)")

_Key = tuple[str, int]
"""Platform and sequence of a request."""


class Unanswered(NoContact):
    """The outcome of a request is unknown."""


class ReadBackDiffers(Gloc3Error):
    """The platform does not hold the mission that was sent to it."""


class Declined(Refused):
    """A platform turned a request down; the reply may hold more than the reason."""

    def __init__(self, reply: CiReply) -> None:
        findings = f"\n{reply.text}" if reply.text and reply.text != reply.reason else ""
        super().__init__(f"{reply.reason or 'no reason was given'}{findings}")
        self.reply: Final = reply


class NotDelivered(Declined, NoContact):
    """A request has certainly never reached the platform."""


class CheckFailed(Declined):
    """The platform's own check has found errors in a mission."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What it has found, in the order of the mission."""
        return tuple(map(_finding, self.reply.text.splitlines()))


class _Pending:
    """A request that waits for its reply."""

    def __init__(self, request: CiRequest, times: tuple[float, float, float], future: asyncio.Future[CiReply]) -> None:
        self.request: Final = request
        self.future: Final = future
        self.wait_s, self.timeout_s, now_s = times
        self.next_s = now_s + self.wait_s
        self.deadline_s: Final = now_s + self.timeout_s
        self.times_sent = 1
        self.given_up = ""
        """Why the link gave it up, where it may have arrived all the same."""


class CommandClient:
    """Client of the command interface: one for a station, for all platforms that it commands.

    A request is identified by `(sender, boot, sequence)`, counted for each platform; it is never executed twice. When
    its reply is late, the client queries the outcome (`Query`); only if the request never arrived it is sent again,
    with the same id. Without an outcome at the timeout it ends as *unknown*. When the link gives a request up, it ends
    as *refused* if it was certainly never delivered; otherwise the outcome is queried at once. A request carries its
    time limit by the platform's clock: the platform does not carry it out after the operator was shown *unknown*.
    """

    def __init__(self, exchange: Exchange, loop: asyncio.AbstractEventLoop, station: str, boot: int) -> None:
        """Creates a client.

        Args:
            exchange: reaches the platforms.
            loop: the event loop, for time and timers.
            station: the station's id, such as `255`.
            boot: a random number for this start of the station.
        """
        self.station: Final = station
        self.role = StationRole.OPERATOR
        """Role of the station, as far as it is known here; the platforms check it themselves."""
        self._loop, self._boot = loop, boot
        self._publisher = Publisher(exchange, f"station_{station}", "command_client", boot)
        self._sequences: dict[str, int] = {}
        self._pending: dict[_Key, _Pending] = {}
        self._queries: dict[_Key, _Key] = {}
        """Questions to the requests that they are about."""
        self._timer: asyncio.TimerHandle | None = None
        self._sessions = 0
        self._clocks = PlatformClocks()
        self._unsubscribe = [
            exchange.subscribe("*/ci/reply", self._receive),
            exchange.subscribe("*/ci/summary", lambda envelope: self._clocks.receive(envelope, loop.time())),
        ]
        self._withdraw = exchange.declare_alive(f"stations/{station}")

    def close(self) -> None:
        """Stops receiving replies; waiting requests are cancelled."""
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        self._withdraw()
        if self._timer is not None:
            self._timer.cancel()
        for pending in self._pending.values():
            pending.future.cancel()
        self._pending.clear()

    async def request(self, platform: str, body: AnyBody, timeout_s: float = TIMEOUT_S) -> CiReply:
        """Sends a request and waits for what became of it.

        Returns:
            The reply. Its outcome is *unknown*, with the reason, where none came within `timeout_s`.
        """
        if self.role is StationRole.OBSERVER and not isinstance(body, QUERIES):
            reason = f"station {self.station} may look and not command: it is an observer"
            return CiReply(sender=self.station, boot=0, sequence=-1, outcome=Outcome.REFUSED, reason=reason)
        request, patience_s = self._new(platform, body, timeout_s), PATIENCE_S
        if isinstance(body, LoadMission | RequestTask):
            patience_s += len(body.text.encode()) / SLOWEST_BYTES_S
        key, times = (platform, request.sequence), (patience_s, timeout_s, self._loop.time())
        pending = self._pending[key] = _Pending(request, times, self._loop.create_future())
        self._send(platform, request)
        self._tick()
        try:
            return await pending.future
        finally:
            self._drop(key)

    def send(self, platform: str, body: AnyBody) -> None:
        """Sends a message that needs no answer."""
        self._send(platform, self._new(platform, body))

    def demand(self, platform: str, demand: VelocityDemand) -> None:
        """Sends a velocity demand of manual control; it arrives at once or not at all."""
        self._publisher.publish(f"{platform}/velocity_demand", demand, self._loop.time())

    def new_session(self) -> int:
        """A number for the demands of one time at the keys, which no other has."""
        self._sessions += 1
        return (self._boot + self._sessions) & 0xFFFFFFFF

    async def carry_out(self, platform: str, body: AnyBody, timeout_s: float = TIMEOUT_S) -> CiReply:
        """Sends a request that has to be accepted.

        Raises:
            Declined: the platform refused it.
            Unanswered: it is unknown whether it was executed.
        """
        reply = await self.request(platform, body, timeout_s)
        if reply.outcome is Outcome.ACCEPTED:
            return reply
        if reply.outcome is Outcome.REFUSED:
            raise NotDelivered(reply) if reply.reason.startswith(NOT_DELIVERED) else Declined(reply)
        raise Unanswered(reply.reason or f"{platform} does not know the outcome of the request ({reply.outcome})")

    def undelivered(self, lost: Undelivered) -> None:
        """Handles a message that the links have given up.

        For a request that was sent more than once, a certain loss does not cover the other times.
        """
        request = lost.envelope.payload
        if not isinstance(request, CiRequest):
            return
        key = lost.envelope.topic.partition("/")[0], request.sequence
        pending = self._pending.get(key)
        if pending is None or pending.request != request:
            return
        if lost.is_certain and pending.times_sent == 1 and not pending.given_up:
            self._end(key, self._ended_as(Outcome.REFUSED, request, f"{NOT_DELIVERED}: {lost.reason}"))
        else:
            pending.given_up, pending.next_s = lost.reason, self._loop.time()
        self._tick()

    # --- what operators ask for most; all raise as `carry_out` does ---

    async def upload(self, platform: str, name: str, text: str, *, amends: str = "") -> None:
        """Streams a mission, reads it back and compares.

        Args:
            platform: its name.
            name: of the mission's file.
            text: the mission.
            amends: digest of the running mission that goes on by this text; empty to load another mission.

        Raises:
            CheckFailed: the platform has found errors in it.
            ReadBackDiffers: the platform holds something else.
        """
        timeout_s = 3.0 * (TIMEOUT_S + len(text.encode()) / SLOWEST_BYTES_S)
        try:
            await self.carry_out(platform, LoadMission(name=name, text=text, amends=amends), timeout_s)
        except Declined as refusal:
            raise CheckFailed(refusal.reply) if refusal.reply.text else refusal from None
        reply = await self.carry_out(platform, ReadMission(), timeout_s)
        if reply.text != text:
            raise ReadBackDiffers(
                f"{platform} holds another mission than the one that was sent: {_differ(text, reply.text)}"
            )

    async def request_control(self, platform: str, *, is_take_over: bool = False) -> CiReply:
        """Asks for control, which the holder may have to grant first; a take-over does not wait for its leave."""
        verb = ControlVerb.TAKE_OVER if is_take_over else ControlVerb.REQUEST
        return await self.carry_out(platform, Control(verb=verb, **own_software()._asdict()))

    async def steer(self, platform: str, verb: Verb, target: str = "", *, override: str = "", author: str = "") -> None:
        """Starts, pauses, resumes, skips or aborts the mission, a `TASK` or a `TASK.ACTION`.

        With a start, an override says why it shall begin although checks are red; it is logged with its author.
        """
        await self.carry_out(platform, Steer(verb=verb, target=target, override=override, author=author))

    async def emergency(self, platform: str, verb: EmergencyVerb, confirmation: str = "") -> None:
        """Sends an action of the emergency key; needs no control."""
        author = f"station {self.station}"
        body = Emergency(verb=verb, author=author, confirmation=confirmation)
        await self.carry_out(platform, body, EMERGENCY_TIMEOUT_S)

    async def hello(self, platform: str) -> None:
        """Requests the full state, which is published on the platform's topics."""
        await self.carry_out(platform, Hello(**own_software()._asdict()))

    # --- requests under way ---

    def _new(self, platform: str, body: AnyBody, timeout_s: float = TIMEOUT_S) -> CiRequest:
        sequence = self._sequences.get(platform, 0)
        self._sequences[platform] = sequence + 1
        until_s = self._clocks.until_s(platform, self._loop.time(), timeout_s)
        return CiRequest(sender=self.station, boot=self._boot, sequence=sequence, body=body, until_s=until_s)

    def _send(self, platform: str, request: CiRequest) -> None:
        self._publisher.publish(f"{platform}/ci/request", request, self._loop.time())

    def _receive(self, envelope: Envelope[Any]) -> None:
        """Handles a reply; one that is not for this station, or for nothing that waits, is ignored."""
        reply = envelope.payload
        if not isinstance(reply, CiReply) or (reply.sender, reply.boot) != (self.station, self._boot):
            return
        key = envelope.topic.partition("/")[0], reply.sequence
        requested = self._queries.pop(key, None)
        pending = self._pending.get(requested) if requested is not None else None
        if key in self._pending:
            self._end(key, reply)
        elif requested is not None and pending is not None:
            if reply.outcome is not Outcome.UNKNOWN:
                self._end(requested, replace(reply, sequence=pending.request.sequence))
            else:  # it never arrived
                pending.next_s = self._loop.time() + pending.wait_s
                pending.times_sent += 1
                self._send(requested[0], pending.request)
        self._tick()

    def _tick(self) -> None:
        """Queries late replies, times out old requests, and sets the timer."""
        now_s = self._loop.time()
        for key, pending in list(self._pending.items()):
            if pending.future.done():  # answered while another was sent
                continue
            if now_s >= pending.deadline_s:
                reason = f"{key[0]} has not answered for {pending.timeout_s:g} s"
                if pending.given_up:
                    reason = f"it may have been delivered ({pending.given_up}), and {reason}"
                self._end(key, self._ended_as(Outcome.UNKNOWN, pending.request, reason))
            elif now_s >= pending.next_s:
                pending.next_s = now_s + PATIENCE_S
                query = self._new(key[0], Query(boot=self._boot, sequence=key[1]))
                self._queries[key[0], query.sequence] = key
                self._send(key[0], query)
        if self._timer is not None:
            self._timer.cancel()
        next_s = min((min(one.next_s, one.deadline_s) for one in self._pending.values()), default=None)
        self._timer = None if next_s is None else self._loop.call_at(next_s, self._tick)

    def _ended_as(self, outcome: Outcome, request: CiRequest, reason: str) -> CiReply:
        return CiReply(sender=self.station, boot=self._boot, sequence=request.sequence, outcome=outcome, reason=reason)

    def _end(self, key: _Key, reply: CiReply) -> None:
        future = self._pending[key].future
        self._drop(key)
        if not future.done():
            future.set_result(reply)

    def _drop(self, key: _Key) -> None:
        """Nobody waits for this reply any more."""
        self._pending.pop(key, None)
        self._queries = {query: requested for query, requested in self._queries.items() if requested != key}


def _finding(line: str) -> Finding:
    """A finding from its line, as `Finding` writes it; a line in another form is its message."""
    found = _FINDING.fullmatch(line)
    if found is None:
        return Finding(file="", message=line)
    return Finding(
        file=found["file"],
        line=int(found["line"]),
        column=int(found["column"]),
        message=found["message"],
        is_warning=found["warning"] is not None,
    )


def _differ(sent: str, held: str) -> str:
    """Where two texts begin to differ."""
    ours, theirs = sent.splitlines(), held.splitlines()
    for number, (our, their) in enumerate(zip(ours, theirs, strict=False), start=1):
        if our != their:
            return f"line {number} is {their!r} instead of {our!r}"
    return f"{len(theirs)} lines instead of {len(ours)}"
