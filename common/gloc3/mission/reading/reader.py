"""Reads mission files: YAML in, a mission in NED with its fence out, or all errors in the file."""

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeVar

from msgspec import structs

from gloc3.documents import schema
from gloc3.documents.characters import first_steering
from gloc3.documents.document import Document, Where, load_bytes, parse
from gloc3.documents.format_version import check_format
from gloc3.documents.yaml_nodes import YamlNode
from gloc3.errors import Finding, InputError, Refused, nearest
from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.mission.formats.as_it_is import PlanVehicle
from gloc3.mission.model.abilities import abilities, nameable
from gloc3.mission.model.arguments import Arguments, FollowWaypointsOrder, argument_kinds
from gloc3.mission.model.fence import Area, Fence, polygon_problem
from gloc3.mission.model.model import (
    FIND_WAY,
    FLY_PLAN,
    Action,
    ActionFile,
    AreaFile,
    GeofenceFile,
    ItemFile,
    Mission,
    MissionFile,
    Policies,
    Task,
    TaskOptions,
    where_of,
)
from gloc3.mission.model.patterns import MAX_WAYPOINTS, height_is_known
from gloc3.mission.model.placement import Placement, Point
from gloc3.mission.model.structure import Tasks, structure_findings
from gloc3.mission.model.waypoint_options import WaypointOptions
from gloc3.mission.reading.assigned import assignment_findings, with_platforms, without_others
from gloc3.mission.reading.definitions import expanded
from gloc3.mission.reading.library import bundled
from gloc3.mission.reading.mission_site import MissionSite, site_of
from gloc3.mission.reading.plan_tasks import Plans, fence_of, first_place, plan_action, plans_in
from gloc3.platform.limits import Limits
from gloc3.platform.platform import Platform
from gloc3.terrain import Terrain

Item = TypeVar("Item", bound=ItemFile)

_ACTION_KEYS: Final = ActionFile.__struct_fields__


@dataclass(frozen=True, kw_only=True, slots=True)
class MissionReferences:
    """Context of a mission file: names that it refers to but does not define."""

    platform: str | None = None
    """Platform whose tasks are read; of others only the names are known. None for all."""
    frames: Mapping[str, LocalFrame] | None = None
    """Local frames by name; None where they are not known, and any name is taken."""
    origin: GeoPoint | None = None
    """Origin of NED; None for that of the mission's frame, or (frame geo) the first position of its tasks."""
    home_altitude_m: float | None = None
    """Altitude above the sea of the vehicle on the ground; None for that of the origin."""
    home: GeoPoint | None = None
    """Where the vehicle was armed; None for at the origin, where heights above the ground are placed."""
    terrain: Terrain | None = None
    """Heights of the ground; None without tiles, and missions with heights above the ground are refused."""
    is_ground_level: bool = False
    """Heights above the ground are taken as above home where there are no tiles: to convert a mission, or to draw it from above."""
    capabilities: Mapping[str, str] | None = None
    """Capability to kind of arguments; None where they are not known, and each kind is a capability."""
    limits: Limits | None = None
    """The platform's; None where they are not known."""
    arm: bool = False
    """Whether missions may arm the platform."""
    assigned: Mapping[str, Sequence[str]] | None = None
    """Platform to its tasks in their order, in place of the file's `assigned`; tasks that are not listed and for which
    no platform is chosen are then another's."""
    ended: frozenset[str] = frozenset()
    """Tasks that are left out, as those of other platforms are: they have begun or ended already."""

    def vehicle(self) -> PlanVehicle:
        """What must be known for a plan of another program."""
        limits = self.limits
        if limits is None:
            return PlanVehicle(self.arm)
        return PlanVehicle(
            self.arm,
            limits.stays_down,
            is_level=limits.survey_height_m == 0.0,
            circles_home=limits.speed_min_m_s > 0.0 and limits.rotors_speed_m_s <= 0.0,
        )

    @classmethod
    def of(
        cls,
        platform: Platform | None,
        *,
        frames: Mapping[str, LocalFrame] | None = None,
        origin: GeoPoint | None = None,
        home_altitude_m: float | None = None,
        home: GeoPoint | None = None,
        terrain: Terrain | None = None,
        is_ground_level: bool = False,
    ) -> "MissionReferences":
        """References of a platform (if known), with the frames of a world in addition to its own."""
        capabilities = None
        if platform is not None:
            frames = {**(frames or {}), **platform.local_frames()}
            capabilities = {name: row.arguments for name, row in nameable(abilities(platform)).items()}
        return cls(
            platform=platform.platform if platform is not None else None,
            frames=frames,
            origin=origin,
            home_altitude_m=home_altitude_m,
            home=home,
            terrain=terrain,
            is_ground_level=is_ground_level,
            capabilities=capabilities,
            limits=platform.limits if platform is not None else None,
            arm=platform is not None and platform.arm,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Reading:
    """Content of a mission file, usable or not."""

    document: Document
    findings: list[Finding]
    mission: Mission | None
    """None where the frame of the file is not usable at all; lacks the actions that are not."""
    tasks: Tasks
    contingencies: Tasks
    site: MissionSite | None = None
    """Where its positions are; None where it has no usable frame."""


def read_mission(data: bytes | str, file: str, surroundings: MissionReferences | None = None) -> Mission:
    """Reads a mission; does not check it against a platform (see `checker`).

    Raises:
        InputError: lists all errors in the file itself.
    """
    reading = inspect_mission(data, file, surroundings or MissionReferences())
    findings = [*reading.findings, *structure_findings(reading.tasks), *structure_findings(reading.contingencies)]
    if reading.mission is None or any(not finding.is_warning for finding in findings):
        raise InputError(sorted(findings))
    return reading.mission


def load_mission(name: str, surroundings: MissionReferences | None = None) -> Mission:
    """Reads a mission from a file, or an example by its name.

    Raises:
        InputError: lists all errors in the file itself.
    """
    from gloc3.mission.examples import find_mission

    path = find_mission(name)
    text = load_bytes(path).decode("utf-8-sig", "surrogateescape")
    return read_mission(bundled(text, path), str(path), surroundings)


def inspect_mission(data: bytes | str, file: str, surroundings: MissionReferences) -> Reading:
    """Reads as much of a mission as can be read.

    Raises:
        InputError: it is not YAML, no mapping, or of a newer format.
    """
    document = parse(data, file)
    findings: list[Finding] = []
    if not isinstance(document.value, dict):
        raise InputError([document.finding((), "a mission file is a mapping", "begin with 'mission: NAME'")])
    check_format(document)
    document = expanded(document, findings)
    written = schema.check(document.root, MissionFile, file, findings)
    findings += _name_findings(document)
    plans = plans_in(document, findings)
    site = site_of(document, surroundings, first_place(plans), findings)
    placement = site.placement if site is not None else None
    assigned = _assigned(document, written, surroundings, findings)
    tasks = _tasks(document, surroundings, placement, plans, findings, assigned)
    ready = _tasks(document.seen_as("tasks", "contingencies"), surroundings, placement, {}, findings)
    geofence = fence = None
    fence_node = document.root.children.get("geofence")
    if fence_node is not None and fence_node.value is not None:
        geofence = schema.check(fence_node, GeofenceFile, file, [])
    elif plans:
        geofence = fence_of(plans, document, findings)
    if geofence is not None and site is not None:
        fence = read_fence(geofence, site.level, document, findings)
    mission = None
    if written is not None:
        mission = Mission(
            name=written.mission,
            frame=written.frame,
            platform=written.platform,
            height_above=written.height_above,
            geofence=geofence,
            fence=fence,
            policies=Policies(**{name: getattr(written, name) for name in Policies.__struct_fields__}),
            deadline_s=written.deadline_s,
            tasks=tasks.read,
            contingencies=ready.read,
            text=data if isinstance(data, str) else data.decode("utf-8-sig"),
            document=document,
        )
    return Reading(document=document, findings=findings, mission=mission, tasks=tasks, contingencies=ready, site=site)


def _name_findings(document: Document) -> Iterator[Finding]:
    """Names with characters that steer a terminal or reverse text; tasks and actions have a pattern of their own."""
    for key in ("mission", "frame"):
        name = document.value.get(key)
        letter = first_steering(name) if isinstance(name, str) else ""
        if letter:
            message = f"the name has the control character U+{ord(letter):04X}"
            yield document.finding((key,), message, "leave it out")


def _tasks(
    document: Document,
    surroundings: MissionReferences,
    placement: Placement | None,
    plans: Plans,
    findings: list[Finding],
    assigned: Mapping[str, TaskOptions] | None = None,
) -> Tasks:
    """The tasks of a document, each with its actions as far as they can be used."""
    found = Tasks(document=document, read={}, skeleton={}, actions={})
    waypoints = 0
    for name, node in _entries(document.root, "tasks"):
        options = assigned[name] if assigned else _options(node, TaskOptions, document.file, [], name)
        is_elsewhere = name in surroundings.ended or _is_of_another(options, surroundings)
        if isinstance(node.value, dict) and not {"actions", "use", "plan"} & {*node.children}:
            hint = "give it actions, a plan, or use a definition"
            findings.append(document.finding(("tasks", name), f"'actions' is missing in {name}", hint))
        actions: dict[str, Action] = {}
        can_fly = surroundings.capabilities is None or FLY_PLAN in surroundings.capabilities
        if options.plan is not None and not is_elsewhere and can_fly:  # a check says that it cannot
            planned, wrong = plan_action(
                name,
                plans,
                options,
                document,
                surroundings.origin or first_place(plans),
                surroundings.home_altitude_m,
                surroundings.vehicle(),
            )
            findings += wrong
            if planned is not None:
                actions[planned.name] = planned
                found.actions[f"{name}.{planned.name}"] = planned.options
        for action_name, action_node in _entries(node, "actions"):
            target, where = f"{name}.{action_name}", where_of(f"{name}.{action_name}")
            if not isinstance(action_node.value, dict):
                found.actions[target] = ActionFile()
                continue
            if is_elsewhere or waypoints > MAX_WAYPOINTS:
                found.actions[target] = _options(action_node, ActionFile, document.file, findings, action_name)
                continue
            action = _action(action_name, action_node, where, document, surroundings, placement, findings)
            found.actions[target] = action if isinstance(action, ActionFile) else action.options
            if isinstance(action, Action) and isinstance(action.order, FollowWaypointsOrder):
                waypoints += len(action.order.waypoints_ned_m)
                if waypoints > MAX_WAYPOINTS:
                    message = f"the mission has {waypoints:,} waypoints up to here; the limit is {MAX_WAYPOINTS:,}"
                    findings.append(document.finding(where, message, "split the mission"))
            if isinstance(action, Action):
                is_planned = options.flown_by == "autopilot" and _may_be_planned(
                    action.order, surroundings.capabilities
                )
                is_routed = not is_planned and _may_be_routed(action.order, surroundings.capabilities)
                actions[action_name] = replace(action, is_planned=is_planned, is_routed=is_routed)
        found.skeleton[name] = options
        found.read[name] = Task(name=name, actions=actions, options=options, is_elsewhere=is_elsewhere)
    return found


def _is_of_another(options: TaskOptions, surroundings: MissionReferences) -> bool:
    """Whether another platform performs a task than that whose tasks are read."""
    if options.platform is None or surroundings.platform is None:
        return False
    is_left_out = surroundings.assigned is not None and options.is_unassigned
    return is_left_out or not options.is_for(surroundings.platform)


def _assigned(
    document: Document, written: MissionFile | None, surroundings: MissionReferences, findings: list[Finding]
) -> dict[str, TaskOptions]:
    """The options of all tasks, with the platforms that were chosen for them."""
    tasks = {
        name: _options(node, TaskOptions, document.file, [], name) for name, node in _entries(document.root, "tasks")
    }
    if surroundings.assigned is not None:
        chosen: Mapping[str, Sequence[str]] = surroundings.assigned
    else:
        chosen = written.assigned if written is not None else {}
        findings += assignment_findings(document, tasks, chosen)
    tasks = with_platforms(tasks, chosen)
    own = {name for name, options in tasks.items() if not _is_of_another(options, surroundings)}
    return {name: without_others(options, own) for name, options in tasks.items()}


def _may_be_planned(order: Arguments, capabilities: Container[str] | None) -> bool:
    """Whether an order is flown as a plan on a platform with these capabilities (None: unknown)."""
    return isinstance(order, FollowWaypointsOrder) and capabilities is not None and FLY_PLAN in capabilities


def _may_be_routed(order: Arguments, capabilities: Container[str] | None) -> bool:
    """Whether a way is found for an order on a platform with these capabilities (None: unknown)."""
    is_wanted = isinstance(order, FollowWaypointsOrder) and order.plan
    return is_wanted and capabilities is not None and FIND_WAY in capabilities


def _entries(node: YamlNode, key: str) -> Iterator[tuple[str, YamlNode]]:
    """The entries of a mapping inside a mapping, as far as they are there and have usable names."""
    inner = node.children.get(key)
    if inner is not None and isinstance(inner.value, dict):
        yield from ((str(name), child) for name, child in inner.children.items() if "." not in str(name))


def _action(
    name: str,
    node: YamlNode,
    where: Where,
    document: Document,
    surroundings: MissionReferences,
    placement: Placement | None,
    findings: list[Finding],
) -> Action | ActionFile:
    """An action, or only its options besides its capability where that is not usable."""
    options = _options(node, ActionFile, document.file, findings, name)
    capability = _capability(node, where, document, surroundings, findings)
    if capability is None:
        return options
    kind_name = capability if surroundings.capabilities is None else surroundings.capabilities[capability]
    kind = argument_kinds().get(kind_name)
    if kind is None:
        findings.append(document.finding((*where, capability), f"unknown kind of arguments {kind_name!r}", at_key=True))
        return options
    given = node.children[capability]
    if given.value is None:
        given = YamlNode({}, given.line, given.column)
    arguments: Arguments | None = schema.check(given, kind, document.file, findings, capability)
    if arguments is None or placement is None:
        return options
    try:
        if not height_is_known(placement, arguments):
            raise Refused("height_m is missing: the mission's heights are above sea level, the platform's above home")
        filled = _with_acceptance(arguments.filled(surroundings.limits), given, surroundings.limits)
        order = filled.order(placement)
    except Refused as refusal:
        findings.append(document.finding((*where, capability), str(refusal)))
        return options
    return Action(name=name, capability=capability, arguments=arguments, filled=filled, order=order, options=options)


def _with_acceptance(filled: Arguments, given: YamlNode, limits: Limits | None) -> Arguments:
    """With the platform's acceptance where the mission says none: no vehicle passes a place more exactly than it steers."""
    if limits is None or "acceptance_m" in given.children or not isinstance(filled, WaypointOptions):
        return filled
    return structs.replace(filled, acceptance_m=limits.survey_acceptance_m)


def _options(node: YamlNode, kind: type[Item], file: str, findings: list[Finding], name: str) -> Item:
    """What a task or action takes beside its content; the defaults where that does not fit."""
    own = YamlNode({}, node.line, node.column)
    own.key_places = node.key_places
    for key, child in node.children.items():
        if key in kind.__struct_fields__:
            own.value[key], own.children[key] = child.value, child
    return schema.check(own, kind, file, findings, name) or kind()


def _capability(
    node: YamlNode, where: Where, document: Document, surroundings: MissionReferences, findings: list[Finding]
) -> str | None:
    """The one key of an action that names its capability."""
    known = sorted(argument_kinds() if surroundings.capabilities is None else surroundings.capabilities)
    others = [str(key) for key in node.children if key not in _ACTION_KEYS]
    named = [key for key in others if key in known]
    if not others:
        findings.append(document.finding(where, "no capability is given", "known: " + ", ".join(known)))
    for key in others:
        if key not in known:
            what = "key" if named else "capability"
            hint = nearest(key, _ACTION_KEYS) if named else nearest(key, known, also=_ACTION_KEYS)
            findings.append(document.finding((*where, key), f"unknown {what} {key!r}", hint, at_key=True))
        elif key != named[0]:
            message = f"a second capability {key!r} beside {named[0]!r}"
            findings.append(document.finding((*where, key), message, "make it an action of its own", at_key=True))
    return named[0] if named else None


def read_fence(geofence: GeofenceFile, placement: Placement, document: Document, findings: list[Finding]) -> Fence:
    """Reads the fence in NED; errors are appended to the findings."""
    area = _area(geofence, placement, ("geofence",), document, findings, is_needed=geofence.ceiling_m is None)
    keep_out = [
        _area(one, placement, ("geofence", "keep_out", index), document, findings)
        for index, one in enumerate(geofence.keep_out)
    ]
    ceiling_m = None if geofence.ceiling_m is None else placement.height_from(geofence.ceiling_m)
    return Fence(area=area, keep_out=tuple(one for one in keep_out if one is not None), ceiling_m=ceiling_m)


def _area(
    written: AreaFile,
    placement: Placement,
    where: Where,
    document: Document,
    findings: list[Finding],
    *,
    is_needed: bool = True,
) -> Area | None:
    given = [name for name in AreaFile.__struct_fields__ if getattr(written, name) is not None]
    if len(given) > 1 or (is_needed and not given):
        wanted = "polygon or circle" if placement.is_geo else "polygon_m or circle_m"
        findings.append(
            document.finding(where, f"exactly one area is needed, {len(given)} are given", f"give {wanted}")
        )
        return None
    if given and placement.is_geo != (given[0] in ("polygon", "circle")):
        wanted = given[0].removesuffix("_m") if placement.is_geo else given[0] + "_m"
        kind = "frame geo" if placement.is_geo else "a local frame"
        findings.append(document.finding((*where, given[0]), f"{kind} uses {wanted}, not {given[0]}", at_key=True))
        return None
    if written.circle_m is not None:
        return _round(written.circle_m.center_m, written.circle_m.radius_m, placement)
    if written.circle is not None:
        return _round(written.circle.center, written.circle.radius_m, placement)
    corners = written.polygon_m or written.polygon
    if corners is None:
        return None
    polygon = tuple(placement.ned_from((*corner, 0.0))[:2] for corner in corners)
    problem = polygon_problem(polygon)
    if problem:
        findings.append(document.finding((*where, given[0]), problem))
        return None
    return Area(polygon_ne_m=polygon)


def _round(center: Point, radius_m: float, placement: Placement) -> Area:
    north, east, _ = placement.ned_from((*center, 0.0))
    return Area(center_ne_m=(north, east), radius_m=radius_m)
