"""What is offered for the mission, a task or an action: what the table of states allows, and nothing else."""

import pytest

from gloc3.messages.command_interface import Verb
from gloc3.messages.summaries import MissionSummary
from gloc3_groundstation.missions.outline import legal_verbs

P, R, S, A, T = Verb.PAUSE, Verb.RESUME, Verb.SKIP, Verb.ABORT, Verb.RETRY


def reported(mission: str, task: str = "running", action: str = "running") -> MissionSummary:
    return MissionSummary(name="m", digest="d", state=mission, tasks={"t": task, "t.a": action, "command-1": action})


@pytest.mark.parametrize(
    ("mission", "target", "verbs"),
    [
        (reported("running"), "", {P, S, A}),
        (reported("running"), "t.a", {P, S, A}),
        (reported("paused", "paused", "paused"), "", {R, S, A}),
        (reported("paused", "paused", "paused"), "t.a", {S, A}),  # the mission is paused: resume that
        (reported("running", "running", "paused"), "t.a", {R, S, A}),
        (reported("running", "running", "failed"), "t.a", {T, S, A}),
        (reported("running", "running", "waiting"), "t.a", {S, A}),
        (reported("running", "done", "done"), "t.a", set()),
        (reported("waiting", "waiting", "waiting"), "", {S, A}),
        (reported("done", "done", "done"), "", set()),
        (reported("failed", "failed", "failed"), "", set()),
        (reported("failed", "failed", "failed"), "t.a", set()),
        (reported("done", "done", "running"), "command-1", {P, S, A}),  # a single action is beside the mission
        (reported(""), "", set()),
        (None, "", set()),
        (reported("running", "running", "a state of later versions"), "t.a", set()),
    ],
)
def test_only_legal_verbs_are_offered(mission: MissionSummary | None, target: str, verbs: set[Verb]) -> None:
    assert legal_verbs(mission, target) == verbs
