"""Where the autopilot can fly a task's ways by itself, as plans: `flown_by: autopilot`, and why not."""

from collections.abc import Container, Iterator

from gloc3.errors import Finding
from gloc3.mission.arguments import Arguments, FollowWaypointsOrder
from gloc3.mission.model import FLY_PLAN, Action, Mission, where_of
from gloc3.platform import Platform


def may_be_planned(order: Arguments, capabilities: Container[str] | None) -> bool:
    """Whether what was ordered is flown as a plan on a platform with these capabilities (None: not known)."""
    return isinstance(order, FollowWaypointsOrder) and capabilities is not None and FLY_PLAN in capabilities


def plan_findings(mission: Mission, platform: Platform | None) -> Iterator[Finding]:
    """What keeps tasks that say `flown_by: autopilot` from being flown so."""
    document = mission.document
    if document is None:
        return
    for name, task in mission.tasks.items():
        if task.options.flown_by != "autopilot" or task.is_elsewhere:
            continue
        where = (*where_of(name), "flown_by")
        if platform is not None and FLY_PLAN not in platform.capabilities:
            message = f"the autopilot of {platform.platform} is given no plans: it has no capability {FLY_PLAN}"
            yield document.finding(where, message, "leave out flown_by")
            continue
        ways = [action for action in task.actions.values() if action.order.moves]
        for action in ways:
            problem = _problem(action)
            if problem:
                place = (*where_of(f"{name}.{action.name}"), action.capability)
                message = f"{name}.{action.name} cannot be flown by the autopilot alone: {problem}"
                yield document.finding(place, message, "put it into a task of its own", at_key=True)
        if not ways:
            message = f"{name} moves nothing that the autopilot could fly"
            yield document.finding(where, message, "leave out flown_by")


def _problem(action: Action) -> str:
    order = action.order
    if not isinstance(order, FollowWaypointsOrder):
        return "plans are made of ways through places only"
    if order.wall_distance_m is not None:
        return "it does not measure the distance to a wall"
    if order.altitude_m is not None:
        return "it keeps no height over the ground"
    if order.heading.mode not in ("along", "fixed"):
        return f"a plan says no heading {order.heading.mode.replace('_', ' ')!r}"
    return ""
