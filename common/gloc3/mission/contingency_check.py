"""Whether the tasks that policies name are there, and can run when what they are for has happened."""

from collections.abc import Iterator
from typing import Final

from gloc3.document import Document, Where
from gloc3.errors import Finding, nearest
from gloc3.mission.model import Contingency, ItemFile, Mission, Task
from gloc3.mission.policy import Policy

ANSWERS: Final = ("on_link_loss", "on_overdue", "on_low_battery", "on_pose_lost", "on_obstacle", "on_component_fault")
"""The policies that may name a task."""
_ENDS_NOTHING: Final = (None, Policy.CONTINUE, Policy.SKIP, Policy.RETRY)


def contingency_findings(mission: Mission) -> Iterator[Finding]:
    """Tasks that are named and not there, or there and not named; and what has no sense in them."""
    document = mission.document
    if document is None:
        return
    wanted = {key: answer for key in ANSWERS if isinstance(answer := getattr(mission.policies, key), Contingency)}
    for key, answer in wanted.items():
        if answer.task not in mission.contingencies:
            hint = nearest(answer.task, list(mission.contingencies)) if mission.contingencies else "write contingencies"
            yield document.finding((key, "task"), f"there is no contingency {answer.task!r}", hint)
    for name, task in mission.contingencies.items():
        where: Where = ("contingencies", name)
        if name in mission.tasks:
            yield document.finding(where, f"{name!r} is the name of a task, too", "name it otherwise", at_key=True)
        if name not in {answer.task for answer in wanted.values()}:
            hint = f"say on_low_battery: {{task: {name}, then: land}}, say"
            yield document.finding(where, f"no policy names {name!r}", hint, at_key=True, is_warning=True)
        yield from _senseless(document, name, task)
    lost = wanted.get("on_pose_lost")
    if lost is not None and lost.task in mission.contingencies:
        for action in mission.contingencies[lost.task].actions.values():
            if action.order.moves and hasattr(action.order, "waypoints_ned_m"):
                place = ("contingencies", lost.task, "actions", action.name)
                message = f"{action.name} cannot be flown when the pose is lost"
                yield document.finding(place, message, "land, or hold, or record", at_key=True)


def _senseless(document: Document, name: str, task: Task) -> Iterator[Finding]:
    where: Where = ("contingencies", name)
    if task.options.after:
        hint = "it begins when a policy says so"
        yield document.finding((*where, "after"), "a contingency comes after nothing", hint, at_key=True)
    items: list[tuple[Where, ItemFile]] = [(where, task.options)]
    items += [((*where, "actions", one.name), one.options) for one in task.actions.values()]
    for place, options in items:
        if options.on_failure not in _ENDS_NOTHING:
            message = f"on_failure: {options.on_failure} inside a contingency"
            hint = "what follows it is said by then: in the policy; here continue, skip or retry"
            yield document.finding((*place, "on_failure"), message, hint)
