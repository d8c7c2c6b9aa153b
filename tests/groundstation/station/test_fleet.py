"""A fleet's snapshot follows from what is heard; what is old is marked as old."""

import pytest
from msgspec import structs
from tests.groundstation.scripted_platform import VEHICLE

from gloc3.clock import VIRTUAL_EPOCH_S
from gloc3.messages.envelope import Envelope, Message, Severity, Source
from gloc3.messages.summaries import (
    CiEvent,
    ComponentLine,
    ComponentTable,
    ComponentTrouble,
    ControlState,
    Health,
    MissionSummary,
    Summary,
    TableRow,
)
from gloc3.messages.wire import type_name
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.alerts import causes
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

TABLE = ComponentTable(
    table=3, rows=[TableRow("driver", "AD", 20.0, True, ""), TableRow("height", "SS", 10.0, False, "")]
)
TOPICS = {"VehicleSummary": "vehicle", "CiEvent": "event", "ComponentTable": "table", "MissionSummary": "mission"}
TOPICS |= {"Summary": "summary", "ComponentTrouble": "trouble", "ControlState": "control"}


def received(
    fleet: Fleet, message: Message, now_s: float, *, sequence: int = 0, platform: str = "heron", boot: int = 1
) -> Fleet:
    topic = f"{platform}/ci/{TOPICS[type(message).__name__]}"
    source = Source(platform, "command_server", boot)
    return reducers.receive(fleet, Envelope(topic, source, sequence, 0.0, "", type_name(type(message)), message), now_s)


def heron(fleet: Fleet) -> PlatformSnapshot:
    found = fleet.get("heron")
    assert found is not None
    return found


def test_a_platform_appears_with_its_first_message_and_is_incomplete_until_its_table_came() -> None:
    fleet = received(Fleet(), VEHICLE, 2.0)
    assert heron(fleet).is_incomplete
    assert heron(fleet).first_received_s == 2.0
    assert [event.text for event in fleet.events] == ["is heard"]
    assert not heron(received(fleet, TABLE, 2.5)).is_incomplete


def test_the_snapshot_before_is_not_changed() -> None:
    before = received(Fleet(), VEHICLE, 0.0)
    received(before, TABLE, 1.0)
    assert heron(before).table is None


def test_components_are_named_by_the_table_and_ordered_by_the_flow_of_data() -> None:
    fleet = received(Fleet(), TABLE, 0.0)
    lines = [ComponentLine(0, 5, 0, 0, 2, 1), ComponentLine(1, 0, 98, 12, 0, 0)]
    fleet = received(fleet, Summary(table=3, health=Health.FAULTY, lines=lines), 0.0)
    fleet = received(fleet, ComponentTrouble(name="driver", cause="no echo", errors=1), 0.1)
    height, driver = heron(fleet).components(0.1)
    assert (height.name, height.health, height.values["rate_percent"], height.is_well) == (
        "height",
        Health.WORKING,
        98,
        True,
    )
    assert (driver.name, driver.health, driver.cause, driver.errors) == ("driver", Health.FAULTY, "no echo", 1)


def test_a_summary_may_come_in_parts_and_before_its_table() -> None:
    fleet = received(Fleet(), Summary(table=3, health=Health.WORKING, lines=[ComponentLine(0, 0, 9, 0, 0, 0)]), 0.0)
    line = ComponentLine(1, 1, 9, 0, 0, 0)
    fleet = received(fleet, Summary(table=3, health=Health.WORKING, lines=[line]), 0.0, sequence=1)
    assert heron(fleet).components(0.0) == ()
    found = heron(received(fleet, TABLE, 0.1)).components(0.1)
    assert [component.health for component in found] == [Health.QUIET, Health.WORKING]


def test_a_summary_of_another_table_asks_for_that_table() -> None:
    fleet = received(received(Fleet(), TABLE, 0.0), Summary(table=4, health=Health.WORKING, lines=[]), 0.0)
    assert heron(fleet).is_incomplete


def test_every_kind_of_status_grows_stale_at_its_own_age() -> None:
    fleet = received(received(Fleet(), TABLE, 0.0), VEHICLE, 0.0)
    fleet = received(fleet, MissionSummary(name="m", digest="d", state="running"), 0.0)
    fleet = received(fleet, ControlState(holder="255"), 0.0)
    fleet = received(fleet, Summary(table=3, health=Health.WORKING, lines=[ComponentLine(0, 0, 9, 0, 0, 0)]), 0.0)
    platform = heron(fleet)
    assert platform.vehicle is not None
    assert platform.mission is not None
    assert [platform.vehicle.is_stale(age_s) for age_s in (4.9, 5.0)] == [False, True]
    assert [platform.mission.is_stale(age_s) for age_s in (9.9, 10.0)] == [False, True]
    assert [platform.components(age_s)[1].is_stale for age_s in (4.9, 5.0)] == [False, True]
    assert [platform.is_quiet_link(age_s) for age_s in (2.9, 3.0)] == [False, True]


def test_a_component_that_was_never_heard_of_has_no_health_and_is_not_called_stale() -> None:
    (height, _) = heron(received(Fleet(), TABLE, 0.0)).components(100.0)
    assert (height.health, height.is_stale) == (None, False)


def test_gaps_in_the_sequence_are_losses() -> None:
    fleet = Fleet()
    for sequence in range(0, 400, 2):
        fleet = received(fleet, VEHICLE, sequence / 10, sequence=sequence)
    link = heron(fleet).link
    assert (link.received, link.lost) == (200, 199)
    assert link.loss == pytest.approx(0.5, abs=0.05)
    for sequence in range(400, 500):
        fleet = received(fleet, VEHICLE, sequence / 10, sequence=sequence)
    assert heron(fleet).link.loss < 0.01


def test_what_is_older_than_what_is_known_changes_nothing_but_proves_that_the_platform_is_there() -> None:
    fleet = received(Fleet(), VEHICLE, 0.0, sequence=5)
    fleet = received(fleet, MissionSummary(name="m", digest="d", state="done"), 0.0, sequence=2)
    again = received(fleet, MissionSummary(name="m", digest="d", state="running"), 1.0, sequence=1)
    assert heron(again).mission == heron(fleet).mission
    assert heron(again).received_s == 1.0


def test_a_restarted_platform_is_asked_anew_and_keeps_its_last_position() -> None:
    fleet = received(received(Fleet(), TABLE, 0.0), VEHICLE, 0.0, sequence=9)
    fleet = received(fleet, ControlState(holder=""), 3.0, boot=2)
    platform = heron(fleet)
    assert platform.is_incomplete
    assert platform.vehicle is not None
    assert platform.vehicle.received_s == 0.0
    assert fleet.events[-1].text == reducers.RESTARTED
    assert fleet.events[-1].severity is Severity.WARNING


@pytest.mark.parametrize(
    ("process", "severity", "text"),
    [(7, Severity.NOTICE, reducers.INTERFACE_RESTARTED), (8, Severity.WARNING, reducers.RESTARTED)],
)
def test_a_restart_of_the_process_is_told_when_the_process_is_another(
    process: int, severity: Severity, text: str
) -> None:
    fleet = received(Fleet(), structs.replace(TABLE, process=7), 0.0)
    fleet = received(fleet, VEHICLE, 3.0, boot=2)
    assert "again" not in fleet.events[-1].text
    fleet = received(fleet, structs.replace(TABLE, process=process), 3.4, boot=2, sequence=1)
    assert (fleet.events[-1].severity, fleet.events[-1].text) == (severity, text)
    fleet = received(fleet, structs.replace(TABLE, process=process), 5.0, boot=2, sequence=2)
    assert [event.text for event in fleet.events].count(text) == 1


def test_two_platforms_of_one_name_are_told_and_one_of_them_is_shown() -> None:
    fleet = received(Fleet(), VEHICLE, 0.0, boot=1)
    for step in range(1, 40):
        fleet = received(fleet, VEHICLE, 0.5 * step, sequence=step, boot=1 + step % 2)
    assert [event.text for event in fleet.events] == ["is heard", reducers.RESTARTED], "told once, not at each message"
    assert heron(fleet).boot == 2
    (cause,) = [cause for cause in causes(fleet, 20.0) if cause.what == "name"]
    assert cause.text.startswith("two platforms have this name")
    assert not heron(fleet).is_doubled(40.0)
    fleet = received(fleet, VEHICLE, 40.0, sequence=80, boot=1)
    assert heron(fleet).boot == 1, "the other one has gone"


def test_what_comes_late_from_a_life_that_is_over_is_no_second_platform() -> None:
    fleet = received(received(Fleet(), VEHICLE, 0.0, boot=1), VEHICLE, 1.0, boot=2)
    fleet = received(received(fleet, VEHICLE, 1.1, sequence=8, boot=1), VEHICLE, 1.2, sequence=9, boot=1)
    assert heron(fleet).boot == 2
    assert not heron(fleet).is_doubled(1.3)


def test_silence_that_ends_is_an_event() -> None:
    fleet = received(received(Fleet(), VEHICLE, 0.0), VEHICLE, 12.0, sequence=1)
    assert fleet.events[-1].text == "is heard again after 12 s of silence"


def test_events_are_kept_in_a_bounded_ring_and_counted() -> None:
    fleet = Fleet()
    for number in range(reducers.EVENTS_KEPT + 20):
        event = CiEvent(severity=Severity.INFO, source="driver", text=f"{number}", t_s=0.0)
        fleet = received(fleet, event, 0.0, sequence=number)
    assert len(fleet.events) == reducers.EVENTS_KEPT
    assert fleet.event_count == reducers.EVENTS_KEPT + 21
    assert fleet.events[-1].number == fleet.event_count
    assert [event.text for event in fleet.events_after(fleet.event_count - 2)] == ["518", "519"]
    assert fleet.events_after(fleet.event_count) == ()


def test_two_platforms_are_kept_apart() -> None:
    fleet = received(received(Fleet(), VEHICLE, 0.0), VEHICLE, 5.0, platform="hummingbird")
    assert [(platform.name, platform.received_s) for platform in fleet] == [("heron", 0.0), ("hummingbird", 5.0)]


def test_a_planned_silence_is_no_alarm_until_contact_is_due() -> None:
    reported = MissionSummary(name="m", digest="d", state="running", silence="dive", silent_until_s=70.0)
    fleet = received(Fleet(utc_offset_s=VIRTUAL_EPOCH_S), reported, 40.0)  # the platform's clock was at 0 then
    platform = heron(fleet)
    assert wording.silence(platform, 99.0) == "silent as planned (dive), due 00:01:50 UTC"
    assert not list(causes(fleet, 99.0))
    assert wording.silence(platform, 115.0) == "OVERDUE by 5 s (dive), was due 00:01:50 UTC"
    assert [cause.text.partition(":")[0] for cause in causes(fleet, 115.0)] == ["overdue"]
