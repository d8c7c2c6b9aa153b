"""Checks a mission against a platform before it is sent, and again onboard; reports all findings at once."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import msgspec
from msgspec import structs

from gloc3.amounts import beside, excess
from gloc3.errors import Finding, InputError, nearest
from gloc3.messages.frames import GeoPoint, LocalFrame, TangentPlane, Vector3
from gloc3.mission.checking.agreement import agreement_findings, silence_findings
from gloc3.mission.checking.approach_check import approach_findings
from gloc3.mission.checking.budget_check import budget_findings, time_findings
from gloc3.mission.checking.contingency_check import contingency_findings, path_findings
from gloc3.mission.checking.estimate import MissionEstimate, MissionFigures, estimate, together
from gloc3.mission.checking.option_check import (
    acceptance_findings,
    area_findings,
    guard_findings,
    plan_findings,
    unkept_findings,
)
from gloc3.mission.checking.place_check import place_findings
from gloc3.mission.checking.separation_check import VehiclePath, separation_findings
from gloc3.mission.checking.space_check import (
    PlacedLeg,
    altitude_findings,
    flight_findings,
    placed_legs,
    space_findings,
)
from gloc3.mission.checking.terrain_check import GroundProfile, ground_profile, terrain_findings
from gloc3.mission.checking.turn_check import turn_findings
from gloc3.mission.model.abilities import WAIT, abilities
from gloc3.mission.model.arguments import FollowWaypointsOrder, argument_kinds
from gloc3.mission.model.fence import Fence
from gloc3.mission.model.legs import Budget
from gloc3.mission.model.model import FLY_FILE, Mission, part_of, where_of
from gloc3.mission.model.structure import PartialOrder, structure_findings
from gloc3.mission.reading.mission_site import MissionSite
from gloc3.mission.reading.reader import MissionReferences, Reading, inspect_mission
from gloc3.platform.bases import platform_files
from gloc3.platform.limits import Limits
from gloc3.platform.platform import Capability, Platform
from gloc3.platform.reader import named_platform
from gloc3.terrain import Terrain

HOME_CLEARANCE_M: Final = 0.5
"""A home outside the fence, or nearer to it than this, is refused."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Circumstances:
    """Circumstances against which a mission is checked."""

    platform: Platform | None = None
    """None: every capability is taken to be there, and nothing is known of limits, energy and failsafes."""
    part: str | None = None
    """In a mission for several platforms: the platform whose part is checked, where that platform itself is unknown."""
    known: Callable[[str], Platform | None] | None = None
    """Finds a platform that such a mission names (None where it is not known here), and has all parts of it checked.
    None checks that of `platform` alone."""
    frames: Mapping[str, LocalFrame] | None = None
    """Frames of the world, beside those of the platform."""
    origin: GeoPoint | None = None
    """Origin of NED, where it is known."""
    home_altitude_m: float | None = None
    """Altitude above the sea of home, where it is known."""
    home_ned_m: Vector3 | None = None
    """Where the vehicle was armed, else its position on the ground; None where it is unknown."""
    start_ned_m: Vector3 | None = None
    """Position of the vehicle; None for at home, on the ground."""
    heading_rad: float | None = None
    """Heading of the vehicle on the ground, in which what lands on wings takes off and lands; None where unknown."""
    assigned: Mapping[str, Sequence[str]] | None = None
    """Platform to its tasks in their order, in place of the file's `assigned`."""
    ended: frozenset[str] = frozenset()
    """Tasks that have begun or ended already: what is left of the mission is checked."""
    is_assigned_later: bool = False
    """Tasks for which no platform is chosen yet are no error; such a mission is judged only as far as it is written."""
    fence: Fence | None = None
    """That of the loaded mission, where a single action beside it is checked: the places that it names are inside."""

    terrain: Terrain | None = None
    """Heights of the ground; None: paths are not checked against them."""
    clearance_m: float | None = None
    """Least height above that ground; None for the platform's."""

    def surroundings(self) -> MissionReferences:
        """What the reader needs of the circumstances."""
        found = MissionReferences.of(
            self.platform,
            frames=self.frames,
            origin=self.origin,
            home_altitude_m=self.home_altitude_m,
            home=self.home_geo(),
            terrain=self.terrain,
        )
        return replace(found, platform=found.platform or self.part, assigned=self.assigned, ended=self.ended)

    @property
    def least_clearance_m(self) -> float | None:
        """Least height above the ground that is stated; None without."""
        if self.clearance_m is not None or self.platform is None:
            return self.clearance_m
        return self.platform.limits.ground_clearance_m

    def home_geo(self) -> GeoPoint | None:
        """Home on Earth; None where it is not known."""
        if self.origin is None or self.home_ned_m is None:
            return None
        return TangentPlane(self.origin).geo_from_ned(self.home_ned_m)

    def capabilities(self) -> Mapping[str, Capability]:
        """The rows by name; without a platform one for each kind of arguments."""
        if self.platform is not None:
            return abilities(self.platform)
        return (
            dict(WAIT)
            | {FLY_FILE: Capability(arguments=FLY_FILE, performed_by="", claims=("motion",))}
            | {
                name: Capability(arguments=name, performed_by="", claims=kind.claims())
                for name, kind in argument_kinds().items()
            }
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class CheckReport:
    """The outcome of a check."""

    file: str
    findings: tuple[Finding, ...]
    """In order of place."""
    mission: Mission | None = None
    estimate: MissionEstimate | None = None
    order: PartialOrder | None = field(default=None, repr=False)
    profile: GroundProfile | None = field(default=None, repr=False)
    """Heights of the path and of the ground; None without terrain tiles."""
    unknown: tuple[str, ...] = ()
    """Platforms that tasks name and nobody knows here: what those tasks need was not checked."""

    @property
    def is_ok(self) -> bool:
        """Whether the mission may fly: there is nothing but warnings."""
        return self.mission is not None and all(finding.is_warning for finding in self.findings)

    def flyable(self) -> Mission:
        """The mission.

        Raises:
            InputError: it may not fly.
        """
        if self.mission is None or not self.is_ok:
            raise InputError(self.findings)
        return self.mission

    def as_dict(self) -> dict[str, Any]:
        """The report as plain values, for JSON."""
        figures: dict[str, Any] | None = None
        if self.estimate is not None:
            figures = _rounded(self.estimate)
            if self.estimate.least is not None:
                figures["least"] = _rounded(self.estimate.least)
        return {
            "file": self.file,
            "is_ok": self.is_ok,
            "findings": [msgspec.to_builtins(finding) for finding in self.findings],
            "estimate": figures,
        }


def _rounded(figures: MissionFigures) -> dict[str, Any]:
    return {
        "duration_s": round(figures.duration_s, 1),
        "energy_wh": round(figures.energy_wh, 2),
        "length_m": round(figures.length_m, 1),
    }


def check_text(data: bytes | str, file: str, circumstances: Circumstances) -> CheckReport:
    """Checks a mission's content; never raises for errors in it."""
    try:
        reading = inspect_mission(data, file, circumstances.surroundings())
    except InputError as error:
        return CheckReport(file=file, findings=error.findings)
    structural = [*structure_findings(reading.tasks), *structure_findings(reading.contingencies)]
    findings = [*reading.findings, *structural]
    mission = reading.mission
    if mission is None or structural:
        return CheckReport(file=file, findings=tuple(sorted(findings)), mission=None)
    is_whole = circumstances.known is not None or circumstances.platform is None
    doubts = dict(_unknown_platforms(mission, circumstances)) if circumstances.part is None else {}
    findings += doubts
    unknown = tuple(dict.fromkeys(doubts.values()))
    if mission.unassigned:
        findings += [] if circumstances.is_assigned_later else _unassigned(mission)
        return CheckReport(file=file, findings=tuple(sorted(findings)), mission=mission, order=PartialOrder.of(mission))
    if mission.platforms and circumstances.part is None and is_whole:
        return replace(_check_parts(data, file, circumstances, mission, findings), unknown=unknown)
    order = PartialOrder.of(mission)
    platform = circumstances.platform
    budget = Budget.of(platform.limits if platform else Limits(), circumstances.home_ned_m or (0.0, 0.0, 0.0))
    start_ned_m = circumstances.start_ned_m or budget.home_ned_m
    figures = estimate(mission, order, start_ned_m, budget, platform.power if platform else None)
    findings += _nothing_for(platform, mission, reading)
    findings += _written_for_another(platform, mission, reading)
    findings += _capabilities(mission, circumstances)
    findings += _resources(mission, order, circumstances.capabilities())
    findings += flight_findings(mission, order, is_airborne=circumstances.start_ned_m is not None)
    path = _path(mission, figures, circumstances)
    findings += _space(mission, figures, path, circumstances)
    findings += _outside(mission, path, circumstances)
    profile = None if platform is not None and platform.limits.stays_down else ground_profile(path, reading.site)
    findings += terrain_findings(mission, profile, reading.site, circumstances.least_clearance_m)
    findings += turn_findings(mission, figures, path, platform)
    limits = platform.limits if platform is not None else None
    findings += approach_findings(mission, path, limits, circumstances.home_ned_m, circumstances.heading_rad)
    findings += budget_findings(mission, figures, platform)
    findings += guard_findings(mission, platform)
    findings += plan_findings(mission, platform)
    findings += altitude_findings(mission, platform)
    findings += unkept_findings(mission, platform)
    findings += area_findings(mission, circumstances.fence)
    findings += acceptance_findings(mission, platform)
    findings += contingency_findings(mission)
    for name, ready in mission.contingencies.items():
        if ready.actions:
            findings += _check_contingency(part_of(mission, name), circumstances, budget, reading.site)
            findings += path_findings(mission, name, path, budget, platform)
    findings += silence_findings(mission, figures, platform)
    if platform is not None:
        findings += agreement_findings(mission, platform)
    findings += place_findings(mission, circumstances.home_geo())
    if circumstances.home_ned_m is not None:
        problem = home_problem(mission, circumstances.home_ned_m)
        if problem:
            findings.append(
                reading.document.finding(("geofence",), problem, "move the vehicle or the fence", at_key=True)
            )
    return CheckReport(
        file=file,
        findings=tuple(sorted(set(findings))),
        mission=mission,
        estimate=figures,
        order=order,
        profile=profile,
        unknown=unknown,
    )


def _unknown_platforms(mission: Mission, circumstances: Circumstances) -> Iterator[tuple[Finding, str]]:
    """Tasks for platforms of which there is no file here: their part is judged by nothing, and a name may be misspelt."""
    document, find, own = mission.document, circumstances.known, circumstances.platform
    if document is None:
        return
    known = sorted({*platform_files(), *([own.platform] if own is not None else [])})
    for name, task in mission.tasks.items():
        wanted = task.options.performer
        is_written = document.value["tasks"][name].get("platform") == wanted  # not chosen by an assignment
        if not is_written or wanted in known or (find is not None and find(wanted) is not None):
            continue
        message = f"the platform {wanted!r} is not known here: what {name} needs is not checked"
        yield document.finding((*where_of(name), "platform"), message, nearest(wanted, known), is_warning=True), wanted


def _unassigned(mission: Mission) -> Iterator[Finding]:
    """Tasks that several platforms may perform, and for which none is chosen."""
    for name in mission.unassigned if mission.document is not None else ():
        hint = "the key v of the station's mission screen assigns it; gloc3 mission check FILE --platform A --platform B shows how"
        message = f"no platform is chosen for {name}"
        yield mission.document.finding((*where_of(name), "platform"), message, hint)  # type: ignore[union-attr]


def _check_parts(
    data: bytes | str, file: str, circumstances: Circumstances, mission: Mission, found: Iterable[Finding]
) -> CheckReport:
    """Checks a mission for several platforms, each part for its own; findings about a part name its platform."""
    findings = set(found)
    figures: list[MissionEstimate] = []
    paths: list[VehiclePath] = []
    platforms = {name: circumstances.known(name) if circumstances.known else None for name in mission.platforms}
    around = replace(circumstances, origin=circumstances.origin or _common_origin(mission, platforms.values()))
    for name, known in platforms.items():
        part = check_text(data, file, replace(around, platform=known, part=name))
        findings.update(part.findings)
        figures += [part.estimate] if part.estimate is not None else []
        if known is not None and part.mission is not None and part.estimate is not None:
            home = circumstances.home_ned_m
            paths.append(VehiclePath(name, part.mission, part.estimate, known.limits, home))
    findings.update(separation_findings(paths, mission))
    return CheckReport(
        file=file,
        findings=tuple(sorted(findings)),
        mission=mission,
        estimate=together(figures),
        order=PartialOrder.of(mission),
    )


def _common_origin(mission: Mission, platforms: Iterable[Platform | None]) -> GeoPoint | None:
    """One origin for platforms whose frames of the mission's name have different ones; None where they agree."""
    frames = [one.local_frames().get(mission.frame) for one in platforms if one is not None]
    origins = [frame.origin for frame in frames if frame is not None]
    return origins[0] if len(set(origins)) > 1 else None


def _path(mission: Mission, figures: MissionEstimate, circumstances: Circumstances) -> list[PlacedLeg]:
    return list(placed_legs(mission, figures, circumstances.home_ned_m, circumstances.start_ned_m))


def _space(
    mission: Mission, figures: MissionEstimate, path: list[PlacedLeg], circumstances: Circumstances
) -> list[Finding]:
    """Findings about the path; as warnings also those about the path if guards skip all that they can."""
    limits = circumstances.platform.limits if circumstances.platform is not None else None
    found = space_findings(mission, path, limits, circumstances.home_ned_m)
    if figures.least is None:
        return found
    shorter = space_findings(mission, _path(mission, figures.least, circumstances), limits, circumstances.home_ned_m)
    left_out = "if guards skip all that they can"
    return found + [
        structs.replace(one, message=f"{one.message}, {left_out}", is_warning=True)
        for one in set(shorter).difference(found)
    ]


def _outside(mission: Mission, path: list[PlacedLeg], circumstances: Circumstances) -> Iterator[Finding]:
    """Places of a single action outside the fence of the loaded mission; the way home is always open."""
    if circumstances.fence is not None and mission.fence is None:
        limits = circumstances.platform.limits if circumstances.platform is not None else None
        named = [placed for placed in path if isinstance(placed.action.order, FollowWaypointsOrder)]
        yield from space_findings(replace(mission, fence=circumstances.fence), named, limits, circumstances.home_ned_m)


def _check_contingency(
    part: Mission, circumstances: Circumstances, budget: Budget, site: MissionSite | None
) -> Iterator[Finding]:
    """Checks a contingency separately: it may begin at any position, in the air."""
    platform, order = circumstances.platform, PartialOrder.of(part)
    figures = estimate(part, order, budget.home_ned_m, budget, platform.power if platform else None)
    limits = platform.limits if platform else None
    yield from _capabilities(part, circumstances)
    yield from _resources(part, order, circumstances.capabilities())
    yield from (one for one in flight_findings(part, order, is_airborne=True) if not one.is_warning)
    path = list(placed_legs(part, figures))
    yield from space_findings(part, path, limits, None)
    yield from terrain_findings(part, ground_profile(path, site), site, circumstances.least_clearance_m)
    yield from turn_findings(part, figures, path, platform)
    yield from time_findings(part, figures)
    yield from guard_findings(part, platform)
    yield from plan_findings(part, platform)
    yield from altitude_findings(part, platform)
    yield from unkept_findings(part, platform)
    yield from area_findings(part, None)


def home_problem(mission: Mission, home_ned_m: Vector3) -> str:
    """Why a mission may not start from this home; empty if it may."""
    if mission.fence is None:
        return ""
    clearance_m = mission.fence.clearance_m(home_ned_m)
    if clearance_m < 0.0:
        return f"home is {excess(-clearance_m)} m outside the fence"
    if clearance_m < HOME_CLEARANCE_M:
        inside = beside(clearance_m, HOME_CLEARANCE_M, 2)
        return f"home is {inside} m inside the fence; at least {HOME_CLEARANCE_M} m are needed"
    return ""


def _written_for_another(platform: Platform | None, mission: Mission, reading: Reading) -> Iterator[Finding]:
    """A mission whose header names a platform is checked for that one."""
    wanted = named_platform(mission.platform) if platform is not None else ""
    if platform is not None and wanted and wanted != platform.platform:
        message = f"it is written for {wanted}, and checked for {platform.platform}"
        hint = f"change the line to platform: {platform.platform} if that is what you mean"
        yield reading.document.finding(("platform",), message, hint, is_warning=True)


def _nothing_for(platform: Platform | None, mission: Mission, reading: Reading) -> Iterator[Finding]:
    """A mission for several platforms has something to do for this one."""
    if platform is not None and mission.platforms and platform.platform not in mission.platforms:
        message = f"no task names {platform.platform}"
        hint = f"it is for {', '.join(mission.platforms)}"
        yield reading.document.finding(("tasks",), message, hint, at_key=True)


def _capabilities(mission: Mission, circumstances: Circumstances) -> Iterator[Finding]:
    """What the actions need is there, and the values of their arguments are possible here."""
    platform, document = circumstances.platform, mission.document
    if platform is None or document is None:
        return
    is_complete = platform.is_complete
    names = sorted({*platform.topics(), *platform.capabilities, *(row.name for row in platform.components)})
    components, rows = [row.name for row in platform.components], circumstances.capabilities()
    for target, action in mission.actions().items():
        row = rows[action.ability]
        where = (*where_of(target), action.capability)
        if row.performed_by and row.performed_by not in components:
            hint = nearest(row.performed_by, components)
            message = f"{action.ability} is performed by {row.performed_by!r}, which the platform does not have"
            yield document.finding(where, message, hint, at_key=True)
        for need in row.needs:
            if need not in names:
                message = f"{action.ability} needs {need!r}, which nothing on {platform.platform} provides"
                hint = nearest(need, names) if is_complete else "not all components' classes are installed here"
                yield document.finding(where, message, hint, at_key=True, is_warning=not is_complete)
        for argument, possible in row.options.items():
            value = getattr(action.arguments, argument, None)
            if value is not None and str(value) not in possible:
                hint = nearest(str(value), possible)
                message = f"{argument} {value!r} is not possible on {platform.platform}"
                yield document.finding((*where, argument), message, hint)
        if action.order.begins_flight and not platform.arm:
            message = f"{platform.platform} is not armed by GLOC3 (arm: false)"
            yield document.finding(where, message, "a pilot has to arm it", at_key=True, is_warning=True)


def _resources(mission: Mission, order: PartialOrder, rows: Mapping[str, Capability]) -> Iterator[Finding]:
    """Two actions that may run at the same time never claim the same resource."""
    actions = mission.actions()
    claims = {target: rows[action.ability].claims for target, action in actions.items()}
    targets = [target for target in order.targets if claims.get(target)]
    for index, one in enumerate(targets):
        for other in targets[:index]:
            shared = [name for name in claims[one] if name in claims[other]]
            if shared and order.may_overlap(one, other) and mission.document is not None:
                yield mission.document.finding(
                    where_of(one),
                    f"{one} and {other} may run at the same time, and both claim {', '.join(shared)}",
                    "order them with after",
                    at_key=True,
                )
