"""Stations that come and go, or are invented, leave nothing behind in a platform."""

import tracemalloc

import pytest
from tests.onboard.command_server.test_request_handler import Desk

from gloc3.messages.command_interface import AnyBody, Control, ControlVerb, Emergency, EmergencyVerb, Hello

pytestmark = pytest.mark.thorough

STATIONS = 600
ASKED: tuple[AnyBody, ...] = (
    Hello(),
    Control(verb=ControlVerb.REQUEST, version="1.2.3"),
    Emergency(verb=EmergencyVerb.HOLD),
)


def ask(desk: Desk, first: int) -> int:
    """So many new stations ask for a few things, one after another; the memory that is in use then."""
    for number in range(first, first + STATIONS):
        sender = f"station-{number}"
        desk.handler._contacts.note_contact(sender, number)
        for sequence, body in enumerate(ASKED):
            desk.request(body, sender=sender, sequence=sequence, boot=number)
        desk.handler.components.messages.clear()
        desk.executor.board.reported.clear()
        desk.said.clear()
    return tracemalloc.get_traced_memory()[0]


def test_thousands_of_stations_take_no_more_memory_than_the_first() -> None:
    desk = Desk()
    tracemalloc.start()
    try:
        first, second = ask(desk, 0), ask(desk, STATIONS)
        assert ask(desk, 2 * STATIONS) - second < 60_000, (first, second)
    finally:
        tracemalloc.stop()
