"""Commands allowed on a mission, task or action, by the state table."""

from typing import Final

from gloc3.messages.command_interface import Verb
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.model.states import ENDED, ActionState, StateTrigger, allowed
from gloc3_groundstation.missions.outline import COMMANDS

COMMANDED: Final = {
    StateTrigger.PAUSE: Verb.PAUSE,
    StateTrigger.RESUME: Verb.RESUME,
    StateTrigger.SKIP: Verb.SKIP,
    StateTrigger.ABORT: Verb.ABORT,
    StateTrigger.RETRY: Verb.RETRY,
}
"""Start is not among them: an item starts when its turn comes, and the mission is started by the desk."""


def state_of(mission: MissionSummary | None, target: str) -> ActionState | None:
    """The state of the mission (empty), a task or an action; None where nothing is known of it."""
    if mission is None:
        return None
    state = mission.state if not target else mission.tasks.get(target, "")
    return ActionState(state) if state in list(ActionState) else None


def legal_verbs(mission: MissionSummary | None, target: str) -> frozenset[Verb]:
    """What the platform would accept, as far as its state tells."""
    state = state_of(mission, target)
    if mission is None or state is None:
        return frozenset()
    verbs = {COMMANDED[trigger] for trigger in allowed(state) if trigger in COMMANDED}
    if not target:
        verbs.discard(Verb.RETRY)
        return frozenset(verbs) - ({Verb.SKIP, Verb.ABORT} if state in ENDED else frozenset())
    task, _, action = target.partition(".")
    above = ["", task] if action else [""]
    if task.startswith(COMMANDS):
        above.remove("")
    parents = [state_of(mission, parent) for parent in above]
    if any(parent in ENDED and parent is not ActionState.FAILED for parent in parents):
        return frozenset()
    if "" in above and parents[0] is ActionState.FAILED:
        return frozenset()
    if ActionState.PAUSED in parents:
        verbs.discard(Verb.RESUME)
    return frozenset(verbs)
