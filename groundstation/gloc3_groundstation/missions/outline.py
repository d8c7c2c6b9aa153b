"""Outline of a mission: tasks and actions with their order, without positions."""

from collections.abc import Mapping
from typing import Final

import msgspec

from gloc3.messages.command_interface import Verb
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.checking.checker import CheckReport
from gloc3.mission.checking.estimate import MissionEstimate, MissionFigures
from gloc3.mission.model.model import Action, Mission, Policies, Task, digest_of
from gloc3.mission.model.states import ENDED, ActionState, StateTrigger, allowed
from gloc3.mission.showing.show import summary, terms
from gloc3.platform.platform import Capability

COMMANDED: Final = {
    StateTrigger.PAUSE: Verb.PAUSE,
    StateTrigger.RESUME: Verb.RESUME,
    StateTrigger.SKIP: Verb.SKIP,
    StateTrigger.ABORT: Verb.ABORT,
    StateTrigger.RETRY: Verb.RETRY,
}
"""Start is not among them: an item starts when its turn comes, and the mission is started by the desk."""
COMMANDS: Final = "command-"
"""Prefix of the platform's tasks for single requested actions."""


class OutlineAction(msgspec.Struct, frozen=True, kw_only=True):
    """An action."""

    target: str
    """`TASK.ACTION`."""
    name: str
    what: str = ""
    """Its capability and arguments in a few words."""
    after: tuple[str, ...] = ()
    """The names of the actions of its task that come before it."""
    until: str = ""
    """Action with which it ends."""
    terms: tuple[str, ...] = ()
    """Further terms: deadline, policy, retries, claims."""
    capability: str = ""
    claims: tuple[str, ...] = ()
    duration_s: float | None = None
    """By the estimate; None where there is none."""


class OutlineTask(msgspec.Struct, frozen=True, kw_only=True):
    """A task."""

    name: str
    steps: tuple[OutlineAction, ...]
    after: tuple[str, ...] = ()
    """The tasks that come before it."""
    terms: tuple[str, ...] = ()


class Outline(msgspec.Struct, frozen=True, kw_only=True):
    """A mission."""

    title: str
    stages: tuple[OutlineTask, ...]
    digest: str = ""
    """Of its text."""
    platforms: tuple[str, ...] = ()
    """Those that its tasks name, where it is for several."""
    unassigned: tuple[str, ...] = ()
    """Tasks for which no platform is chosen yet."""
    policies: Policies | None = None
    """None while only the names are known."""
    duration_s: float | None = None
    length_m: float | None = None
    battery_share: float | None = None
    least: MissionFigures | None = None
    """Where guards may skip items, and loops end early: the least figures."""
    is_ordered: bool = True
    """False where only the names are known: the platform has reported states, and its order is not known yet."""

    def stage(self, name: str) -> OutlineTask | None:
        """A task by name."""
        return next((stage for stage in self.stages if stage.name == name), None)

    def step(self, target: str) -> OutlineAction | None:
        """An action by `TASK.ACTION`."""
        return next((step for stage in self.stages for step in stage.steps if step.target == target), None)

    def targets(self) -> tuple[str, ...]:
        """All tasks, each followed by its actions."""
        return tuple(target for stage in self.stages for target in (stage.name, *(one.target for one in stage.steps)))


def outline_of(report: CheckReport, capabilities: Mapping[str, Capability]) -> Outline | None:
    """The outline of a mission that was read, whatever is wrong with it; None where nothing of it can be drawn."""
    mission = report.mission
    if mission is None or not mission.tasks:
        return None
    figures = report.estimate
    return Outline(
        title=mission.name,
        stages=tuple(_stage(task, mission, figures, capabilities) for task in mission.tasks.values()),
        digest=digest_of(mission.text),
        platforms=mission.platforms,
        unassigned=mission.unassigned,
        policies=mission.policies,
        duration_s=figures.duration_s if figures is not None else None,
        length_m=figures.length_m if figures is not None else None,
        battery_share=(figures.battery_share or None) if figures is not None else None,
        least=figures.least if figures is not None else None,
    )


def received_outline(mission: MissionSummary, known: Outline | None) -> Outline:
    """Outline of the mission whose states a platform reports.

    Args:
        mission: the platform's report.
        known: the outline of the loaded mission, if known.
    """
    names: dict[str, list[str]] = {}
    for target in mission.tasks:
        task, _, action = target.partition(".")
        names.setdefault(task, []).extend([action] if action else [])
    stages = known.stages if known is not None else ()
    listed = {stage.name for stage in stages}
    others = [
        OutlineTask(name=task, steps=tuple(OutlineAction(target=f"{task}.{action}", name=action) for action in actions))
        for task, actions in names.items()
        if task not in listed
    ]
    if known is not None and not others:
        return known
    if known is not None:
        return msgspec.structs.replace(known, stages=(*stages, *others))
    is_ordered = all(stage.name.startswith(COMMANDS) for stage in others)
    return Outline(title=mission.name, stages=tuple(others), digest=mission.digest, is_ordered=is_ordered)


def _stage(
    task: Task, mission: Mission, figures: MissionEstimate | None, capabilities: Mapping[str, Capability]
) -> OutlineTask:
    return OutlineTask(
        name=task.name,
        after=tuple(name for name in task.options.after if name in mission.tasks),
        terms=tuple(terms(task.options)),
        steps=tuple(_step(task, action, figures, capabilities) for action in task.actions.values()),
    )


def _step(
    task: Task, action: Action, figures: MissionEstimate | None, capabilities: Mapping[str, Capability]
) -> OutlineAction:
    target = f"{task.name}.{action.name}"
    claims = capabilities[action.ability].claims if action.ability in capabilities else ()
    part = figures.actions.get(target) if figures is not None else None
    reported = [*terms(action.options), *([f"claims {', '.join(claims)}"] if claims else [])]
    return OutlineAction(
        target=target,
        name=action.name,
        what=summary(action),
        after=tuple(name for name in action.options.after if name in task.actions),
        until=action.options.until or "",
        terms=tuple(reported),
        capability=action.capability,
        claims=claims,
        duration_s=part.end_s - part.start_s if part is not None else None,
    )


def state_of(mission: MissionSummary | None, target: str) -> ActionState | None:
    """The state of the mission (empty), a task or an action; None where nothing is known of it."""
    if mission is None:
        return None
    state = mission.state if not target else mission.tasks.get(target, "")
    return ActionState(state) if state in list(ActionState) else None


def legal_verbs(mission: MissionSummary | None, target: str) -> frozenset[Verb]:
    """Commands that the platform would accept in its reported state."""
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
