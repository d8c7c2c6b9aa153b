"""Checks the options of tasks and actions: guards and loops, and `flown_by: autopilot`."""

from collections.abc import Iterator

from gloc3.component.deployment import ComponentRow
from gloc3.documents.document import Document, Where
from gloc3.errors import Finding, Gloc3Error
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.model.abilities import abilities, chooses_heading
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.mission.model.conditions import QUANTITIES, Condition
from gloc3.mission.model.exploring import ExploreOrder
from gloc3.mission.model.fence import Area, Fence
from gloc3.mission.model.model import FLY_PLAN, Action, ItemFile, Mission, where_of
from gloc3.mission.model.waypoint_options import given_options, options_of
from gloc3.platform.platform import Platform


def guard_findings(mission: Mission, platform: Platform | None) -> Iterator[Finding]:
    """Waits without a limit, options without their guard, and conditions on unmeasured quantities."""
    document = mission.document
    if document is None:
        return
    topics = None if platform is None or not platform.is_complete else platform.topics()
    for where, options in _items(mission):
        yield from _guard(document, where, options)
        if options.when is not None:
            yield from _measured(document, (*where, "when"), options.when, platform, topics)
    for name, task in mission.tasks.items():
        repeat = task.options.repeat
        if repeat is not None and repeat.until is not None:
            yield from _measured(document, (*where_of(name), "repeat", "until"), repeat.until, platform, topics)


def _items(mission: Mission) -> Iterator[tuple[Where, ItemFile]]:
    for name, task in mission.tasks.items():
        yield where_of(name), task.options
        for target, action in ((f"{name}.{one.name}", one) for one in task.actions.values()):
            yield where_of(target), action.options


def _guard(document: Document, where: Where, options: ItemFile) -> Iterator[Finding]:
    if options.when is None and "otherwise" in document.node(where).children:
        message, hint = "otherwise has no effect without when", "add when"
        yield document.finding((*where, "otherwise"), message, hint, at_key=True)
    elif options.when is not None and options.otherwise == "wait" and options.deadline_s is None:
        message, hint = "this wait may never end", "set deadline_s, which includes the wait"
        yield document.finding((*where, "otherwise"), message, hint)


def _measured(
    document: Document, where: Where, condition: Condition, platform: Platform | None, topics: set[str] | None
) -> Iterator[Finding]:
    for name in sorted(condition.quantities):
        topic = QUANTITIES[name].topic
        if platform is not None and topics is not None and topic and topic not in topics:
            message = f"{QUANTITIES[name].words} is not known on {platform.platform}: no component publishes {topic!r}"
            yield document.finding(where, message, "use a quantity that it measures")


def unkept_findings(mission: Mission, platform: Platform | None) -> Iterator[Finding]:
    """Path options that the component which flies the path does not support."""
    document = mission.document
    if document is None or platform is None:
        return
    rows, known = {row.name: row for row in platform.components}, abilities(platform)
    for target, action in mission.actions().items():
        order, ability = action.order, known.get(action.ability)
        if not isinstance(order, FollowWaypointsOrder) or ability is None or action.ability == FLY_PLAN:
            continue
        row = rows.get(ability.performed_by)
        for name, option in given_options(order) if row is not None else ():
            if row is not None and name not in kept_options(row):
                where = (*where_of(target), action.capability, name)
                yield document.finding(where, f"{row.name} of {platform.platform} {option.unkept}", "leave it out")
        if row is not None and not chooses_heading(row):
            yield from _unkept_heading(document, (*where_of(target), action.capability), order, row, platform)


def _unkept_heading(
    document: Document, where: Where, order: FollowWaypointsOrder, row: ComponentRow, platform: Platform
) -> Iterator[Finding]:
    """A heading that a component cannot keep which points along its path."""
    if order.plan and order.heading.mode != "along":
        message = f"{row.name} of {platform.platform} cannot point elsewhere than along its way"
        yield document.finding((*where, "heading"), message, "leave heading out")
    elif not order.heading.follows_path:
        message = f"{platform.platform} steers by its heading and cannot point elsewhere than along its path"
        hint = (
            "leave heading out" if "heading" in document.node(where).children else "go along it with follow_waypoints"
        )
        yield document.finding(where, message, hint)


def acceptance_findings(mission: Mission, platform: Platform | None) -> Iterator[Finding]:
    """Acceptance radii that are much less than what the vehicle keeps."""
    document = mission.document
    if document is None or platform is None:
        return
    kept_m = platform.limits.survey_acceptance_m
    for target, action in mission.actions().items():
        where = (*where_of(target), action.capability)
        given = document.node(where).children
        order = action.order
        is_written = isinstance(order, FollowWaypointsOrder) and "acceptance_m" in given
        if is_written and isinstance(order, FollowWaypointsOrder) and order.acceptance_m < 0.5 * kept_m:
            message = (
                f"{platform.platform} may pass no waypoint within {order.acceptance_m:g} m: it keeps to {kept_m:g} m"
            )
            hint = f"set {kept_m:g} or more, or leave it out"
            yield document.finding((*where, "acceptance_m"), message, hint, is_warning=True)


def area_findings(mission: Mission, fence: Fence | None) -> Iterator[Finding]:
    """Explorations that no area and no fence limits, and those outside the fence.

    Args:
        mission: the mission.
        fence: that of the loaded mission, where a single action beside it is checked.
    """
    document, fence = mission.document, mission.fence or fence
    inside = fence.area if fence is not None else None
    if document is None:
        return
    for target, action in mission.actions().items():
        if not isinstance(action.order, ExploreOrder):
            continue
        where, area = (*where_of(target), action.capability), action.order.area_ne_m
        if not area and inside is None:
            message = "nothing says where to explore: it has no area, and the mission no geofence"
            yield document.finding(where, message, "give it area_m (area in frame geo)", at_key=True)
        elif area and inside is not None and not Area(polygon_ne_m=area).overlaps(inside):
            message = "all of the area to explore is outside the fence"
            yield document.finding(where, message, "move the area or the fence", at_key=True)


def kept_options(row: ComponentRow) -> frozenset[str]:
    """Path options that a component supports; all of them where it declares none, or its class is not installed."""
    every = frozenset(options_of(FollowWaypointsOrder))
    try:
        kept: frozenset[str] = getattr(row.load_class(), "keeps", every)
    except Gloc3Error:
        return every
    return kept


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
            message = f"the autopilot of {platform.platform} accepts no plans: it lacks the capability {FLY_PLAN}"
            yield document.finding(where, message, "leave out flown_by")
            continue
        routes = [action for action in task.actions.values() if action.order.moves]
        for action in routes:
            if isinstance(action.order, FlyFileOrder) and action.order.never_ends:
                message = f"{action.order.never_ends} never ends: the task runs until an operator or a policy ends it"
                yield document.finding(
                    (*where_of(name), "plan"), message, "set deadline_s for another end", is_warning=True
                )
        if task.options.plan is not None:
            continue
        for action in routes:
            problem = _plan_problem(action)
            if problem:
                place = (*where_of(f"{name}.{action.name}"), action.capability)
                message = f"{name}.{action.name} cannot be flown by the autopilot alone: {problem}"
                yield document.finding(place, message, "put it into a task of its own", at_key=True)
        if not routes:
            message = f"{name} has no motion that the autopilot could fly"
            yield document.finding(where, message, "leave out flown_by")


def _plan_problem(action: Action) -> str:
    order = action.order
    if not isinstance(order, FollowWaypointsOrder):
        return "plans consist of waypoints only"
    for _, option in given_options(order):
        if not option.is_in_plans:
            return f"it {option.unkept}"
    if order.heading.mode not in ("along", "fixed"):
        return f"a plan cannot express heading {order.heading.mode.replace('_', ' ')!r}"
    return ""
