"""Who holds control, and what the server knows of the components."""

import msgspec
import pytest

from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.errors import Refused
from gloc3.messages.command_interface import Control, ControlVerb
from gloc3.messages.envelope import ComponentStatus, Kind
from gloc3.messages.summaries import ComponentLine, Health
from gloc3_onboard.command_server.authority import ANSWER_S, MOST_HEARD, ControlAuthority
from gloc3_onboard.command_server.component_book import ComponentBook

GONE_S = 5.0


def request(authority: ControlAuthority, station: str, verb: ControlVerb, now_s: float = 0.0, about: str = "") -> str:
    authority.note_contact(station, now_s)
    return authority.handle(station, Control(verb=verb, station=about), GONE_S, now_s)


def held() -> ControlAuthority:
    authority = ControlAuthority()
    assert request(authority, "255", ControlVerb.REQUEST) == "granted"
    return authority


def test_the_first_who_asks_is_granted_and_asking_again_changes_nothing() -> None:
    authority = held()
    assert request(authority, "255", ControlVerb.REQUEST) == "granted"
    authority.require("255")
    with pytest.raises(Refused, match="station 255 holds control; request control first"):
        authority.require("254")
    with pytest.raises(Refused, match="no station holds control"):
        ControlAuthority().require("255")


def test_the_holder_is_asked_and_grants_or_refuses() -> None:
    authority = held()
    assert request(authority, "254", ControlVerb.REQUEST) == "station 255 has been asked"
    assert request(authority, "255", ControlVerb.REFUSE) == "refused"
    assert authority.state().requested_by == ""
    request(authority, "254", ControlVerb.REQUEST)
    with pytest.raises(Refused, match="station 253 has not requested"):
        request(authority, "255", ControlVerb.GRANT, about="253")
    assert request(authority, "255", ControlVerb.GRANT, about="254") == "granted to station 254"
    assert authority.holder == "254"


def test_a_second_request_does_not_push_the_first_aside() -> None:
    authority = held()
    request(authority, "254", ControlVerb.REQUEST)
    with pytest.raises(Refused, match="station 254 has already requested"):
        request(authority, "253", ControlVerb.REQUEST)
    assert authority.requested_by == "254"
    assert request(authority, "254", ControlVerb.REQUEST) == "station 255 has been asked"


def test_a_vehicle_in_the_air_that_nobody_holds_is_unattended_once_no_station_is_heard() -> None:
    authority = held()
    assert authority.unattended_s(4.0, is_airborne=True) == 4.0
    request(authority, "255", ControlVerb.RELEASE, 10.0)
    authority.note_contact("254", 12.0)
    assert authority.unattended_s(13.0, is_airborne=True) == 1.0
    assert authority.unattended_s(1000.0, is_airborne=True) == 988.0
    assert authority.unattended_s(1000.0, is_airborne=False) == 0.0
    assert authority.unattended_s(1001.0, is_airborne=True) == 1.0, "it has just lifted off"


def test_a_vehicle_that_is_in_the_air_when_the_process_begins_is_attended_from_then() -> None:
    authority = ControlAuthority()
    assert authority.unattended_s(500.0, is_airborne=True) == 0.0
    assert authority.unattended_s(520.0, is_airborne=True) == 20.0


def test_only_the_holder_answers_and_releases() -> None:
    authority = held()
    request(authority, "254", ControlVerb.REQUEST)
    for verb in (ControlVerb.GRANT, ControlVerb.REFUSE, ControlVerb.RELEASE):
        with pytest.raises(Refused):
            request(authority, "254", verb)
    assert request(authority, "255", ControlVerb.RELEASE) == "released"
    assert authority.holder == "254"


def test_who_is_gone_loses_control_to_who_asks() -> None:
    authority = held()
    assert request(authority, "254", ControlVerb.REQUEST, 6.0) == "granted: station 255 is lost"


@pytest.mark.parametrize("is_gone", [True, False])
def test_a_request_that_is_not_answered_is_granted_if_the_holder_is_gone_else_refused(is_gone: bool) -> None:
    authority = held()
    request(authority, "254", ControlVerb.REQUEST, 1.0)
    if not is_gone:
        authority.note_contact("255", ANSWER_S)
    assert not authority.tick(1.0 + ANSWER_S)
    assert authority.tick(1.1 + ANSWER_S)
    assert authority.state().holder == ("254" if is_gone else "255")
    assert authority.state().requested_by == ""
    assert not authority.tick(99.0)


def test_taking_over_needs_nobodys_leave() -> None:
    authority = held()
    assert request(authority, "254", ControlVerb.TAKE_OVER) == "taken over from station 255"
    assert authority.holder == "254"
    assert request(ControlAuthority(), "254", ControlVerb.TAKE_OVER) == "taken"


def test_silence_is_the_holders_and_strangers_are_forgotten_first() -> None:
    authority = held()
    assert ControlAuthority().silent_s(9.0) == 0.0
    for number in range(3 * MOST_HEARD):
        authority.note_contact(f"stranger-{number}", 1.0)
    assert len(authority._received_s) <= MOST_HEARD
    assert authority.silent_s(4.0) == 4.0


# --- the book ---


def row(name: str, **fields: object) -> ComponentRow:
    return msgspec.convert({"name": name, "class": "x:Y", **fields}, ComponentRow)


def status(name: str, state: State | None = State.WORKING, **fields: object) -> ComponentStatus:
    values = {"kind": Kind.SAMPLER, "nominal_rate_hz": 20.0, "rate_hz": 20.0, **fields}
    return ComponentStatus(name=name, state=state, **values)  # type: ignore[arg-type]


def test_a_line_of_the_summary_takes_at_most_sixteen_bytes() -> None:
    book = ComponentBook([row(f"c{number}") for number in range(300)])
    for name in book.rows:
        extreme = {"rate_hz": 1e9, "cycle_mean_s": 1e9, "overruns": 2**40 - 1, "errors": 2**40 - 1}
        book.receive(status(name, State.FAULTY, **extreme), 0.0)
    lines = book.summary(Health.FAULTY, 0.0).lines
    assert len(lines) == 300
    assert max(len(msgspec.msgpack.encode(line)) for line in lines) <= 16
    assert lines[0] == ComponentLine(0, list(Health).index(Health.FAULTY), 255, 255, 65535, 65535)


def test_a_component_that_is_silent_counts_as_absent_until_it_is_heard() -> None:
    book = ComponentBook([row("a", status_period_s=1.0)])
    assert book.state("a", 0.0) is None
    book.receive(status("a"), 0.0)
    assert book.state("a", 3.5) is State.WORKING
    assert book.state("a", 3.6) is None
    book.receive(status("a"), 4.0)
    assert book.is_working("a", 4.0)
    book.receive(status("stranger"), 4.0)
    assert book.status("stranger") is None


def test_one_that_has_just_come_up_is_not_relied_upon_yet() -> None:
    book = ComponentBook([row("a")])
    book.receive(status("a"), 1.0)
    assert not book.is_working("a", 1.1)
    assert book.is_working("a", 1.25)


def test_the_tables_number_changes_whenever_the_table_does() -> None:
    book = ComponentBook([row("a"), row("b", required=True, standby_for="a")])
    seen = {book.table().table}
    for received in (status("a"), status("b"), status("a", nominal_rate_hz=5.0)):
        book.receive(received, 0.0)
        assert book.table().table not in seen
        seen.add(book.table().table)
    book.receive(status("a", nominal_rate_hz=5.0, rate_hz=1.0), 1.0)
    assert book.table().table in seen
    assert book.summary(Health.WORKING, 1.0).table == book.table().table
    assert book.table().rows[1] == msgspec.structs.replace(
        book.table().rows[1], name="b", kind="SS", is_required=True, standby_for="a"
    )


def test_troubles_are_told_once_and_again_when_there_are_more() -> None:
    book = ComponentBook([row("a")])
    book.receive(status("a", errors=1, cause="odd"), 0.0)
    assert [(problem.name, problem.cause) for problem in book.new_problems()] == [("a", "odd")]
    assert book.new_problems() == []
    book.receive(status("a", errors=0), 1.0)
    book.new_problems()
    book.receive(status("a", errors=1, cause="again"), 2.0)
    assert [problem.cause for problem in book.new_problems()] == ["again"]
