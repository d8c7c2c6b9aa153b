"""What the operator has to take note of: until it is acknowledged, and as long as it is so."""

from msgspec.structs import replace
from tests.groundstation.scripted_platform import VEHICLE
from tests.groundstation.tui.views.test_views import PLATFORM

from gloc3.messages.envelope import Envelope, Severity, Source
from gloc3.messages.software import own_software
from gloc3.messages.summaries import ComponentLine, ComponentTrouble, Health
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.alerts import KEPT, Alerts, acknowledge, answer, began, dismiss, update
from gloc3_groundstation.station.snapshots import Fleet, LinkStatistics, PlatformSnapshot, Timed


def fleet_of(platform: PlatformSnapshot = PLATFORM, **vehicle: object) -> Fleet:
    platform = replace(platform, vehicle=Timed(replace(VEHICLE, **vehicle), 100.0))
    return Fleet(platforms={platform.name: platform})


def reported(alerts: Alerts) -> list[tuple[Severity, str]]:
    return [(alert.severity, alert.text) for alert in alerts.listed]


def test_while_all_is_well_there_is_none_and_nothing_is_made_anew() -> None:
    none = update(Alerts(), fleet_of(), 100.0)
    assert none.all == {}
    low = update(none, fleet_of(battery_percent=20), 100.0)
    assert update(low, fleet_of(battery_percent=20), 100.2) is low


def test_a_platform_that_speaks_otherwise_is_an_alert() -> None:
    assert PLATFORM.table is not None
    same = replace(PLATFORM, table=replace(PLATFORM.table, **own_software()._asdict()))
    assert update(Alerts(), fleet_of(same), 100.0).all == {}
    other = replace(PLATFORM, table=replace(PLATFORM.table, version="0.0.9", protocol="00c0ffee"))
    [(severity, text)] = reported(update(Alerts(), fleet_of(other), 100.0))
    assert severity is Severity.ERROR
    assert text.startswith("versions differ: 0.0.9 (00c0ffee) onboard, ")


def test_a_cause_stays_until_it_is_acknowledged_although_it_is_over() -> None:
    low = update(Alerts(), fleet_of(battery_percent=20), 100.0)
    assert reported(low) == [(Severity.WARNING, "battery at or below 30 %")]
    over = update(low, fleet_of(battery_percent=80), 101.0)
    assert [(alert.is_over, alert.is_acknowledged) for alert in over.listed] == [(True, False)]
    assert acknowledge(over).all == {}


def test_an_acknowledged_alert_goes_when_its_cause_is_gone() -> None:
    low = acknowledge(update(Alerts(), fleet_of(battery_percent=20), 100.0), ("heron", "battery"))
    assert low.pending == []
    assert low.worst is None
    assert len(low.listed) == 1
    assert update(low, fleet_of(battery_percent=20), 101.0).pending == []
    assert update(low, fleet_of(battery_percent=80), 102.0).all == {}


def test_what_gets_worse_or_comes_back_has_to_be_acknowledged_again() -> None:
    low = acknowledge(update(Alerts(), fleet_of(battery_percent=20), 100.0))
    empty = update(low, fleet_of(battery_percent=9), 101.0)
    assert reported(empty) == [(Severity.CRITICAL, "battery at or below 15 %")]
    assert len(empty.pending) == 1
    over = update(empty, fleet_of(battery_percent=80), 102.0)
    again = update(over, fleet_of(battery_percent=9), 102.5)
    assert [(alert.count, alert.since_s, alert.is_over) for alert in again.pending] == [(2, 102.5, False)]


def test_silence_is_worse_for_an_armed_vehicle_and_hides_what_is_not_known_any_more() -> None:
    ((severity, text),) = reported(update(Alerts(), fleet_of(battery_percent=9), 110.0))
    assert (severity, text.partition(":")[0]) == (Severity.ERROR, "no messages from it any more")
    ((severity, text),) = reported(update(Alerts(), fleet_of(is_armed=True), 110.0))
    assert (severity, text.partition(":")[0]) == (Severity.CRITICAL, "no messages from it, and it was armed")
    assert "on_link_loss" in text


def test_a_cause_that_has_gone_says_since_when_and_stands_behind_those_that_stand() -> None:
    alerts = update(Alerts(), fleet_of(battery_percent=9, is_autopilot_connected=False), 100.0)
    assert len(began(alerts, Alerts(), "battery")) == 1
    assert began(alerts, alerts, "battery") == []
    later = update(alerts, fleet_of(battery_percent=9), 101.0)
    assert [(alert.what, alert.is_cleared, alert.last_s) for alert in later.pending] == [
        ("battery", False, 100.0),
        ("autopilot", True, 101.0),
    ]


def test_what_endangers_the_vehicle_is_an_alert() -> None:
    ill = fleet_of(is_armed=True, is_pose_valid=False, has_pilot_control=True, is_autopilot_connected=False)
    assert {alert.what: alert.severity for alert in update(Alerts(), ill, 100.0).listed} == {
        "autopilot": Severity.CRITICAL,
        "position": Severity.CRITICAL,
        "pilot": Severity.WARNING,
    }


def test_a_failsafe_of_the_autopilot_that_has_control_is_not_called_a_pilot() -> None:
    (alert,) = update(Alerts(), fleet_of(has_pilot_control=True, is_failsafe=True), 100.0).listed
    assert (alert.what, alert.text) == (
        "failsafe",
        "the autopilot's failsafe has control; resume to take it back",
    )


def test_a_link_that_loses_most_is_an_alert_once_it_has_settled() -> None:
    lossy = replace(PLATFORM, link=LinkStatistics(loss=0.6), received_s=110.0, began_s=100.0)
    assert update(Alerts(), fleet_of(lossy), 101.0).all == {}
    assert [alert.what for alert in update(Alerts(), fleet_of(lossy), 110.0).listed] == ["loss"]


def test_while_a_platform_comes_up_what_is_not_there_yet_is_no_alert() -> None:
    absent = ComponentLine(3, list(Health).index(Health.ABSENT), 0, 0, 0, 0)
    new = replace(PLATFORM, lines={**PLATFORM.lines, 3: (absent, 100.0)}, received_s=105.0, began_s=100.0)
    coming_up = fleet_of(new, is_autopilot_connected=False, has_pilot_control=True, is_armed=True, is_pose_valid=False)
    assert update(Alerts(), coming_up, 101.0).all == {}
    found = {alert.what for alert in update(Alerts(), fleet_of(new), 105.0).listed}
    assert found == {"component pose"}
    low = fleet_of(new, battery_percent=9)
    assert [alert.what for alert in update(Alerts(), low, 101.0).listed] == ["battery"]


def test_a_component_that_fails_is_one_alert_with_its_cause_and_its_own_events_are_none() -> None:
    states = list(Health)
    lines = {**PLATFORM.lines, 3: (ComponentLine(3, states.index(Health.FAULTY), 0, 0, 0, 1), 100.0)}
    problem = ComponentTrouble(name="pose", cause="Traceback\nLost: no pose", errors=1)
    fleet = fleet_of(replace(PLATFORM, lines=lines, troubles={"pose": problem}))
    fleet = reducers.note(fleet, "heron", Severity.ERROR, "working -> faulty", 100.0, source="pose")
    assert reported(update(Alerts(), fleet, 100.0)) == [(Severity.ERROR, "pose is faulty: Lost: no pose")]


def test_warnings_that_are_said_again_are_counted_and_go_when_they_are_acknowledged() -> None:
    fleet = fleet_of()
    for _ in range(3):
        fleet = reducers.note(fleet, "heron", Severity.WARNING, "gust", 100.0, source="limiter")
    fleet = reducers.note(fleet, "heron", Severity.NOTICE, "take-off", 100.0, source="driver")
    alerts = update(Alerts(), fleet, 100.0)
    assert [(alert.text, alert.count) for alert in alerts.listed] == [("limiter: gust", 3)]
    assert update(alerts, fleet, 101.0) is alerts
    assert acknowledge(alerts, alerts.pending[0].key).all == {}


def test_warnings_of_one_cause_are_one_alert_that_is_acknowledged_again_for_each_new_consequence() -> None:
    def warned(fleet: Fleet, text: str) -> Fleet:
        return reducers.note(fleet, "heron", Severity.WARNING, text, 100.0, source="mission", cause="failed sweep")

    fleet = warned(fleet_of(), "sweep.wall failed: no answer")
    first = update(Alerts(), fleet, 100.0)
    fleet = warned(warned(fleet, "policy hold: sweep failed: no answer"), "policy hold: sweep failed: no answer")
    second = update(first, fleet, 100.0)
    (alert,) = second.pending
    assert (alert.story, alert.count) == ("mission: sweep.wall failed: no answer; policy hold", 1)
    assert acknowledge(second).all == {}
    again = update(second, warned(fleet, "sweep.wall failed: no answer"), 100.0)
    assert [(alert.story, alert.count) for alert in again.pending] == [("mission: sweep.wall failed: no answer", 2)]


def test_warnings_that_follow_from_an_active_cause_are_in_its_alert_whichever_is_first() -> None:
    def warned(fleet: Fleet) -> Fleet:
        for text in ("low battery: 9 %; policy: land", "policy land: low battery"):
            fleet = reducers.note(fleet, "heron", Severity.WARNING, text, 100.0, source="mission", cause="battery")
        return fleet

    low = fleet_of(battery_percent=9)
    after = update(update(Alerts(), low, 100.0), warned(low), 100.1)
    before = update(update(Alerts(), warned(fleet_of()), 100.0), replace(warned(low), events=()), 100.1)
    for alerts in (after, before):
        (alert,) = alerts.pending
        assert alert.story == "battery at or below 15 %; low battery; policy land"
        assert (alert.severity, alert.is_over) == (Severity.CRITICAL, False)
    seen = acknowledge(after)
    assert seen.pending == []
    fleet = reducers.note(warned(low), "heron", Severity.WARNING, "landed hard", 101.0, cause="battery")
    assert [alert.consequences[-1] for alert in update(seen, fleet, 101.0).pending] == ["landed hard"]


def test_after_a_silence_a_vehicle_has_time_to_report_its_parts() -> None:
    absent = ComponentLine(3, list(Health).index(Health.ABSENT), 0, 0, 0, 0)
    ill = fleet_of(replace(PLATFORM, lines={**PLATFORM.lines, 3: (absent, 100.0)}))
    summary = Envelope("heron/ci/vehicle", Source("heron", "ci", PLATFORM.boot), 1000, 0.0, "", "", VEHICLE)
    back = reducers.receive(ill, summary, 120.0)
    assert [alert.what for alert in update(Alerts(), back, 121.0).listed] == []
    later = replace(back, platforms={"heron": replace(back.platforms["heron"], received_s=126.0)})
    assert [alert.what for alert in update(Alerts(), later, 126.0).listed] == ["component pose"]


def test_a_refusal_of_what_the_operator_asked_for_is_an_answer_and_no_alert() -> None:
    fleet = reducers.note(fleet_of(), "heron", Severity.ERROR, "start: pose is faulty", 100.0)
    fleet = reducers.note(fleet, "", Severity.ERROR, "export: 'events.csv' is there already", 100.0)
    assert update(Alerts(), fleet, 100.0).all == {}
    fleet = reducers.note(fleet, "", Severity.WARNING, "another station has this id", 100.0)
    assert reported(update(Alerts(), fleet, 100.0)) == [(Severity.WARNING, "another station has this id")]


def test_a_dismissed_refusal_is_not_shown_again_and_a_new_one_is() -> None:
    fleet, alerts = reducers.note(fleet_of(), "heron", Severity.ERROR, "start: pose is faulty", 100.0), Alerts()
    refusal = answer(alerts, fleet, 101.0)
    assert refusal is not None
    alerts = update(dismiss(alerts, refusal), fleet, 101.0)
    assert answer(alerts, fleet, 101.0) is None
    fleet = reducers.note(fleet, "heron", Severity.ERROR, "start: pose is faulty", 102.0)
    assert answer(update(alerts, fleet, 102.0), fleet, 102.0) == fleet.events[-1]


def test_the_worst_comes_first_then_the_newest() -> None:
    fleet = fleet_of(battery_percent=9)
    for number in range(2):
        fleet = reducers.note(fleet, "heron", Severity.WARNING, f"number {number}", 100.0 + number, source="x")
    texts = [text for _, text in reported(update(Alerts(), fleet, 101.0))]
    assert texts == ["battery at or below 15 %", "x: number 1", "x: number 0"]


def test_a_day_of_warnings_does_not_pile_up() -> None:
    alerts, fleet = Alerts(), fleet_of()
    for number in range(KEPT + 50):
        fleet = reducers.note(fleet, "heron", Severity.WARNING, f"number {number}", 100.0 + number, source="x")
        alerts = update(alerts, replace(fleet, events=fleet.events[-1:]), 100.0)
    assert len(alerts.all) == KEPT
    assert ("heron", f"event x: number {KEPT + 49}") in alerts.all
