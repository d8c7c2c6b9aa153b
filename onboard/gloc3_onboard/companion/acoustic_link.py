"""Platform's end of an acoustic modem: sends summaries while no other station link is alive, and accepts orders."""

import asyncio
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from gloc3.clock import Clock
from gloc3.exchange import Publisher
from gloc3.exchange.acoustic import AcousticCode, AcousticOrder, AcousticVerb, Receipt, summary_of
from gloc3.exchange.base import Exchange
from gloc3.messages.command_interface import CiReply, CiRequest, Emergency, EmergencyVerb, Outcome
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import CiEvent, Health, MissionSummary, StationHeard, Summary, VehicleSummary

SENDER: Final = "acoustic"
"""Sender name of orders, for the command interface and the log."""
PERIOD_S: Final = 60.0
IN_CONTACT_S: Final = 5.0
"""Time after a station's last message on another link in which the modem stays silent, s."""
ORDER_MOST_AGE_S: Final = 600.0
"""Orders are numbered by the time of day. An older one was held back, where this computer's clock is right; a station stops
repeating its own after two minutes, and its clock may be some minutes off."""
_VERBS: Final = {AcousticVerb.HOLD: EmergencyVerb.HOLD, AcousticVerb.SURFACE: EmergencyVerb.LAND}
_LIFE: Final = 0
"""Orders are of one life over all starts of this process: an order that is played again later is known to the journal."""
_KINDS: Final = 16
"""Orders of one number, one of each kind, count as several requests."""


class ModemSettings(NamedTuple):
    """Settings of the link."""

    key: bytes | None = None
    """Key of the link; None for none."""
    member: str = ""
    """Member of the network for whom the key stands; empty for none."""
    period_s: float = PERIOD_S
    """Period of the summaries."""


class AcousticLink:
    """Sends a summary at most every `period_s`, and the receipts of orders; nothing else.

    Args:
        platform: its name.
        exchange: the platform's middleware.
        loop: the event loop.
        boot: random number of this start of the process.
        send: sends a frame by the modem.
        settings: settings of the link.
    """

    def __init__(
        self,
        platform: str,
        exchange: Exchange,
        loop: asyncio.AbstractEventLoop,
        boot: int,
        send: Callable[[bytes], None],
        settings: ModemSettings = ModemSettings(),  # noqa: B008 - immutable
    ) -> None:
        self.code: Final = AcousticCode(platform, settings.key)
        self._platform, self._loop, self._send = platform, loop, send
        self._period_s, self._member = settings.period_s, settings.member
        self._publisher = Publisher(exchange, platform, "acoustic_link", boot)
        self._clock = Clock(loop)
        self._vehicle: VehicleSummary | None = None
        self._mission: MissionSummary | None = None
        self._health = Health.IDLE
        self._worst = 7
        self._received_s = float("-inf")
        self._newest = -1
        """The sequence of the last order that was taken."""
        self._outcomes: dict[int, bool] = {}
        """Result of orders, by sequence: whether accepted."""
        topics: dict[str, Callable[[Envelope[Any]], None]] = {
            "ci/vehicle": self._receive_vehicle,
            "ci/mission": self._receive_mission,
            "ci/summary": self._receive_summary,
            "ci/event": self._receive_event,
            "ci/heard": self._receive_order,
            "ci/reply": self._receive_reply,
        }
        self._undo = [exchange.subscribe(f"{platform}/{topic}", handle) for topic, handle in topics.items()]
        self._timer = loop.call_later(settings.period_s, self._transmit)

    def close(self) -> None:
        """Stops sending."""
        self._timer.cancel()
        for undo in self._undo:
            undo()

    def receive(self, data: bytes) -> None:
        """Takes a frame from the modem; an order that has been answered is answered again, and not carried out.

        One without an answer is requested again, since the command interface may have been away; its journal knows what
        it has carried out. One that is older than the last, or too old altogether, is refused, so that its sender learns of
        a clock that has been set back.
        """
        order = self.code.decode(data)
        if not isinstance(order, AcousticOrder):
            return
        sequence = order.number * _KINDS + order.verb
        if sequence in self._outcomes:
            self._send(self.code.encode(Receipt(order.number, self._outcomes[sequence])))
        elif self._is_too_old(order):
            self._send(self.code.encode(Receipt(order.number, False)))
        elif order.number >= self._newest // _KINDS:
            self._newest = sequence
            body = Emergency(verb=_VERBS[order.verb], author="an operator, by acoustic modem")
            request = CiRequest(
                sender=SENDER, boot=_LIFE, sequence=sequence, body=body, way=SENDER, member=self._member
            )
            self._publisher.publish(f"{self._platform}/ci/request", request, self._loop.time())
        else:
            self._send(self.code.encode(Receipt(order.number, False)))

    def _is_too_old(self, order: AcousticOrder) -> bool:
        return self._clock.is_utc_right() and self._clock.utc_s() - order.number > ORDER_MOST_AGE_S

    def _transmit(self) -> None:
        self._timer = self._loop.call_later(self._period_s, self._transmit)
        now_s = self._loop.time()
        if self._vehicle is None or now_s - self._received_s < IN_CONTACT_S:
            return
        summary = summary_of(self._vehicle, self._mission, self._health, self._worst)
        self._send(self.code.encode(summary))

    def _receive_vehicle(self, envelope: Envelope[VehicleSummary]) -> None:
        self._vehicle = envelope.payload

    def _receive_mission(self, envelope: Envelope[MissionSummary]) -> None:
        self._mission = envelope.payload

    def _receive_summary(self, envelope: Envelope[Summary]) -> None:
        self._health = envelope.payload.health

    def _receive_event(self, envelope: Envelope[CiEvent]) -> None:
        if self._loop.time() - self._received_s >= IN_CONTACT_S:
            self._worst = min(self._worst, int(envelope.payload.severity))

    def _receive_order(self, envelope: Envelope[StationHeard]) -> None:
        del envelope
        self._received_s, self._worst = self._loop.time(), 7

    def _receive_reply(self, envelope: Envelope[CiReply]) -> None:
        reply = envelope.payload
        if reply.sender == SENDER:
            accepted = self._outcomes[reply.sequence] = reply.outcome is Outcome.ACCEPTED
            self._send(self.code.encode(Receipt(reply.sequence // _KINDS, accepted)))
