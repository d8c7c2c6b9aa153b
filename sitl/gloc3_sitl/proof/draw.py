"""Draws cases at random: faults at times of the flight's phases, and mutations of cases that reached something new."""

from collections.abc import Sequence
from math import exp, inf, log
from random import Random
from typing import Final, NamedTuple

import msgspec

from gloc3_sitl.faults.fault_menu import PossibleFault
from gloc3_sitl.faults.fault_text import FaultText, parse
from gloc3_sitl.proof.case import FlightCase

MOST: Final = 3
"""Troubles of one flight."""
SHORTEST_S: Final = 0.3
LONGEST_S: Final = 90.0
SEEDS: Final = 20
ROUGH: Final = 0.7
"""The share of cases that get weather of their own; others have that of the case of which they are a variation, or none."""
BRIEFLY: Final = {"hang": (0.3, 0.5), "link_loss": (1.0, 4.0), "cable_loss": (0.1, 0.35)}
"""How long a trouble lasts that comes alone and that the stack gets over, in seconds."""
AROUND_S: Final = (-0.3, 0.1)
"""Where a trouble that comes alone begins, beside a change of the mission's state or the autopilot's mode, s: it stops what
commands the change, or what is to see it."""
ALONE: Final = ("disk_full", "clock_jump", "link_twice", "cable_twice")
"""Troubles that it gets over however long they last."""
WEATHER: Final = (("wind_m_s", (1.0, 6.0)), ("waves_m", (0.1, 0.4)), ("current_m_s", (0.05, 0.3)))
"""Bounds of what reaches a vehicle that swims; the first reaches every vehicle."""


class Course(NamedTuple):
    """A fault-free flight: what times mean in it."""

    started_s: float
    ended_s: float
    phases: Sequence[tuple[float, str]]
    changes_s: Sequence[float] = ()
    """When the mission's state or the autopilot's mode has changed."""


class Alone(NamedTuple):
    """A trouble that comes alone in a phase of the flight, or at a change."""

    possible: PossibleFault
    begin_s: float
    end_s: float


class Draw:
    """Draws cases of one mission.

    Args:
        base: the case without faults.
        menu: what can go wrong.
        course: of the fault-free flight.
        swims: whether waves and currents reach the vehicle.
    """

    def __init__(self, base: FlightCase, menu: Sequence[PossibleFault], course: Course, *, swims: bool) -> None:
        self._base, self._course, self._swims = base, course, swims
        self._changes_s: Sequence[float] = ()
        self._groups: dict[str, list[PossibleFault]] = {}
        for one in menu:
            self._groups.setdefault(one.group, []).append(one)

    def fresh(self, random: Random) -> FlightCase:
        """A case of one to three troubles."""
        self._changes_s = ()
        faults: list[FaultText] = []
        for _ in range(random.choice((1, 1, 2, 2, 3))):
            self._add(faults, random)
        return self._case(faults, random)

    def mutated(self, case: FlightCase, other: FlightCase, changes_s: Sequence[float], random: Random) -> FlightCase:
        """A case like another one, with one or two things changed.

        Args:
            case: the one that is changed.
            other: one that gives a fault.
            changes_s: when something changed in the flight of `case`: what is added begins there more often than elsewhere,
                so that a policy that is flown meets trouble of its own.
            random: draws.
        """
        self._changes_s = changes_s
        faults = [parse(text) for text in case.faults]
        for _ in range(random.choice((1, 1, 2))):
            self._mutate(faults, other, random)
        if not faults:
            self._add(faults, random)
        return self._with_weather(msgspec.structs.replace(case, faults=_texts(faults)), random)

    def _mutate(self, faults: list[FaultText], other: FlightCase, random: Random) -> None:
        at = random.randrange(len(faults)) if faults else 0
        choice = random.random()
        if not faults or (choice < 0.25 and len(faults) < MOST + 2):
            self._add(faults, random)
        elif choice < 0.35 and other.faults:
            _put(faults, parse(random.choice(other.faults)))
        elif choice < 0.5 and len(faults) > 1:
            faults.pop(at)
        elif choice < 0.75:
            faults[at] = faults[at].shifted(faults[at].begin_s + random.gauss(0.0, 3.0))
        elif choice < 0.85:
            faults[at] = faults[at].shifted(self._time(random))
        elif faults[at].end_s is not None:
            faults[at] = faults[at]._replace(end_s=round(faults[at].begin_s + _length(random, LONGEST_S), 1))
        else:
            faults.pop(at)
            self._add(faults, random)

    # --- alone ---

    def alone(self) -> list["Alone"]:
        """The troubles that the stack gets over when they come alone and are short, in a fixed order.

        Each comes once in each phase, and at each change.
        """
        found = [one for group in sorted(self._groups) for one in self._groups[group]]
        found = [one for one in found if _kind(one) in (*BRIEFLY, *ALONE) or (one.is_event and _kind(one) == "crash")]
        begins = [begin_s for begin_s, _ in self._course.phases] or [self._course.started_s]
        times = list(zip(begins, [*begins[1:], self._course.ended_s], strict=True))
        before_s, after_s = AROUND_S
        changes = sorted({change_s for change_s in self._course.changes_s if change_s >= self._course.started_s})
        times += [(change_s + before_s, change_s + after_s) for change_s in changes]
        return [Alone(one, *time) for one in found for time in times]

    def single(self, alone: "Alone", random: Random) -> FlightCase:
        """A case in calm weather with this trouble alone."""
        possible, end_s = alone.possible, None
        begin_s = round(random.uniform(alone.begin_s, max(alone.begin_s, alone.end_s)), 2)
        if not possible.is_event:
            shortest_s, longest_s = BRIEFLY.get(_kind(possible), (1.0, 30.0))
            end_s = round(begin_s + random.uniform(shortest_s, longest_s), 2)
        value = "" if possible.values is None else _value(possible.values, random)
        fault = FaultText(possible.text.replace("{}", value), begin_s, end_s)
        return msgspec.structs.replace(self._base, faults=(str(fault),), seed=self._base.seed + random.randrange(SEEDS))

    # --- one trouble ---

    def _add(self, faults: list[FaultText], random: Random) -> None:
        """Adds a trouble: a fault, or what a person does and takes back."""
        group = random.choice(sorted(self._groups))
        possible = random.choice(self._groups[group])
        value = "" if possible.values is None else _value(possible.values, random)
        what, begin_s = possible.text.replace("{}", value), self._time(random)
        end_s = None if possible.is_event else self._end(begin_s, possible, random)
        _put(faults, FaultText(what, begin_s, end_s))
        later_s = round(begin_s + _length(random, 30.0), 1)
        if group == "pilot" and random.random() < 0.8:
            _put(faults, FaultText("pilot:off", later_s))
            _put(faults, FaultText("operator:resume", round(later_s + 1.0, 1)))
        elif what.startswith("operator:pause") and random.random() < 0.8:
            _put(faults, FaultText(what.replace("pause", "resume"), later_s))

    def _time(self, random: Random) -> float:
        course = self._course
        if self._changes_s and random.random() < 0.5:
            begin_s = random.choice(self._changes_s) + random.uniform(-0.5, 4.0)
        elif course.phases and random.random() < 0.6:
            begin_s = random.choice(course.phases)[0] + random.uniform(-1.0, 6.0)
        else:
            begin_s = random.uniform(course.started_s - 1.0, course.ended_s)
        return round(max(0.1, begin_s), 1)

    @staticmethod
    def _end(begin_s: float, possible: PossibleFault, random: Random) -> float:
        if possible.longest_s == inf and random.random() < 0.25:
            return inf
        return round(begin_s + _length(random, min(possible.longest_s, LONGEST_S)), 1)

    # --- the rest of a case ---

    def _case(self, faults: list[FaultText], random: Random) -> FlightCase:
        case = msgspec.structs.replace(self._base, faults=_texts(faults))
        case = msgspec.structs.replace(case, seed=self._base.seed + random.randrange(SEEDS))
        return self._with_weather(case, random)

    def _with_weather(self, case: FlightCase, random: Random) -> FlightCase:
        if random.random() > ROUGH:
            return case
        weather = WEATHER if self._swims else WEATHER[:1]
        drawn = random.sample(weather, random.randint(1, len(weather)))
        return msgspec.structs.replace(case, **{name: round(random.uniform(*bounds), 2) for name, bounds in drawn})


def _kind(possible: PossibleFault) -> str:
    """What a trouble is: with a value, such as the share of a link that is lost, it is another one."""
    what = possible.text.partition(":")[0]
    return what.removesuffix("={}") if what.startswith(ALONE) else what


def _put(faults: list[FaultText], fault: FaultText) -> None:
    """Adds a fault, if none of the same target is present at its time: the end of one would end the other."""
    if fault.end_s is None or all(
        one.target != fault.target or one.end_s is None or one.end_s <= fault.begin_s or one.begin_s >= fault.end_s
        for one in faults
    ):
        faults.append(fault)


def _texts(faults: Sequence[FaultText]) -> tuple[str, ...]:
    return tuple(str(fault) for fault in sorted(faults, key=lambda fault: (fault.begin_s, fault.what)))


def _length(random: Random, longest_s: float) -> float:
    """A duration: short ones are as likely as long ones."""
    return exp(random.uniform(log(SHORTEST_S), log(longest_s)))


def _value(bounds: tuple[float, float], random: Random) -> str:
    return f"{random.uniform(*bounds):.3g}"
