"""Tasks that another program's plan makes up: `flown_by: autopilot` with `plan: FILE`."""

from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath

from gloc3.documents import schema
from gloc3.documents.document import Document, Where
from gloc3.documents.yaml_nodes import YamlNode
from gloc3.errors import Finding, InputError
from gloc3.messages.frames import GeoPoint
from gloc3.mission.formats import read_plan, read_wpl
from gloc3.mission.formats.as_it_is import PlanVehicle, file_order
from gloc3.mission.formats.items import ForeignPlan
from gloc3.mission.formats.plan_format import CONVERT_FIRST, NEEDS_PLUG_IN, is_added
from gloc3.mission.formats.to_mission import geofence_of
from gloc3.mission.model.model import FLY_FILE, GEO, Action, GeofenceFile, TaskOptions

Plans = Mapping[str, ForeignPlan]
"""By task."""
ACTION = "plan"
"""Name of the one action of such a task."""


def plans_in(document: Document, findings: list[Finding]) -> Plans:
    """The plans of the tasks, as far as they can be read; what is wrong has the lines of the plan's own file."""
    found: dict[str, ForeignPlan] = {}
    for where, name, node in _plan_nodes(document):
        if not isinstance(node.value, dict) or len(node.value) != 1:
            message, hint = "the plan's content is missing", "use the mission's file: its plans are sent with it"
            findings.append(document.finding(where, message, hint))
            continue
        file, content = next(iter(node.value.items()))
        suffix = PurePosixPath(str(file)).suffix
        if is_added(suffix):
            findings.append(document.finding(where, NEEDS_PLUG_IN, CONVERT_FIRST))
            continue
        try:
            read = read_plan if suffix == ".plan" else read_wpl
            found[name] = read(str(content), str(PurePosixPath(document.file).parent / str(file)))
        except InputError as error:
            findings += error.findings
        else:
            findings += found[name].findings
            if not found[name].items:
                message = f"{file} has no mission items{_parts(found[name])}"
                findings.append(document.finding(where, message, "choose a file with a mission"))
    return found


def _parts(plan: ForeignPlan) -> str:
    parts = [name for name, one in (("a fence", plan.fence), ("rally points", plan.rally)) if one]
    return f", only {' and '.join(parts)}" if parts else ""


def _plan_nodes(document: Document) -> Iterator[tuple[Where, str, YamlNode]]:
    tasks = document.root.children.get("tasks")
    for name, task in tasks.children.items() if tasks is not None else ():
        node = task.children.get("plan")
        if node is not None and node.value is not None:
            yield ("tasks", str(name), "plan"), str(name), node


def first_place(plans: Plans) -> GeoPoint | None:
    """Home of the first plan, or the first position that it flies to."""
    for plan in plans.values():
        if plan.home is not None and any(plan.home[:2]):
            return GeoPoint(plan.home[0], plan.home[1], 0.0)
        for item in plan.items:
            if item.has_position and abs(item.x or 0.0) <= 90.0:
                return GeoPoint(item.x or 0.0, item.y or 0.0, 0.0)
    return None


def plan_action(
    name: str,
    plans: Plans,
    options: TaskOptions,
    document: Document,
    origin: GeoPoint | None,
    home_altitude_m: float | None,
    vehicle: PlanVehicle,
) -> tuple[Action | None, list[Finding]]:
    """The action of a task with a plan, and what is wrong with the task."""
    where: Where = ("tasks", name, "plan")
    wrong: list[Finding] = []
    if options.flown_by != "autopilot":
        wrong.append(
            document.finding(where, "a plan is flown by the autopilot", "add flown_by: autopilot", at_key=True)
        )
    if document.value.get("frame") != GEO:
        wrong.append(document.finding(("frame",), "a plan of another program needs frame geo", "write frame: geo"))
    if "actions" in document.node(where[:2]).children:
        wrong.append(document.finding(where, f"{name} has a plan and actions", "keep one of them", at_key=True))
    plan = plans.get(name)
    if plan is None or origin is None or wrong:
        return None, wrong
    files = document.node(where).value
    file = next(iter(files)) if isinstance(files, dict) else ""
    order = file_order(plan, str(file), origin, home_altitude_m, vehicle)
    if order.follows_ground:
        message = f"{file} has heights above the ground, which only the autopilot's own terrain data can keep"
        wrong.append(document.finding(where, message, "here they are checked as above home", is_warning=True))
    action = Action(name=ACTION, capability=FLY_FILE, arguments=order, filled=order, order=order, is_planned=True)
    return action, wrong


def fence_of(plans: Plans, document: Document, findings: list[Finding]) -> GeofenceFile | None:
    """The fence of the plans, where the mission has none of its own; rally points are left out."""
    if any(plan.rally for plan in plans.values()):
        message, hint = "the plan's rally points are left out", "upload them by the station"
        findings.append(document.finding(("tasks",), message, hint, at_key=True, is_warning=True))
    written = document.root.children.get("geofence")
    if written is not None and written.value is not None:
        return None
    areas = tuple(area for plan in plans.values() for area in plan.fence)
    found = geofence_of(areas, document.file, findings)
    node = YamlNode(found, 1, 1)
    return schema.check(node, GeofenceFile, document.file, []) if found else None
