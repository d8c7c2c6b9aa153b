"""The one table of states of actions, tasks and missions, and the order of the policies."""

import pytest

from gloc3.errors import Refused
from gloc3.mission.model.model import Policies
from gloc3.mission.model.policy import MANOEUVRES, Policy, resolved
from gloc3.mission.model.states import TABLE, ActionState, StateTrigger, allowed, to_mermaid, transition

DRAWING = """\
stateDiagram-v2
    [*] --> waiting
    waiting --> running: start
    waiting --> skipped: skip
    waiting --> aborted: abort
    running --> paused: pause
    running --> done: finish
    running --> failed: fail
    running --> skipped: skip
    running --> aborted: abort
    paused --> running: resume
    paused --> done: finish
    paused --> failed: fail
    paused --> skipped: skip
    paused --> aborted: abort
    failed --> waiting: retry
    failed --> skipped: skip
    failed --> aborted: abort
    done --> waiting: repeat
    skipped --> waiting: repeat
    done --> [*]
    skipped --> [*]
    aborted --> [*]
"""


def test_the_table_is_as_drawn() -> None:
    assert to_mermaid() == DRAWING


def test_what_has_no_row_is_refused_with_what_would_be_accepted() -> None:
    with pytest.raises(Refused, match=r"^pause is not accepted in failed; accepted: retry, skip, abort$"):
        transition(ActionState.FAILED, StateTrigger.PAUSE)
    with pytest.raises(Refused, match=r"^start is not accepted in done; accepted: nothing$"):
        transition(ActionState.DONE, StateTrigger.START)


def test_every_state_has_a_row_and_what_is_allowed_leads_on() -> None:
    assert set(TABLE) == set(ActionState)
    for state in ActionState:
        for trigger in allowed(state):
            assert transition(state, trigger) is not state


def test_abort_becomes_the_mission_s_on_failure_or_a_hold() -> None:
    for policy in Policy:
        assert resolved(Policy.ABORT, policy) is (policy if policy in MANOEUVRES else Policy.HOLD)
    assert resolved(Policy.SKIP, Policy.LAND) is Policy.SKIP


def test_a_mission_that_says_nothing_of_its_policies_has_those_of_the_design() -> None:
    policies = Policies()
    assert (policies.link_loss_after_s, policies.hold_s, policies.on_restart) == (5.0, 60.0, "hold")
