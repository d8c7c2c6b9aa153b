"""Checks that the contingencies named by policies exist and can run under their condition."""

from collections.abc import Iterable, Iterator
from math import dist
from typing import Final

from gloc3.amounts import beside
from gloc3.documents.document import Document, Where
from gloc3.errors import Finding, nearest
from gloc3.messages.frames import Vector3
from gloc3.mission.checking.estimate import estimate, return_energy_wh
from gloc3.mission.checking.space_check import PlacedLeg
from gloc3.mission.model.arguments import FollowWaypointsOrder, LandOrder, ReturnHome
from gloc3.mission.model.fence import TOLERANCE_M
from gloc3.mission.model.legs import Budget
from gloc3.mission.model.model import Action, Contingency, ItemFile, Mission, Task, part_of
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.structure import PartialOrder
from gloc3.platform.platform import Platform

ANSWERS: Final = ("on_link_loss", "on_overdue", "on_low_battery", "on_pose_lost", "on_obstacle", "on_component_fault")
"""The policies that may name a task."""
_ENDS_NOTHING: Final = (None, Policy.CONTINUE, Policy.SKIP, Policy.RETRY)


def contingency_findings(mission: Mission) -> Iterator[Finding]:
    """Contingencies that are missing, unused, or hold options that make no sense there."""
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
            yield document.finding(where, f"{name!r} is also the name of a task", "give it another name", at_key=True)
        if name not in {answer.task for answer in wanted.values()}:
            hint = f"use it in a policy, as on_low_battery: {{task: {name}, then: land}}"
            yield document.finding(where, f"no policy names {name!r}", hint, at_key=True, is_warning=True)
        yield from _senseless(document, name, task)
    lost = wanted.get("on_pose_lost")
    if lost is not None and lost.task in mission.contingencies:
        for action in mission.contingencies[lost.task].actions.values():
            if action.order.moves and hasattr(action.order, "waypoints_ned_m"):
                place = ("contingencies", lost.task, "actions", action.name)
                message = f"{action.name} cannot be flown when the pose is lost"
                yield document.finding(place, message, "use only land, hold or record_images", at_key=True)


def _senseless(document: Document, name: str, task: Task) -> Iterator[Finding]:
    where: Where = ("contingencies", name)
    if task.options.after:
        hint = "a policy starts it"
        yield document.finding((*where, "after"), "a contingency cannot have after", hint, at_key=True)
    items: list[tuple[Where, ItemFile]] = [(where, task.options)]
    items += [((*where, "actions", one.name), one.options) for one in task.actions.values()]
    for place, options in items:
        if options.on_failure not in _ENDS_NOTHING:
            message = f"on_failure: {options.on_failure} inside a contingency"
            hint = "use continue, skip or retry; what follows is set by then: in the policy"
            yield document.finding((*place, "on_failure"), message, hint)


def path_findings(
    mission: Mission, name: str, path: Iterable[PlacedLeg], budget: Budget, platform: Platform | None
) -> Iterator[Finding]:
    """Warns where a contingency could not be flown, for every known position at which the mission may be.

    Its first leg is a straight line from there, which may leave the fence. With a low battery, the contingency and its
    follow-up must be flown with the reserve.

    Args:
        mission: the whole mission.
        name: of the contingency.
        path: the path of the mission.
        budget: home and speeds.
        platform: provides margin and battery; None where it is unknown.
    """
    document, part = mission.document, part_of(mission, name)
    order = PartialOrder.of(part)
    first = _first_path(part, order)
    legs = [(one.target, one.leg) for one in path if one.is_end_known and one.leg.length_m > 0.0]
    if document is None or first is None or not legs:
        return
    action, begin = first
    fence = mission.fence
    margin_m = platform.limits.margin_m if platform is not None else 0.0
    where: Where = ("contingencies", name, "actions", action.name, action.capability)
    if fence is not None and fence.clearance_m(begin) >= margin_m - TOLERANCE_M:
        for target, leg in legs:
            is_inside = fence.clearance_m(leg.end) >= margin_m - TOLERANCE_M
            if is_inside and fence.leg_clearance_m(leg.end, begin) < margin_m - TOLERANCE_M:
                message = (
                    f"from the end of a leg of {target} the straight path to {name}.{action.name} leaves the fence"
                )
                hint = "begin with waypoints inside the fence, or move the first one"
                yield document.finding(where, message, hint, at_key=True, is_warning=True)
                break
    wanted = mission.policies.on_low_battery
    power = platform.power if platform is not None else None
    if power is None or not isinstance(wanted, Contingency) or wanted.task != name:
        return
    far = max((leg.end for _, leg in legs), key=lambda place: dist(place, begin))
    needed_s = estimate(part, order, far, budget, power)
    follows_wh = return_energy_wh(needed_s.end_ned_m, budget, power) if wanted.then == "return" else 0.0
    reserve_wh = power.battery_wh * power.reserve
    if (needed_wh := needed_s.energy_wh + follows_wh) > reserve_wh:
        message = f"from the farthest place {name} takes {beside(needed_wh, reserve_wh)} Wh, more than the reserve of {reserve_wh:.1f} Wh"
        hint = "shorten it, or keep a larger reserve"
        yield document.finding(("on_low_battery",), message, hint, is_warning=True)


def _first_path(part: Mission, order: PartialOrder) -> tuple[Action, Vector3] | None:
    """The first action that leaves the position where a contingency begins, and its first waypoint in NED."""
    actions = part.actions()
    for target in order.targets:
        match actions[target].order:
            case FollowWaypointsOrder(waypoints_ned_m=(begin, *_)):
                return actions[target], begin
            case ReturnHome() | LandOrder():
                return None
    return None
