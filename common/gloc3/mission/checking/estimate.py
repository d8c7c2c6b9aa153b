"""Estimates when each action of a mission runs, the vehicle's path, and the energy needed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import dist
from typing import Final

from gloc3.messages.frames import Vector3
from gloc3.mission.model.arguments import LandOrder, ReturnHome
from gloc3.mission.model.legs import Budget, FlightLeg
from gloc3.mission.model.model import ItemFile, Mission, Task
from gloc3.mission.model.structure import PartialOrder
from gloc3.platform.limits import Power


@dataclass(frozen=True, kw_only=True, slots=True)
class ActionEstimate:
    """The estimate of one action."""

    start_s: float
    """From the start of the mission."""
    end_s: float
    legs: tuple[FlightLeg, ...] = ()
    energy_wh: float = 0.0
    is_endless: bool = False
    """Whether nothing is known to end it."""
    once_s: float = 0.0
    """How long it takes each time; its task may be repeated."""
    more_m: float = 0.0
    """Way that is not among the legs, since it is that of the last ones once more."""

    @property
    def length_m(self) -> float:
        """Length of its path."""
        return self.more_m + sum(leg.length_m for leg in self.legs)


@dataclass(frozen=True, kw_only=True, slots=True)
class MissionFigures:
    """Time, path and energy of a mission."""

    duration_s: float
    energy_wh: float
    """0 without a power model."""
    length_m: float
    battery_share: float = 0.0
    """Of the full battery; 0 without a power model."""


@dataclass(frozen=True, kw_only=True, slots=True)
class MissionEstimate(MissionFigures):
    """Figures of a whole mission, where every guard admits its item, and every loop runs to its limit."""

    actions: Mapping[str, ActionEstimate]
    """By `TASK.ACTION`, in an order in which they can run."""
    end_ned_m: Vector3
    """Where the vehicle is at the end."""
    return_wh: float
    """Energy to return home and land from the place where that takes most."""
    return_from: tuple[str, FlightLeg] | None = None
    """The action and the leg that lead to that place; None where it is the start."""
    least: "MissionEstimate | None" = None
    """Where every guard that may have something skipped does so, and every loop that may end early does so after its
    first time; None where there is none. What guards wait for is not in any figure."""

    def task_span(self, task: Task) -> tuple[float, float]:
        """When a task starts and ends, in seconds from the start of the mission."""
        parts = [part for target, part in self.actions.items() if target.startswith(task.name + ".")]
        return min((p.start_s for p in parts), default=0.0), max((p.end_s for p in parts), default=0.0)


def estimate(
    mission: Mission, order: PartialOrder, start_ned_m: Vector3, budget: Budget, power: Power | None
) -> MissionEstimate:
    """Estimates the figures of a mission.

    Args:
        mission: the mission.
        order: its partial order.
        start_ned_m: start position.
        budget: home, speeds and similar values.
        power: the platform's power model; None for no energies.
    """
    most = _Planner(mission, start_ned_m, budget, power).run(order)
    if not any(may_vary(task) for task in mission.tasks.values()):
        return most
    return replace(most, least=_Planner(mission, start_ned_m, budget, power, is_least=True).run(order))


def may_vary(task: Task, *, is_begun: bool = False) -> bool:
    """Whether a guard may skip part of a task, or its loop may end early; `is_begun`: its own guard holds."""
    repeat = task.options.repeat
    options = [action.options for action in task.actions.values()] + ([] if is_begun else [task.options])
    return any(map(_may_be_skipped, options)) or (repeat is not None and repeat.until is not None and repeat.times > 1)


def _may_be_skipped(options: ItemFile) -> bool:
    return options.when is not None and options.otherwise == "skip"


class _Planner:
    """Lets the actions run one after the other, or beside each other, as their order allows."""

    def __init__(
        self, mission: Mission, start_ned_m: Vector3, budget: Budget, power: Power | None, *, is_least: bool = False
    ) -> None:
        self._mission, self._budget, self._power, self._is_least = mission, budget, power, is_least
        self.actions: Final = mission.actions()
        self.found: Final[dict[str, ActionEstimate]] = {}
        self.here = self.start_ned_m = start_ned_m
        self.has_moved = False
        self.hover_wh = 0.0
        """For the time in which nothing moves it."""
        self._moved_until_s = 0.0

    def run(self, order: PartialOrder) -> MissionEstimate:
        """Estimates all actions in order, and their total."""
        power, found = self._power, self.found
        for target in order.targets:
            if target in self.actions:
                self._add(target)
        return_wh, return_from = self._hardest_return()
        _end_companions(self._mission, found)
        _add_devices(self._mission, found)
        energy_wh = self.hover_wh + sum(part.energy_wh for part in found.values())
        return MissionEstimate(
            actions=found,
            duration_s=max((part.end_s for part in found.values()), default=0.0),
            energy_wh=energy_wh,
            length_m=sum(part.length_m for part in found.values()),
            end_ned_m=self.here,
            battery_share=energy_wh / power.battery_wh if power is not None else 0.0,
            return_wh=return_wh,
            return_from=return_from,
        )

    def _hardest_return(self) -> tuple[float, tuple[str, FlightLeg] | None]:
        """The energy of the return that takes most, and what leads to its beginning."""
        if self._power is None:
            return 0.0, None
        most_wh, begin = return_energy_wh(self.start_ned_m, self._budget, self._power), None
        for target, part in self.found.items():
            for leg in part.legs:
                needed_wh = return_energy_wh(leg.end, self._budget, self._power)
                if needed_wh > most_wh:
                    most_wh, begin = needed_wh, (target, leg)
        return most_wh, begin

    def _add(self, target: str) -> None:
        """One action; the last of a task that is repeated brings the further times."""
        self._once(target, max((self.found[one].end_s for one in self._earlier(target)), default=0.0))
        task = self._mission.tasks[target.partition(".")[0]]
        own = [f"{task.name}.{name}" for name in task.actions]
        repeat = task.options.repeat
        times = 1 if repeat is None or (self._is_least and repeat.until is not None) else repeat.times
        if times > 1 and all(one in self.found for one in own):
            self._repeat([one for one in self.found if one in own], times)

    def _earlier(self, target: str) -> Iterator[str]:
        return (one for one in _before(target, self._mission) if one in self.found)

    def _once(self, target: str, start_s: float) -> None:
        action, budget, power = self.actions[target], self._budget, self._power
        task = self._mission.tasks[target.partition(".")[0]]
        if self._is_least and (_may_be_skipped(task.options) or _may_be_skipped(action.options)):
            self.found[target] = ActionEstimate(start_s=start_s, end_s=start_s)
            return
        legs: tuple[FlightLeg, ...] = ()
        needed_s = action.order.time_needed_s(self.here, budget)
        end_s = start_s + needed_s
        if action.order.moves:
            start_s = max(start_s, self._moved_until_s) if action.options.until is None else start_s
            legs = action.order.legs(self.here, budget)
            flown_s = sum(leg.duration_s for leg in legs)
            end_s = start_s + max(flown_s, needed_s)
            if self.has_moved and power is not None:
                idle_s = max(0.0, start_s - self._moved_until_s)
                self.hover_wh += (power.hover_w + power.avionics_w) * idle_s / 3600.0
            if power is not None:
                self.hover_wh += (power.hover_w + power.avionics_w) * (end_s - start_s - flown_s) / 3600.0
            self.here = legs[-1].end if legs else self.here
            self.has_moved = self.has_moved or bool(legs)
            self._moved_until_s = max(self._moved_until_s, end_s)
        energy_wh = sum(leg.energy_wh(power) for leg in legs) if power is not None else 0.0
        is_endless = action.order.is_endless and action.options.until is None and action.options.deadline_s is None
        self.found[target] = ActionEstimate(
            start_s=start_s, end_s=end_s, legs=legs, energy_wh=energy_wh, is_endless=is_endless, once_s=end_s - start_s
        )

    def _repeat(self, targets: Sequence[str], times: int) -> None:
        """The further times of a task: the second as it is, from where the first has ended; the rest are like it."""
        first = {target: self.found[target] for target in targets}
        task = self._mission.tasks[targets[0].partition(".")[0]]
        end_s = max(part.end_s for part in first.values())
        for target in targets:
            del self.found[target]
        for target in targets:
            after = [f"{task.name}.{name}" for name in self.actions[target].options.after]
            self._once(target, max((self.found[one].end_s for one in after if one in self.found), default=end_s))
        more_s = (times - 2) * (max(self.found[target].end_s for target in targets) - end_s)
        for target in targets:
            one, other = first[target], self.found[target]
            self.found[target] = replace(
                other,
                start_s=one.start_s,
                end_s=other.end_s + more_s,
                legs=one.legs + other.legs,
                energy_wh=one.energy_wh + (times - 1) * other.energy_wh,
                more_m=(times - 2) * other.length_m,
            )
        self._moved_until_s += more_s


def together(parts: Sequence[MissionEstimate]) -> MissionEstimate | None:
    """The figures of a mission for several platforms, from those of each one's part; None where there is none.

    What one platform waits for another is not in them.
    """
    if not parts:
        return None
    most = _together(parts)
    if all(part.least is None for part in parts):
        return most
    return replace(most, least=_together([part.least or part for part in parts]))


def _together(parts: Sequence[MissionEstimate]) -> MissionEstimate:
    hardest = max(parts, key=lambda part: part.return_wh)
    return MissionEstimate(
        actions={target: figures for part in parts for target, figures in part.actions.items()},
        duration_s=max(part.duration_s for part in parts),
        energy_wh=sum(part.energy_wh for part in parts),
        length_m=sum(part.length_m for part in parts),
        end_ned_m=parts[0].end_ned_m,
        return_wh=hardest.return_wh,
        return_from=hardest.return_from,
    )


def about(figures: MissionEstimate, usable_wh: float = 0.0) -> str:
    """Text for a mission's figures: `about 35 s, 36 m, 1.8 Wh`, or `about 20 to 35 s, …` where parts may be skipped.

    Args:
        figures: the estimate.
        usable_wh: the available energy; 0 to omit it.
    """
    least = figures.least or figures
    reported = [f"{span(least.duration_s, figures.duration_s)} s", f"{span(least.length_m, figures.length_m)} m"]
    if figures.energy_wh:
        reported.append(
            span(least.energy_wh, figures.energy_wh, 1) + (f" of {usable_wh:.1f}" if usable_wh else "") + " Wh"
        )
    return "about " + ", ".join(reported)


def span(least: float, most: float, digits: int = 0) -> str:
    """A range in words: `20 to 35`, or one figure where both ends are rounded to the same."""
    ends = f"{least:.{digits}f}", f"{most:.{digits}f}"
    return ends[1] if ends[0] == ends[1] else " to ".join(ends)


def return_energy_wh(place_ned_m: Vector3, budget: Budget, power: Power) -> float:
    """Energy to fly home from a place and land there."""
    if dist(place_ned_m, budget.home_ned_m) < 1e-6:
        return 0.0
    legs = ReturnHome().legs(place_ned_m, budget)
    above = legs[-1].end if legs else place_ned_m
    return sum(leg.energy_wh(power) for leg in (*legs, *LandOrder().legs(above, budget)))


def _before(target: str, mission: Mission) -> Iterator[str]:
    """Actions that must end before an action starts."""
    task_name, _, name = target.partition(".")
    task = mission.tasks[task_name]
    for other in task.options.after:
        yield from (f"{other}.{one}" for one in mission.tasks[other].actions)
    for other in task.actions[name].options.after:
        yield f"{task_name}.{other}"


def _end_companions(mission: Mission, found: dict[str, ActionEstimate]) -> None:
    """Gives actions with `until` the end of their companion, where that is earlier or they have none."""
    for target, part in found.items():
        task_name, _, name = target.partition(".")
        action = mission.tasks[task_name].actions[name]
        companion = found.get(f"{task_name}.{action.options.until}")
        if action.options.until is None or companion is None:
            continue
        end_s = max(part.start_s, companion.end_s)
        if not action.order.is_endless and part.end_s > part.start_s:
            end_s = min(end_s, part.end_s)
        is_repeated = mission.tasks[task_name].options.repeat is not None
        once_s = companion.once_s if is_repeated else end_s - part.start_s
        found[target] = replace(part, end_s=end_s, once_s=once_s, is_endless=False)


def _add_devices(mission: Mission, found: dict[str, ActionEstimate]) -> None:
    """Adds the consumption of the actions' own devices."""
    actions = mission.actions()
    for target, part in found.items():
        drawn_wh = actions[target].arguments.power_w * (part.end_s - part.start_s) / 3600.0
        found[target] = replace(part, energy_wh=part.energy_wh + drawn_wh)
