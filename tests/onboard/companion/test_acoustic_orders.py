"""Orders by acoustic modem: each is carried out once, whatever is said again, played again or said by a clock set back."""

import itertools
from collections.abc import Iterator
from typing import Any

import pytest

from gloc3.clock import VIRTUAL_EPOCH_S, VirtualLoop
from gloc3.exchange.acoustic import AcousticCode, AcousticOrder, AcousticVerb, Receipt
from gloc3.exchange.base import LocalExchange, Publisher
from gloc3.messages.command_interface import CiRequest, Emergency, EmergencyVerb, Outcome
from gloc3.messages.envelope import Envelope
from gloc3.store import MemoryRecords
from gloc3_groundstation.links.acoustic_route import AcousticRoute, ModemContext
from gloc3_onboard.command_server.journal import Journal, answer
from gloc3_onboard.companion.acoustic_link import ORDER_MOST_AGE_S, AcousticLink, ModemSettings

KEY = b"a key of the modem"
NOW = int(VIRTUAL_EPOCH_S)
_boots = itertools.count()


@pytest.fixture
def loop() -> Iterator[VirtualLoop]:
    loop = VirtualLoop()
    yield loop
    loop.close()


class Auv:
    """The platform's end, with the journal by which its command interface knows what it has done."""

    def __init__(self, loop: VirtualLoop, records: MemoryRecords) -> None:
        self.done: list[EmergencyVerb] = []
        self.receipts: list[Receipt] = []
        self._exchange, self._journal = LocalExchange(), Journal(records)
        self._replies = Publisher(self._exchange, "auv", "command_server", 1)
        self.link = AcousticLink("auv", self._exchange, loop, next(_boots), self._received, ModemSettings(KEY, "alice"))
        self.is_slow = False
        """Whether it answers only when the order comes again."""
        self.listen()

    def listen(self) -> None:
        """Begins to handle requests."""
        self.leave = self._exchange.subscribe("auv/ci/request", self._requested)

    def order(self, number: int, verb: AcousticVerb) -> Receipt | None:
        """Says an order to it; its receipt."""
        self.receipts.clear()
        self.link.receive(AcousticCode("auv", KEY).encode(AcousticOrder(number, verb)))
        return self.receipts[-1] if self.receipts else None

    def _received(self, data: bytes) -> None:
        receipt = AcousticCode("auv", KEY).decode(data)
        assert isinstance(receipt, Receipt)
        self.receipts.append(receipt)

    def _requested(self, envelope: Envelope[Any]) -> None:
        request = envelope.payload
        assert isinstance(request, CiRequest)
        assert isinstance(request.body, Emergency)
        assert request.member == "alice"
        known = self._journal.begin(request)
        if known.is_new:
            self.done.append(request.body.verb)
            if self.is_slow:
                return
        reply = known.reply or answer(request, Outcome.ACCEPTED)
        self._journal.end(reply)
        self._replies.publish("auv/ci/reply", reply, 0.0)


def test_an_order_is_carried_out_once_also_where_it_is_played_again_to_the_next_life_of_the_process(
    loop: VirtualLoop,
) -> None:
    records = MemoryRecords()
    auv = Auv(loop, records)
    assert auv.order(NOW, AcousticVerb.SURFACE) == auv.order(NOW, AcousticVerb.SURFACE) == Receipt(NOW, True)
    assert auv.done == [EmergencyVerb.LAND]
    later = Auv(loop, records)
    assert later.order(NOW, AcousticVerb.SURFACE) == Receipt(NOW, True)
    assert later.done == []
    assert later.order(NOW + 1, AcousticVerb.SURFACE) == Receipt(NOW + 1, True)
    assert later.done == [EmergencyVerb.LAND]


def test_an_order_that_comes_while_the_command_interface_is_away_is_carried_out_when_it_is_repeated(
    loop: VirtualLoop,
) -> None:
    auv = Auv(loop, MemoryRecords())
    auv.leave()
    assert auv.order(NOW, AcousticVerb.HOLD) is None
    assert auv.order(NOW + 1, AcousticVerb.SURFACE) is None
    auv.listen()
    assert auv.order(NOW, AcousticVerb.HOLD) == Receipt(NOW, False), "a newer one has come since"
    assert auv.order(NOW + 1, AcousticVerb.SURFACE) == Receipt(NOW + 1, True)
    assert auv.order(NOW + 1, AcousticVerb.SURFACE) == Receipt(NOW + 1, True)
    assert auv.done == [EmergencyVerb.LAND]


def test_an_order_that_is_repeated_while_it_is_carried_out_is_carried_out_once(loop: VirtualLoop) -> None:
    auv = Auv(loop, MemoryRecords())
    auv.is_slow = True
    assert auv.order(NOW, AcousticVerb.SURFACE) is None
    assert auv.order(NOW, AcousticVerb.SURFACE) == Receipt(NOW, True)
    assert auv.done == [EmergencyVerb.LAND]


def test_two_stations_that_order_in_one_second_are_both_heard(loop: VirtualLoop) -> None:
    auv = Auv(loop, MemoryRecords())
    assert auv.order(NOW, AcousticVerb.HOLD) == Receipt(NOW, True)
    assert auv.order(NOW, AcousticVerb.SURFACE) == Receipt(NOW, True)
    assert auv.done == [EmergencyVerb.HOLD, EmergencyVerb.LAND]


def test_an_order_of_a_clock_that_was_set_back_is_refused_and_not_left_without_a_receipt(loop: VirtualLoop) -> None:
    auv = Auv(loop, MemoryRecords())
    auv.order(NOW, AcousticVerb.HOLD)
    assert auv.order(NOW - 1, AcousticVerb.SURFACE) == Receipt(NOW - 1, False)
    assert auv.done == [EmergencyVerb.HOLD]


def test_an_order_that_was_held_back_on_the_way_is_refused(loop: VirtualLoop) -> None:
    auv = Auv(loop, MemoryRecords())
    held_back = NOW - int(ORDER_MOST_AGE_S) - 1
    assert auv.order(held_back, AcousticVerb.SURFACE) == Receipt(held_back, False)
    assert auv.done == []
    assert auv.order(NOW - 60, AcousticVerb.SURFACE) == Receipt(NOW - 60, True), "sound is slow, and clocks are off"


def test_a_station_never_says_two_orders_under_one_number(loop: VirtualLoop) -> None:
    text: list[AcousticOrder] = []
    code, utc_s = AcousticCode("auv"), [1000.0]

    def send(data: bytes) -> None:
        order = code.decode(data)
        assert isinstance(order, AcousticOrder)
        text.append(order)

    way = AcousticRoute(
        "auv",
        loop,
        send,
        ModemContext(
            exchange=LocalExchange(), boot=1, is_silent=lambda: True, report=lambda _: None, now_utc_s=lambda: utc_s[0]
        ),
    )
    way.order(AcousticVerb.HOLD)
    way.order(AcousticVerb.SURFACE)
    utc_s[0] = 10.0
    way.order(AcousticVerb.SURFACE)
    way.close()
    assert [order.number for order in text] == [1000, 1001, 1002]
