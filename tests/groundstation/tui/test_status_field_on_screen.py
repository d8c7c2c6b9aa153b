"""A status field that is declared once goes from the component's status to the screen."""

import msgspec
import pytest

from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.messages.envelope import ComponentStatus, Envelope, Kind, Message, Source
from gloc3.messages.status_fields import STATUS_FIELDS, StatusField
from gloc3.messages.summaries import Health
from gloc3.messages.wire import type_name
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.snapshots import Fleet
from gloc3_groundstation.tui.views import components as view
from gloc3_groundstation.tui.widgets.lines import Tone, text_of
from gloc3_groundstation.tui.widgets.tables import Column
from gloc3_onboard.command_server import component_book as observing
from gloc3_onboard.command_server.component_book import ComponentBook

MADE_UP = StatusField(
    name="made_up",
    title="up",
    width=6,
    show=lambda value, _: f"{value} pct",
    is_notable=lambda value, _: value > 80,
)


def received(fleet: Fleet, topic: str, message: Message) -> Fleet:
    source = Source("heron", "command_server", 1)
    envelope = Envelope(f"heron/ci/{topic}", source, 0, 0.0, "", type_name(type(message)), message)
    return reducers.receive(fleet, envelope, 0.0)


def test_one_declaration_takes_a_value_to_its_column(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observing, "COLUMN_FIELDS", (MADE_UP,))
    monkeypatch.setattr(view, "STATUS_FIELDS", (*STATUS_FIELDS, MADE_UP))
    monkeypatch.setattr(view, "COLUMNS", (*view.COLUMNS[:-1], Column("up", 6, is_right=True), view.COLUMNS[-1]))
    rows = [msgspec.convert({"name": name, "class": "x:Y"}, ComponentRow) for name in ("camera", "laser", "height")]
    component_book = ComponentBook(rows)
    for name, values in (("camera", {"made_up": 84.6}), ("laser", {"made_up": 41.5}), ("height", {})):
        status = ComponentStatus(name=name, kind=Kind.SAMPLER, state=State.WORKING, values=values)
        component_book.receive(status, 0.0)
    fleet = received(Fleet(), "table", component_book.table())
    fleet = received(fleet, "summary", component_book.summary(Health.WORKING, 0.0))
    platform = fleet.get("heron")
    assert platform is not None
    assert text_of(view.components_header(120)).split()[-3:] == ["up", "last", "error"]
    shown = [line for _, line in view.component_rows(platform, 0.0, 120)]
    assert [text_of(line).split()[-2:] for line in shown] == [["85", "pct"], ["42", "pct"], ["·", "·"]]
    assert [span.tone for line in shown for span in line if "pct" in span.text] == [Tone.WARN, Tone.DIM]
