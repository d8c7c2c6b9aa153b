"""A status field is one row: it is measured, packed, read by peers of every version, and shown."""

from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

from gloc3.component.lci import State
from gloc3.exchange.tunnel import status as packing
from gloc3.exchange.tunnel.body import unpack_payload, unpack_status
from gloc3.exchange.tunnel.events import Counters
from gloc3.exchange.tunnel.frames import Status, SummaryRows
from gloc3.exchange.tunnel.status import StatusReceiver, StatusSender
from gloc3.messages.envelope import ComponentStatus, Envelope, Kind, Message, Source
from gloc3.messages.status_fields import COLUMN_FIELDS, ROW_FIELDS, STATUS_FIELDS, StatusField
from gloc3.messages.summaries import ComponentLine, Health, Summary
from gloc3.messages.wire import type_name

BYTES_OF_A_VALUE = 3
MADE_UP = StatusField(name="made_up", title="up", width=6, show=lambda value, _: f"{value} pct")
LINES = [ComponentLine(n, 0, 100, 30, n, 0) for n in range(40)]
COLUMN: list[int | None] = [None, *range(-19, 20)]


def envelope(payload: Message, sequence: int = 0) -> Envelope[Any]:
    source = Source("minoas", "ci", 1)
    return Envelope("minoas/ci/summary", source, sequence, 12.5, "", type_name(type(payload)), payload)


def frames(payload: Summary, sequence: int) -> Iterator[Any]:
    sender = StatusSender(Counters())
    sender.offer(1, envelope(payload, sequence))
    while (frame := sender.next_frame()) is not None:
        yield frame


def status(**fields: Any) -> ComponentStatus:
    return ComponentStatus(name="camera", kind=Kind.SAMPLER, state=State.WORKING, **fields)


def test_the_values_of_a_line_are_the_first_fields_in_their_order() -> None:
    names = [field.name for field in msgspec.structs.fields(ComponentLine)]
    assert names == ["index", "state", *(field.name for field in ROW_FIELDS)]
    assert len({field.name for field in STATUS_FIELDS}) == len(STATUS_FIELDS)


def test_a_component_takes_at_most_16_bytes_with_all_its_fields() -> None:
    assert len(packing._packed(ComponentLine(0, 255, 255, 255, 65535, 65535))) <= 9
    assert 9 + BYTES_OF_A_VALUE * len(COLUMN_FIELDS) <= 16
    for field in COLUMN_FIELDS:
        assert len(msgspec.msgpack.encode(-field.most)) <= BYTES_OF_A_VALUE


@pytest.mark.parametrize(
    ("values", "value"),
    [
        ({}, None),
        ({"other": 3.0}, None),
        ({"made_up": 41.6}, 42),
        ({"made_up": float("nan")}, None),
        ({"made_up": -1e300}, -32767),
    ],
)
def test_a_value_is_what_the_component_reports_rounded_and_bounded(values: dict[str, float], value: int | None) -> None:
    assert MADE_UP.value(status(values=values)) == value


def test_rates_and_counts_are_measured_from_the_status() -> None:
    found = status(rate_hz=9.0, nominal_rate_hz=10.0, cycle_mean_s=0.03, overruns=65538, errors=2)
    assert [field.value(found) for field in ROW_FIELDS] == [90, 30, 2, 2]
    assert [field.value(status(rate_hz=9.0)) for field in ROW_FIELDS] == [0, 0, 0, 0]


def test_columns_cross_a_radio_before_the_rows_and_both_arrive() -> None:
    summary = Summary(table=1, health=Health.WORKING, lines=LINES, columns={"made_up": COLUMN})
    receiver, lines, columns = StatusReceiver(Counters()), list[ComponentLine](), dict[str, Any]()
    for frame in frames(summary, sequence=7):
        if isinstance(frame, SummaryRows):
            assert receiver.receive_rows(frame.channel, frame.sequence, frame.body)
            lines += packing.unpack_summary(frame.body)[1].lines
        else:
            body = frame.body
            if isinstance(frame, Status):
                assert receiver.receive_whole(frame.channel, frame.sequence)
            else:
                body = receiver.receive_part(frame)
            columns |= unpack_payload(unpack_status(body)[1], Summary).columns if body else {}
    assert lines == LINES
    assert columns == {"made_up": COLUMN}


class SummaryOf01(Message, frozen=True):
    """As version 0.1 knows it."""

    table: int
    health: Health
    lines: list[ComponentLine]


def test_a_peer_of_0_1_reads_the_rows_and_nothing_from_the_columns() -> None:
    summary = Summary(table=1, health=Health.WORKING, lines=LINES[:9], columns={"made_up": COLUMN[:9]})
    column, rows = frames(summary, sequence=7)
    assert isinstance(column, Status)
    read = unpack_payload(unpack_status(column.body)[1], SummaryOf01)
    assert read == SummaryOf01(table=1, health=Health.WORKING, lines=[])
    assert packing.unpack_summary(rows.body)[1].lines == LINES[:9]
    before = type_name(SummaryOf01).partition("#")[2]
    assert type_name(Summary) == f"Summary#{before}", "the fixed part is as it was"


def test_a_summary_without_further_fields_costs_what_it_did() -> None:
    (frame,) = frames(Summary(table=1, health=Health.WORKING, lines=LINES[:9]), sequence=1)
    assert isinstance(frame, SummaryRows)
