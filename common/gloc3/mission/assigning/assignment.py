"""Assigns the tasks of a mission that several platforms may perform, and checks each platform's part."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from graphlib import CycleError, TopologicalSorter
from typing import Any, Final

from msgspec import structs

from gloc3.documents.document import parse
from gloc3.documents.document_edit import replaced, with_key
from gloc3.errors import Finding, Gloc3Error, Refused
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.mission.assigning.search import ShareCost, Shares, divide
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.checking.estimate import MissionEstimate, about, estimate
from gloc3.mission.checking.separation_check import VehiclePath, separation_findings
from gloc3.mission.model.legs import Budget
from gloc3.mission.model.model import EACH, Mission, where_of
from gloc3.mission.model.structure import PartialOrder
from gloc3.mission.reading.reader import inspect_mission
from gloc3.platform.platform import Platform


@dataclass(frozen=True, kw_only=True, slots=True)
class AvailableVehicle:
    """A vehicle to which tasks may be assigned."""

    platform: Platform
    home: GeoPoint | None = None
    """Where it stands, or was armed; None where that is not known: then the mission's origin."""
    place: GeoPoint | None = None
    """Where it is in the air; None on the ground."""
    battery: float = 1.0
    """Charge now, 0 to 1."""
    begun: tuple[str, ...] = ()
    """Tasks of the mission that it has begun or ended, in their order: they stay its own."""
    running: tuple[str, ...] = ()
    """Those of them that it has not ended."""
    kept: tuple[str, ...] = ()
    """Further tasks that stay its own, whatever others could do."""

    @property
    def name(self) -> str:
        """Of the platform."""
        return self.platform.platform


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskShare:
    """What one vehicle has to do."""

    platform: str
    tasks: tuple[str, ...]
    """In their order, those that it has begun included."""
    estimate: MissionEstimate | None = None
    """Of what is left to do; None where that is nothing."""
    usable_wh: float = 0.0
    """Energy that it may use; 0 without a power model."""

    def __str__(self) -> str:
        tasks = ", ".join(self.tasks) or "nothing"
        return f"{self.platform}: {tasks}" + (
            f" ({about(self.estimate, self.usable_wh)})" if self.estimate is not None else ""
        )

    def as_dict(self) -> dict[str, Any]:
        """The share as plain values, for JSON."""
        found: dict[str, Any] = {"tasks": list(self.tasks)}
        if self.estimate is not None:
            found["duration_s"] = round(self.estimate.duration_s, 1)
            found["energy_wh"] = round(self.estimate.energy_wh, 2)
            found["usable_wh"] = round(self.usable_wh, 2)
        return found


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskAssignment:
    """Who does what in a mission, and the check of that."""

    text: str
    """The mission with its assignment, as it is sent to all."""
    shares: tuple[TaskShare, ...]
    """In the order of the vehicles."""
    reports: Mapping[str, CheckReport] = field(repr=False)
    """Platform to the check of its part; of each that has one."""
    report: CheckReport = field(repr=False)
    """Of the whole mission; holds all findings."""

    @property
    def is_ok(self) -> bool:
        """Whether every part may fly."""
        return self.report.is_ok

    @property
    def assigned(self) -> dict[str, tuple[str, ...]]:
        """Platform to its tasks in their order."""
        return {share.platform: share.tasks for share in self.shares if share.tasks}


def assign(
    text: str,
    file: str,
    vehicles: Sequence[AvailableVehicle],
    circumstances: Circumstances,
    ended: Mapping[str, tuple[str, ...]] | None = None,
) -> TaskAssignment:
    """Assigns the tasks of a mission and checks every vehicle's part.

    A vehicle can perform a task if its part with this task alone passes the checker. Among those that can, the tasks are
    divided by the checker's own estimate of time and energy, from where each vehicle is; what vehicles wait for each
    other is not in it. Tasks that name one platform keep it. The same arguments give the same assignment.

    Args:
        text: the mission; an `assigned` in it is replaced.
        file: its name, for the findings.
        vehicles: those that may take part, of different names.
        circumstances: frames, origin and terrain for all; its `platform` is ignored.
        ended: tasks that others have done before they dropped out, by their platforms.
    """
    return _Assigner(text, file, vehicles, circumstances, ended or {}).run()


class _Assigner:
    def __init__(
        self,
        text: str,
        file: str,
        vehicles: Sequence[AvailableVehicle],
        circumstances: Circumstances,
        ended: Mapping[str, tuple[str, ...]],
    ) -> None:
        origin = circumstances.origin or next(
            (one.home or one.place for one in vehicles if one.home or one.place), None
        )
        with suppress(Refused):  # the file has no assignment
            text = replaced(text, ("assigned",), "{}")
        self._text, self._file, self._ended = text, file, ended
        self._vehicles: Final = {one.name: one for one in vehicles}
        known = {one.name: one.platform for one in vehicles}
        frames = {name: frame for one in vehicles for name, frame in one.platform.local_frames().items()}
        frames |= circumstances.frames or {}
        self._around = replace(
            circumstances, platform=None, part=None, known=known.get, origin=origin, frames=frames or None
        )
        self._missions: Final[dict[str, Mission]] = {}
        self._cost = lru_cache(maxsize=None)(self._share_cost)
        begun = {task for one in vehicles for task in one.begun}
        self._over: Final = begun.union(*ended.values())
        self._after: dict[str, tuple[str, ...]] = {}

    def run(self) -> TaskAssignment:
        whole = check_text(self._text, self._file, replace(self._around, is_assigned_later=True))
        if whole.mission is None or not self._vehicles:
            return TaskAssignment(text=self._text, shares=(), reports={}, report=whole)
        tasks = {
            name: task.options
            for name, task in whole.mission.tasks.items()
            if task.options.platform not in (None, EACH)
        }
        self._after = {name: options.after for name, options in tasks.items()}
        for name, vehicle in self._vehicles.items():
            references = self._circumstances(vehicle, {}).surroundings()
            found = inspect_mission(self._text, self._file, replace(references, assigned=None, ended=frozenset()))
            if found.mission is not None:
                self._missions[name] = found.mission
        owners = {task: one.name for one in self._vehicles.values() for task in one.kept}
        candidates: dict[str, list[str]] = {}
        findings = list(whole.findings)
        for name, options in tasks.items():
            if name in self._over or (options.performer and options.performer not in self._vehicles):
                continue
            reasons = {
                one: self._reason_against(vehicle, name)
                for one, vehicle in self._vehicles.items()
                if options.is_for(one) and owners.get(name, one) == one
            }
            candidates[name] = [one for one, reason in reasons.items() if not reason]
            if not candidates[name] and whole.mission.document is not None:
                why = (
                    "; ".join(f"{one}: {reason}" for one, reason in reasons.items())
                    or "no given platform is in its list"
                )
                message = f"no vehicle can perform {name} ({why})"
                findings.append(whole.mission.document.finding((*where_of(name), "platform"), message))
        order = {name: candidates[name] for name in _in_order(candidates, self._after)}
        shares = divide(order, tuple(self._vehicles), self._cost, self._is_possible)
        return self._result(shares, findings)

    def _circumstances(self, vehicle: AvailableVehicle, assigned: Mapping[str, Sequence[str]]) -> Circumstances:
        """Those of one vehicle's part, without what it has begun."""
        origin = self._around.origin
        plane = TangentPlane(origin) if origin is not None else None
        home, place = vehicle.home, vehicle.place
        return replace(
            self._around,
            platform=vehicle.platform,
            part=vehicle.name,
            known=None,
            assigned=assigned,
            ended=frozenset(vehicle.begun),
            home_ned_m=plane.ned_from_geo(*home) if plane is not None and home is not None else None,
            start_ned_m=plane.ned_from_geo(*place) if plane is not None and place is not None else None,
        )

    def _reason_against(self, vehicle: AvailableVehicle, task: str) -> str:
        """Why a vehicle cannot perform a task; empty if it can."""
        if vehicle.name not in self._missions:
            return "the mission cannot be read for it"
        later = self._later(vehicle)
        if blocked := next((name for name in vehicle.begun if name in later), ""):
            return f"it has begun {blocked} already, which comes after the tasks"
        report = check_text(self._text, self._file, self._circumstances(vehicle, {vehicle.name: (task,)}))
        return next((one.message for one in report.findings if not one.is_warning), "")

    def _later(self, vehicle: AvailableVehicle) -> set[str]:
        """Tasks of each platform that come after tasks to be assigned."""
        tasks = self._missions[vehicle.name].tasks
        return {
            name
            for name, one in tasks.items()
            if one.options.platform == EACH and set(one.options.after) & {*self._after}
        }

    def _part(self, vehicle: AvailableVehicle, tasks: tuple[str, ...]) -> Mission | None:
        """A vehicle's part: the tasks that it has not ended, these in their order; None where it has nothing to do."""
        mission = self._missions[vehicle.name]
        listed = (*vehicle.running, *tasks)
        if not listed and not vehicle.begun:
            return None
        own = [
            name
            for name, task in mission.tasks.items()
            if name in listed or (task.options.platform == EACH and name not in vehicle.begun)
        ]
        before = dict(zip(listed[1:], listed, strict=False))
        found = {}
        for name in own:
            options = mission.tasks[name].options
            after = [one for one in options.after if one in own]
            after += [before[name]] if name in before and before[name] not in after else []
            found[name] = replace(mission.tasks[name], options=structs.replace(options, after=tuple(after)))
        return replace(mission, tasks=found)

    def _figures(self, vehicle: AvailableVehicle, tasks: tuple[str, ...]) -> MissionEstimate | None:
        part = self._part(vehicle, tasks)
        if part is None:
            return None
        around = self._circumstances(vehicle, {})
        budget = Budget.of(vehicle.platform.limits, around.home_ned_m or (0.0, 0.0, 0.0))
        start_ned_m = around.start_ned_m or budget.home_ned_m
        return estimate(part, PartialOrder.of(part), start_ned_m, budget, vehicle.platform.power)

    def _paths(self, chosen: Shares) -> Iterator[VehiclePath]:
        """Where the vehicles go from now, in one NED."""
        for name, vehicle in self._vehicles.items():
            tasks = chosen.get(name, ())
            part = self._part(vehicle, tasks) if name in self._missions else None
            figures = self._figures(vehicle, tasks) if part is not None else None
            if part is not None and figures is not None:
                home = self._circumstances(vehicle, {}).home_ned_m
                yield VehiclePath(name, part, figures, vehicle.platform.limits, home)

    def _share_cost(self, name: str, tasks: tuple[str, ...]) -> ShareCost:
        vehicle = self._vehicles[name]
        figures = self._figures(vehicle, tasks) if name in self._missions else None
        if figures is None:
            return ShareCost(0.0, 0.0)
        has_power = vehicle.platform.power is not None
        excess_wh = max(0.0, figures.energy_wh - _usable_wh(vehicle)) if has_power else 0.0
        return ShareCost(excess_wh, figures.duration_s)

    def _is_possible(self, shares: Shares) -> bool:
        """Whether the tasks, each after the one before it, do not wait for each other for ever."""
        graph = {name: set(after) for name, after in self._after.items()}
        for tasks in shares.values():
            for before, name in itertools.pairwise(tasks):
                graph[name].add(before)
        try:
            TopologicalSorter(graph).prepare()
        except CycleError:
            return False
        return True

    def _result(self, chosen: Shares, findings: list[Finding]) -> TaskAssignment:
        shares = []
        for name, vehicle in self._vehicles.items():
            tasks = chosen.get(name, ())
            figures = self._figures(vehicle, tasks) if name in self._missions else None
            own = tuple(task for task in vehicle.begun if task in self._after)
            share = TaskShare(platform=name, tasks=(*own, *tasks), estimate=figures, usable_wh=_usable_wh(vehicle))
            shares.append(share)
        assigned = {share.platform: share.tasks for share in shares if share.tasks}
        assigned |= {name: tasks for name, tasks in self._ended.items() if tasks}
        text = with_assigned(self._text, assigned)
        reports = {}
        for share in shares:
            vehicle = self._vehicles[share.platform]
            if set(share.tasks) - set(vehicle.begun):
                around = replace(self._circumstances(vehicle, {}), assigned=None)
                reports[share.platform] = check_text(text, self._file, around)
            findings += _budget_finding(vehicle, share)
        whole = check_text(text, self._file, self._around)
        if whole.mission is not None:
            findings += separation_findings(list(self._paths(chosen)), whole.mission)
        for name in whole.mission.platforms if whole.mission is not None else ():
            if name not in self._vehicles and name not in self._ended:
                reports[name] = check_text(text, self._file, replace(self._around, known=None, part=name))
        found = {*findings, *(one for report in reports.values() for one in report.findings)}
        return TaskAssignment(
            text=text, shares=tuple(shares), reports=reports, report=replace(whole, findings=tuple(sorted(found)))
        )


def with_assigned(text: str, assigned: Mapping[str, Sequence[str]]) -> str:
    """The text of a mission with another assignment; nothing else in it changes, and no line moves."""
    written = "{" + ", ".join(f"{name}: [{', '.join(tasks)}]" for name, tasks in assigned.items()) + "}"
    try:
        return replaced(text, ("assigned",), written)
    except Refused:
        return with_key(text, (), "assigned", written)


def written_assignment(text: str) -> tuple[dict[str, tuple[str, ...]], tuple[str, ...]]:
    """The assignment in a mission's text, platform to its tasks, and the tasks whose platform is open without it."""
    try:
        document = parse(text, "mission")
        written = document.value.get("assigned") if isinstance(document.value, dict) else None
        without = replaced(text, ("assigned",), "{}") if written else text
    except Gloc3Error:
        return {}, ()
    mission = check_text(without, "mission", Circumstances(is_assigned_later=True)).mission
    names = written if isinstance(written, dict) else {}
    assigned = {str(name): tuple(map(str, tasks)) for name, tasks in names.items() if isinstance(tasks, list)}
    return assigned, mission.unassigned if mission is not None else ()


def _in_order(candidates: Mapping[str, Sequence[str]], after: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """The tasks, each behind those that it comes after."""
    sorter = TopologicalSorter({name: [one for one in after[name] if one in candidates] for name in candidates})
    yield from sorter.static_order()


def _usable_wh(vehicle: AvailableVehicle) -> float:
    power = vehicle.platform.power
    return 0.0 if power is None else max(0.0, power.battery_wh * (vehicle.battery - power.reserve))


def _budget_finding(vehicle: AvailableVehicle, share: TaskShare) -> Iterator[Finding]:
    """More energy than is left in the battery now; of a full one the checker judges."""
    figures = share.estimate
    if figures is None or vehicle.platform.power is None or vehicle.battery >= 1.0:
        return
    if figures.energy_wh > share.usable_wh:
        message = (
            f"{share.platform} needs about {figures.energy_wh:.1f} Wh, and may use {share.usable_wh:.1f} Wh "
            f"({100.0 * vehicle.battery:.0f} % charge)"
        )
        yield Finding(file=share.platform, message=message, hint="charge it, or let more vehicles take part")
