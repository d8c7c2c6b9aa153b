"""The command interface's client: what a station asks of platforms, over any exchange and in any kind of time."""

import asyncio
from typing import Any, Final

from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange.base import Exchange, Publisher
from gloc3.exchange.tunnel.happenings import Undelivered
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
    ReadMission,
    StationRole,
    Steer,
    Verb,
)
from gloc3.messages.envelope import Envelope
from gloc3.messages.software import own_software
from gloc3.messages.teleoperation import VelocityDemand
from gloc3_groundstation.station.requests import SLOWEST_BYTES_S, Requests

TIMEOUT_S: Final = 16.0
"""Longer than the link goes on trying, so that nothing is carried out after the operator was told *unknown*."""
EMERGENCY_TIMEOUT_S: Final = 6.0
"""The same for emergencies, which the link gives up sooner."""


class Unanswered(Gloc3Error):
    """It is not known whether a request was carried out."""


class ReadBackDiffers(Gloc3Error):
    """The platform does not hold the mission that was sent to it."""


class Declined(Refused):
    """A platform turned a request down; the reply may hold more than the reason."""

    def __init__(self, reply: CiReply) -> None:
        findings = f"\n{reply.text}" if reply.text and reply.text != reply.reason else ""
        super().__init__(f"{reply.reason or 'no reason was given'}{findings}")
        self.reply: Final = reply


class CommandClient:
    """The client half of the command interface: one for a station, for all platforms that it commands.

    It has no cycle of its own, since it acts when an operator does: `Requests` decides, this sends and waits.
    """

    def __init__(self, exchange: Exchange, loop: asyncio.AbstractEventLoop, station: str, boot: int) -> None:
        """A client.

        Args:
            exchange: reaches the platforms.
            loop: gives the time and wakes the client.
            station: the station's id, such as `255`.
            boot: a random number for this start of the station.
        """
        self.station: Final = station
        self.role = StationRole.OPERATOR
        """What the station may do, as far as it is known here; the platforms judge for themselves."""
        self._loop = loop
        self._requests = Requests(station, boot)
        self._publisher = Publisher(exchange, f"station_{station}", "command_client", boot)
        self._waiting: dict[tuple[str, int], asyncio.Future[CiReply]] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._sessions = 0
        self._unsubscribe = exchange.subscribe("*/ci/reply", self._receive)
        self._withdraw = exchange.declare_alive(f"stations/{station}")

    def close(self) -> None:
        """Hears no more replies; those who still wait are cancelled."""
        self._unsubscribe()
        self._withdraw()
        if self._timer is not None:
            self._timer.cancel()
        for future in self._waiting.values():
            future.cancel()
        self._waiting.clear()

    async def request(self, platform: str, body: AnyBody, timeout_s: float = TIMEOUT_S) -> CiReply:
        """Sends a request and waits for what became of it.

        Returns:
            The reply. Its outcome is *unknown*, with the reason, where none came within `timeout_s`.
        """
        if self.role is StationRole.OBSERVER and not isinstance(body, QUERIES):
            reason = f"station {self.station} may look and not command: it is an observer"
            return CiReply(sender=self.station, boot=0, sequence=-1, outcome=Outcome.REFUSED, reason=reason)
        key = self._requests.request(platform, body, timeout_s, self._loop.time())
        future: asyncio.Future[CiReply] = self._loop.create_future()
        self._waiting[key] = future
        self._run()
        try:
            return await future
        finally:
            self._waiting.pop(key, None)
            self._requests.drop(key)

    def send(self, platform: str, body: AnyBody) -> None:
        """Sends what needs no answer."""
        request = self._requests.unanswered(platform, body)
        self._publisher.publish(f"{platform}/ci/request", request, self._loop.time())

    def demand(self, platform: str, demand: VelocityDemand) -> None:
        """Sends a velocity that is asked for by hand; it arrives at once or not at all."""
        self._publisher.publish(f"{platform}/velocity_demand", demand, self._loop.time())

    def new_session(self) -> int:
        """A number for the demands of one time at the keys, which no other has."""
        self._sessions += 1
        return (self._requests.boot + self._sessions) & 0xFFFFFFFF

    async def carry_out(self, platform: str, body: AnyBody, timeout_s: float = TIMEOUT_S) -> CiReply:
        """Sends a request that is to be accepted.

        Raises:
            Declined: the platform turned it down.
            Unanswered: it is not known whether it was carried out.
        """
        reply = await self.request(platform, body, timeout_s)
        if reply.outcome is Outcome.ACCEPTED:
            return reply
        if reply.outcome is Outcome.REFUSED:
            raise Declined(reply)
        raise Unanswered(reply.reason or f"{platform} does not know what became of the request ({reply.outcome})")

    def undelivered(self, reported: Undelivered) -> None:
        """Whoever holds the links tells that a message was given up; see `Requests.undelivered`."""
        request = reported.envelope.payload
        if isinstance(request, CiRequest):
            platform, now_s = reported.envelope.topic.partition("/")[0], self._loop.time()
            self._requests.undelivered(platform, request, reported.reason, now_s, is_certain=reported.is_certain)
            self._run()

    # --- what operators ask for most; all raise as `carry_out` does ---

    async def upload(self, platform: str, name: str, text: str) -> None:
        """Streams a mission, reads it back and compares.

        Raises:
            ReadBackDiffers: the platform holds something else.
        """
        timeout_s = 3.0 * (TIMEOUT_S + len(text.encode()) / SLOWEST_BYTES_S)
        await self.carry_out(platform, LoadMission(name=name, text=text), timeout_s)
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
        """What the emergency key asks for; needs no control."""
        author = f"station {self.station}"
        body = Emergency(verb=verb, author=author, confirmation=confirmation)
        await self.carry_out(platform, body, EMERGENCY_TIMEOUT_S)

    async def hello(self, platform: str) -> None:
        """Asks for the full state, which comes on the platform's topics."""
        await self.carry_out(platform, Hello(**own_software()._asdict()))

    # --- the shell around the machine ---

    def _receive(self, envelope: Envelope[Any]) -> None:
        if isinstance(envelope.payload, CiReply):
            self._requests.receive(envelope.topic.partition("/")[0], envelope.payload, self._loop.time())
            self._run()

    def _run(self) -> None:
        """Sends what is to be sent, tells who waits, and sets the alarm."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        now_s = self._loop.time()
        self._requests.tick(now_s)
        for platform, request in self._requests.outgoing():
            self._publisher.publish(f"{platform}/ci/request", request, now_s)
        for key, reply in self._requests.ended():
            future = self._waiting.get(key)
            if future is not None and not future.done():
                future.set_result(reply)
        next_s = self._requests.next_tick_s()
        if next_s is not None and self._timer is None:
            self._timer = self._loop.call_at(next_s, self._run)


def _differ(sent: str, held: str) -> str:
    """Where two texts begin to differ."""
    ours, theirs = sent.splitlines(), held.splitlines()
    for number, (our, their) in enumerate(zip(ours, theirs, strict=False), start=1):
        if our != their:
            return f"line {number} is {their!r} instead of {our!r}"
    return f"{len(theirs)} lines instead of {len(ours)}"
