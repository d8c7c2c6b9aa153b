"""Supervision: standbys that take over, attempts with back-off, verdicts, silence, health; pure, and over real hosts."""

from typing import Any

import msgspec
import pytest
from tests.common.supervised import ALONE, PAIR, pair, reply_to, reported, row, words

from gloc3.component.deployment import FaultPolicy
from gloc3.component.lci import Command, State
from gloc3.component.supervision import (
    HEARTBEAT_STATE,
    KEEP_TRYING_S,
    STABLE_S,
    LciRequest,
    Step,
    Supervision,
    SupervisionVerdict,
)
from gloc3.errors import Refused
from gloc3.messages.envelope import CommandReply
from gloc3.messages.summaries import Health


def test_a_quiet_standby_takes_over_within_the_call_that_tells_of_the_fault() -> None:
    supervision = pair()
    steps = reported(supervision, 5.0, main=State.FAULTY)
    assert words(steps) == ["spare: resume"]
    assert steps[0].reason == "main: ValueError: odd"
    assert supervision.in_charge("main") == supervision.in_charge("spare") == "spare"


def test_the_old_primary_is_then_brought_up_quietly_and_is_the_new_standby() -> None:
    supervision = pair()
    (resume,) = reported(supervision, 5.0, main=State.FAULTY)
    assert supervision.receive_reply(reply_to(resume, State.WORKING), 5.01) == []
    assert supervision.tick(5.4) == []
    (up,) = supervision.tick(5.5)
    assert words([up]) == ["main: initialize start goquiet"]
    assert supervision.receive_reply(reply_to(up, State.QUIET), 5.6) == []
    assert words(reported(supervision, 7.0, spare=State.FAULTY)) == ["main: resume"]
    assert supervision.in_charge("spare") == "main"


def test_a_primary_that_is_lost_with_its_host_gives_way_at_once_and_goes_quiet_when_it_is_back() -> None:
    supervision = pair()
    steps = supervision.lose("main", "host vision is lost", 5.0)
    assert words(steps) == ["spare: resume"]
    assert steps[0].reason == "main: host vision is lost"
    assert supervision.receive_reply(reply_to(steps[0], State.WORKING), 5.01) == []
    assert words(reported(supervision, 9.0, main=State.WORKING)) == ["main: goquiet"]
    assert supervision.in_charge("main") == "spare"


def test_a_component_that_is_lost_with_its_host_is_not_waited_for_but_its_policy_is_told_once() -> None:
    supervision = Supervision(ALONE)
    reported(supervision, 0.0, alone=State.WORKING)
    reason = "host vision is lost"
    assert supervision.lose("alone", reason, 1.0) == [SupervisionVerdict("alone", FaultPolicy.HOLD, reason)]
    assert supervision.lose("alone", reason, 2.0) == []
    assert supervision.tick(60.0) == []
    assert supervision.lose("nobody", reason, 2.0) == []


@pytest.mark.parametrize("is_told", [True, False], ids=["host lost", "silent"])
@pytest.mark.parametrize("is_under_way", [True, False], ids=["in the air", "on the ground"])
@pytest.mark.parametrize("state", [State.FAULTY, State.IDLE, State.STANDBY, State.WORKING])
def test_a_faulty_component_that_is_lost_before_it_is_up_again_is_not_waited_for(
    state: State, is_under_way: bool, is_told: bool
) -> None:
    supervision = Supervision(ALONE)
    supervision.is_under_way = is_under_way
    reported(supervision, 0.0, alone=State.WORKING)
    assert reported(supervision, 1.0, alone=State.FAULTY) == []
    if state is not State.FAULTY:
        assert words(supervision.tick(1.5)) == ["alone: initialize start"]
        assert reported(supervision, 1.6, alone=state) == []
    steps = supervision.lose("alone", "host vision is lost", 1.7) if is_told else []
    for second in range(2, 60):
        steps += supervision.tick(float(second))
    assert [words([step]) for step in steps if isinstance(step, SupervisionVerdict)] == [["alone: hold!"]]


def test_a_standby_that_fails_and_is_lost_while_it_takes_over_leaves_the_charge_to_its_primary() -> None:
    supervision = pair()
    assert words(reported(supervision, 1.0, main=State.FAULTY)) == ["spare: resume"]
    (up,) = supervision.tick(1.5)
    assert reported(supervision, 1.6, spare=State.FAULTY) == []
    supervision.lose("spare", "host vision is lost", 1.7)
    assert words(supervision.receive_reply(reply_to(up, State.QUIET), 1.8)) == ["main: resume"]
    assert supervision.in_charge("main") == "main"


def test_what_is_refused_while_a_component_is_brought_up_is_tried_again_and_then_it_is_lost() -> None:
    supervision = Supervision(ALONE)
    reported(supervision, 0.0, alone=State.WORKING)
    reported(supervision, 1.0, alone=State.FAULTY)
    steps: list[Step] = []
    for tenth in range(11, 300):
        for step in supervision.tick(0.1 * tenth):
            steps += [step, *supervision.receive_reply(reply_to(step, State.STANDBY, "not now"), 0.1 * tenth)]
        steps += steps and reported(supervision, 0.1 * tenth, alone=State.STANDBY)
    assert words(steps) == [*["alone: initialize start"] * 3, "alone: hold!"]


def test_without_a_standby_a_component_is_initialized_again_with_pauses_that_double_and_then_it_is_lost() -> None:
    supervision = Supervision(ALONE)
    reported(supervision, 0.0, alone=State.WORKING)
    assert reported(supervision, 1.0, alone=State.FAULTY) == []
    now_s = 1.0
    for pause_s in (0.5, 1.0, 2.0):
        assert supervision.next_tick_s() == pytest.approx(now_s + pause_s)
        now_s += pause_s
        (up,) = supervision.tick(now_s)
        assert words([up]) == ["alone: initialize start"]
        reported(supervision, now_s, alone=State.FAULTY)
        steps = supervision.receive_reply(reply_to(up, State.FAULTY, "initialize failed"), now_s)
    assert steps == [SupervisionVerdict("alone", FaultPolicy.HOLD, "ValueError: odd")]
    for second in range(10):
        assert reported(supervision, now_s + second, alone=State.FAULTY) == []
        assert supervision.tick(now_s + second) == []


def test_in_the_air_a_required_component_is_tried_for_as_long_as_it_takes_and_its_loss_is_told_once() -> None:
    supervision = Supervision(ALONE)
    supervision.is_under_way = True
    reported(supervision, 0.0, alone=State.WORKING)
    steps = reported(supervision, 0.5, alone=State.FAULTY)
    for tenth in range(10, 1000):
        now_s = 0.1 * tenth
        for step in supervision.tick(now_s):
            steps += [step, *supervision.receive_reply(reply_to(step, State.WORKING), now_s)]
            steps += reported(supervision, now_s, alone=State.WORKING)
        steps += reported(supervision, now_s + 0.05, alone=State.FAULTY)
    assert len([step for step in steps if isinstance(step, LciRequest)]) == pytest.approx(99.0 / KEEP_TRYING_S, abs=5.0)
    assert len([step for step in steps if isinstance(step, SupervisionVerdict)]) == 1
    supervision.is_under_way = False
    for second in range(100, 130):
        for step in supervision.tick(float(second)):
            supervision.receive_reply(reply_to(step, State.FAULTY, "initialize failed"), float(second))
        reported(supervision, float(second), alone=State.FAULTY)
    assert supervision.tick(131.0) == [], "on the ground somebody looks after it"


def test_a_component_that_was_up_for_long_has_all_its_attempts_again() -> None:
    supervision = Supervision(ALONE)
    now_s = 0.0
    reported(supervision, now_s, alone=State.WORKING)
    for lasts_s, pause_s in ((STABLE_S, 0.5), (5.0, 1.0), (STABLE_S, 0.5)):
        now_s += lasts_s
        reported(supervision, now_s, alone=State.FAULTY)
        assert supervision.next_tick_s() == pytest.approx(now_s + pause_s)
        now_s += pause_s
        (up,) = supervision.tick(now_s)
        supervision.receive_reply(reply_to(up, State.WORKING), now_s)


@pytest.mark.parametrize(
    ("on_fault", "verdicts"),
    [("ignore", []), ("land", ["alone: land!"]), ({"then": "return"}, ["alone: return!"])],
)
def test_a_bare_policy_is_a_verdict_at_once(on_fault: Any, verdicts: list[str]) -> None:
    supervision = Supervision([row("alone", on_fault=on_fault)])
    assert words(reported(supervision, alone=State.FAULTY)) == verdicts


def test_while_a_standby_is_in_charge_a_primary_that_is_past_help_is_no_verdict() -> None:
    supervision = pair()
    (resume,) = reported(supervision, main=State.FAULTY)
    supervision.receive_reply(reply_to(resume, State.WORKING), 0.0)
    now_s = 0.0
    for _ in range(2):
        now_s += 5.0
        reported(supervision, now_s, spare=State.WORKING, main=State.FAULTY)
        (up,) = supervision.tick(now_s)
        assert supervision.receive_reply(reply_to(up, State.FAULTY, "odd"), now_s) == []
    assert supervision.tick(now_s + 1.0) == []


def test_a_standby_in_charge_that_fails_with_nobody_left_is_judged_by_its_primarys_policy() -> None:
    supervision = pair()
    (resume,) = reported(supervision, main=State.FAULTY)
    supervision.receive_reply(reply_to(resume, State.WORKING), 0.0)
    reported(supervision, 0.1, spare=State.FAULTY)
    now_s, found = 0.1, list[str]()
    for _ in range(20):
        now_s += 1.0
        for step in supervision.tick(now_s):
            assert isinstance(step, LciRequest)
            reported(supervision, now_s, **{step.component: State.FAULTY})
            found += words(supervision.receive_reply(reply_to(step, State.FAULTY, "odd"), now_s))
        reported(supervision, now_s, main=State.FAULTY, spare=State.FAULTY)
    assert found == ["spare: land!"]


def test_a_standby_that_does_not_take_over_is_passed_over() -> None:
    rows = (*PAIR, row("third", begin="quiet", standby_for="main"))
    for answer in ("refusal", "silence"):
        supervision = Supervision(rows)
        reported(supervision, main=State.WORKING, spare=State.QUIET, third=State.QUIET)
        (resume,) = reported(supervision, main=State.FAULTY)
        assert words([resume]) == ["spare: resume"]
        if answer == "refusal":
            steps = supervision.receive_reply(reply_to(resume, State.QUIET, "not ready"), 0.1)
        else:
            steps = [step for step in supervision.tick(1.0) if step.component == "third"]
        assert words(steps) == ["third: resume"]


def test_a_primary_that_was_brought_up_quietly_resumes_after_its_standby_has_failed_to_take_over() -> None:
    for is_first in (True, False):
        supervision = pair()
        (resume,) = reported(supervision, 1.0, main=State.FAULTY)
        (up,) = supervision.tick(1.5)
        assert words([up]) == ["main: initialize start goquiet"]
        answers = [(resume, State.FAULTY, "ValueError: odd"), (up, State.QUIET, "")]
        steps: list[Step] = []
        for step, state, refusal in answers if is_first else reversed(answers):
            steps += reported(supervision, 1.6, **{step.component: state})
            steps += supervision.receive_reply(reply_to(step, state, refusal), 1.6)
        assert words(steps) == ["main: resume"]
        assert supervision.in_charge("main") == "main"


def test_a_resume_that_is_never_answered_goes_to_whoever_is_quiet_and_then_the_function_is_lost() -> None:
    supervision = pair()
    steps = reported(supervision, 0.9, main=State.FAULTY)
    (up,) = supervision.tick(1.4)
    steps += supervision.receive_reply(reply_to(up, State.QUIET), 1.5)
    for tenth in range(16, 100):
        steps += supervision.tick(0.1 * tenth)
        if tenth % 10 == 0:
            steps += reported(supervision, 0.1 * tenth, main=State.QUIET, spare=State.QUIET)
    assert words(steps)[:4] == ["spare: resume", "main: resume", "main: land!", "main: resume"]
    assert words(steps).count("main: land!") == 1
    assert set(words(steps[4:])) <= {"main: resume", "spare: resume"}
    assert len(steps) < 15, "one try a second"


def test_standbys_that_refuse_are_asked_once_until_they_report_again() -> None:
    supervision = Supervision((*PAIR, row("third", begin="quiet", standby_for="main")))
    reported(supervision, main=State.WORKING, spare=State.QUIET, third=State.QUIET)
    steps, asked = reported(supervision, 0.1, main=State.FAULTY), list[str]()
    while steps:
        asked += words(steps)
        steps = [after for step in steps for after in supervision.receive_reply(reply_to(step, State.QUIET, "no"), 0.1)]
    assert asked == ["spare: resume", "third: resume"]
    assert words(reported(supervision, 1.0, third=State.QUIET)) == ["third: resume"]


def test_a_quiet_component_that_turns_faulty_instead_of_taking_over_is_brought_up_again() -> None:
    supervision = pair()
    (resume,) = reported(supervision, 1.0, main=State.FAULTY)
    (up,) = supervision.tick(1.5)
    (again,) = [
        *supervision.receive_reply(reply_to(resume, State.FAULTY, "odd"), 1.6),
        *supervision.receive_reply(reply_to(up, State.QUIET), 1.6),
    ]
    assert words([again]) == ["main: resume"]
    supervision.receive_reply(reply_to(again, State.QUIET, "busy"), 1.7)
    reported(supervision, 1.8, main=State.FAULTY)
    assert "main: initialize start goquiet" in words([*supervision.tick(2.2), *supervision.tick(3.0)])


def test_what_an_operator_brings_up_quietly_stays_quiet() -> None:
    supervision = Supervision(ALONE)
    reported(supervision, 0.0, alone=State.FAULTY)
    assert reported(supervision, 0.2, alone=State.QUIET) == []
    assert supervision.tick(0.6) == []


def test_the_loss_of_a_function_is_told_once_however_often_a_standby_refuses() -> None:
    rows = (row("main", on_fault={"standby": "spare", "then": "land"}), PAIR[1])
    supervision = Supervision(rows)
    reported(supervision, main=State.WORKING, spare=State.QUIET)
    steps = reported(supervision, 0.5, main=State.FAULTY)
    found = words(steps)
    for second in range(1, 6):
        (resume,) = [step for step in steps if isinstance(step, LciRequest)]
        found += words(supervision.receive_reply(reply_to(resume, State.QUIET, "not ready"), float(second)))
        reported(supervision, float(second), main=State.FAULTY)
        steps = reported(supervision, float(second), spare=State.QUIET)
        found += words(steps)
    assert found.count("main: land!") == 1
    assert found.count("spare: resume") == 6


def test_a_failed_standby_that_is_not_in_charge_is_brought_up_quietly_and_is_no_loss() -> None:
    supervision = pair()
    assert reported(supervision, 1.0, spare=State.FAULTY) == []
    assert words(supervision.tick(1.5)) == ["spare: initialize start goquiet"]


def test_a_standby_that_comes_up_while_nobody_works_takes_over() -> None:
    supervision = pair()
    reported(supervision, 1.0, spare=State.FAULTY)
    (up,) = supervision.tick(1.5)
    reported(supervision, 1.6, main=State.FAULTY)
    assert words(supervision.receive_reply(reply_to(up, State.QUIET), 1.7)) == ["spare: resume"]


def test_silence_counts_as_absence_and_a_standby_takes_over() -> None:
    supervision = pair()
    reported(supervision, 2.5, spare=State.QUIET)
    assert supervision.next_tick_s() == 3.0
    assert supervision.tick(2.99) == []
    assert words(supervision.tick(3.0)) == ["spare: resume"]
    assert supervision.state("main") is None


def test_silence_of_a_component_that_is_alone_is_its_loss_and_no_attempt() -> None:
    supervision = Supervision(ALONE)
    reported(supervision, 0.0, alone=State.WORKING)
    assert supervision.tick(3.0) == [SupervisionVerdict("alone", FaultPolicy.HOLD, "no status for 3 periods")]
    assert supervision.tick(30.0) == []
    assert supervision.next_tick_s() is None
    assert reported(supervision, 31.0, alone=State.FAULTY) == []
    assert words(supervision.tick(31.5)) == ["alone: initialize start"]


def test_who_comes_back_from_silence_and_works_is_told_to_go_quiet() -> None:
    supervision = pair()
    reported(supervision, 2.5, spare=State.QUIET)
    (resume,) = supervision.tick(3.0)
    supervision.receive_reply(reply_to(resume, State.WORKING), 3.0)
    assert words(reported(supervision, 10.0, main=State.WORKING)) == ["main: goquiet"]
    assert reported(supervision, 10.1, main=State.WORKING) == []


@pytest.mark.parametrize("state", [State.IDLE, State.STANDBY, None])
def test_what_an_operator_took_down_is_left_alone(state: State | None) -> None:
    supervision = pair()
    assert reported(supervision, 1.0, main=state) == []
    reported(supervision, 2.0, spare=State.QUIET)
    assert supervision.tick(3.5) == []


def test_what_an_operator_brings_up_himself_is_not_brought_up_again() -> None:
    supervision = Supervision(ALONE)
    reported(supervision, 0.0, alone=State.FAULTY)
    reported(supervision, 0.2, alone=State.STANDBY)
    assert supervision.tick(0.6) == []


def test_who_hands_over_by_hand_is_followed() -> None:
    supervision = pair()
    assert reported(supervision, 1.0, main=State.QUIET) == []
    assert reported(supervision, 1.1, spare=State.WORKING) == []
    assert supervision.in_charge("main") == "spare"


def test_a_standby_that_is_seen_on_its_way_to_quiet_is_not_in_charge() -> None:
    supervision = Supervision(PAIR)
    assert reported(supervision, 0.0, main=State.STANDBY, spare=State.WORKING) == []
    assert reported(supervision, 0.01, main=State.WORKING) == []
    assert reported(supervision, 0.02, spare=State.QUIET) == []
    assert supervision.in_charge("main") == "main"
    assert supervision.health() is Health.WORKING


def test_a_standby_that_works_while_its_primary_never_came_up_is_in_charge() -> None:
    supervision = Supervision(PAIR)
    reported(supervision, 0.0, main=State.IDLE, spare=State.WORKING)
    assert supervision.in_charge("main") == "main"
    assert reported(supervision, 1.0, spare=State.WORKING) == []
    assert supervision.in_charge("main") == "spare"


def test_a_command_that_would_leave_two_with_the_same_outputs_working_is_refused() -> None:
    supervision = pair()
    with pytest.raises(Refused, match="main is working and has the same outputs"):
        supervision.check("spare", [Command.RESUME])
    supervision.check("spare", [Command.STOP, Command.START, Command.GOQUIET])
    supervision.check("main", [Command.GOQUIET])
    with pytest.raises(Refused, match="is not accepted in quiet"):
        supervision.check("spare", [Command.START])
    reported(supervision, main=State.QUIET)
    supervision.check("spare", [Command.RESUME])


def test_replies_and_statuses_of_others_are_none_of_ours() -> None:
    supervision = pair()
    assert reported(supervision, stranger=State.FAULTY) == []
    stranger = CommandReply(request_id="x", component="stranger", command="stop", is_accepted=False, state=None)
    assert supervision.receive_reply(stranger, 0.0) == []
    assert supervision.receive_reply(msgspec.structs.replace(stranger, component="main"), 0.0) == []


@pytest.mark.parametrize(
    ("states", "health"),
    [
        ({}, Health.ABSENT),
        ({"a": State.WORKING, "b": State.WORKING}, Health.WORKING),
        ({"a": State.WORKING, "b": State.QUIET}, Health.QUIET),
        ({"a": State.STANDBY, "b": State.QUIET}, Health.STANDBY),
        ({"a": State.STANDBY, "b": State.IDLE}, Health.IDLE),
        ({"a": None, "b": State.IDLE}, Health.ABSENT),
        ({"a": None, "b": State.FAULTY}, Health.FAULTY),
        ({"a": State.WORKING, "b": State.WORKING, "extra": State.FAULTY}, Health.WORKING),
    ],
)
def test_the_platforms_health_is_the_worst_of_its_required_components(
    states: dict[str, State | None], health: Health
) -> None:
    supervision = Supervision([row("a", required=True), row("b", required=True), row("extra")])
    reported(supervision, 0.0, **states)
    assert supervision.health() is health


def test_a_required_standby_that_is_quiet_is_well_and_so_is_a_quiet_primary_that_it_stands_for() -> None:
    rows = (PAIR[0], row("spare", begin="quiet", standby_for="main", required=True))
    supervision = Supervision(rows)
    reported(supervision, main=State.WORKING, spare=State.QUIET)
    assert supervision.health() is Health.WORKING
    reported(supervision, main=State.QUIET, spare=State.WORKING)
    assert supervision.health() is Health.WORKING
    reported(supervision, spare=State.QUIET)
    assert supervision.health() is Health.QUIET


def test_the_heartbeat_tells_the_health_in_mavlinks_words() -> None:
    assert HEARTBEAT_STATE == {
        Health.IDLE: 0,
        Health.STANDBY: 3,
        Health.WORKING: 4,
        Health.QUIET: 4,
        Health.ABSENT: 5,
        Health.FAULTY: 5,
    }
