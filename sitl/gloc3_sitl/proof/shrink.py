"""Shrinks a flight that breaks an invariant: fewest faults, calm weather, shortest mission, shortest and earliest faults."""

from collections.abc import Callable, Iterator, Sequence
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import msgspec

from gloc3_sitl.faults.fault_text import FaultText, parse
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.invariant import Invariant
from gloc3_sitl.proof.mission_cuts import shorter
from gloc3_sitl.proof.search import FlyAll
from gloc3_sitl.proof.trial import TrialResult

MOST_FLIGHTS: Final = 80
BATCH: Final = 8
"""So many candidates are flown at once; the first that still breaks it is taken."""


class Shrunk(msgspec.Struct, frozen=True, kw_only=True):
    """The smallest flight that was found."""

    case: FlightCase
    flights: int
    """How many were flown for it."""


class Shrinker:
    """Makes a case smaller as long as it still breaks its invariant.

    Args:
        kind: the invariant.
        fly: flies cases.
        most: flights, at most.
    """

    def __init__(self, kind: type[Invariant], fly: FlyAll, most: int = MOST_FLIGHTS) -> None:
        self._kind, self._fly, self._most = kind, fly, most
        self.flights = 0
        self._is_without_faults = False

    def shrink(self, case: FlightCase) -> Shrunk:
        """Returns the smallest case that was found."""
        self._is_without_faults = not case.faults
        before = None
        while before != case and self.flights < self._most:
            before = case
            for candidates in (_without_faults, _calmer, _of_shorter_missions, _shorter, _earlier):
                case = self._reduce(case, candidates)
        return Shrunk(case=case, flights=self.flights)

    def _reduce(self, case: FlightCase, candidates: "_Candidates") -> FlightCase:
        """Takes the first candidate that still breaks it, and looks for the next one from there."""
        while self.flights < self._most:
            found = self._first_broken(list(candidates(case)))
            if found is None:
                return case
            case = found
        return case

    def _first_broken(self, candidates: Sequence[FlightCase]) -> FlightCase | None:
        for first in range(0, len(candidates), BATCH):
            batch = candidates[first : first + BATCH][: self._most - self.flights]
            if not batch:
                return None
            self.flights += len(batch)
            for result in self._fly(batch, (self._kind,)):
                if self._is_broken(result) and self._is_by_its_faults(result.case):
                    return result.case
        return None

    def _is_broken(self, result: TrialResult) -> bool:
        return not result.refused and any(one.invariant == self._kind.name for one in result.broken)

    def _is_by_its_faults(self, case: FlightCase) -> bool:
        """Whether a shortened mission holds without the faults: one that ends in the air would break it by itself."""
        if not case.text or self._is_without_faults:
            return True
        if not case.faults:
            return False
        self.flights += 1
        calm = msgspec.structs.replace(case, faults=())
        return not any(self._is_broken(result) for result in self._fly([calm], (self._kind,)))


_Candidates = Callable[[FlightCase], Iterator[FlightCase]]


def _without_faults(case: FlightCase) -> Iterator[FlightCase]:
    for index in range(len(case.faults)):
        yield msgspec.structs.replace(case, faults=case.faults[:index] + case.faults[index + 1 :])


def _calmer(case: FlightCase) -> Iterator[FlightCase]:
    for name in ("wind_m_s", "waves_m", "current_m_s"):
        if getattr(case, name):
            yield msgspec.structs.replace(case, **{name: 0.0})
    if case.seed:
        yield msgspec.structs.replace(case, seed=0)


def _of_shorter_missions(case: FlightCase) -> Iterator[FlightCase]:
    with TemporaryDirectory() as folder:
        path = case.file(Path(folder))
        if path.suffix not in (".yaml", ".yml"):
            return
        text = path.read_text(encoding="utf-8")
    for cut in shorter(text):
        yield msgspec.structs.replace(case, text=cut)


def _shorter(case: FlightCase) -> Iterator[FlightCase]:
    for index, text in enumerate(case.faults):
        fault = parse(text)
        if fault.end_s is None:
            continue
        lasts_s = fault.end_s - fault.begin_s
        lengths = (
            [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0] if lasts_s == inf else [lasts_s / 8, lasts_s / 3, 0.7 * lasts_s]
        )
        for length_s in lengths:
            if 0.2 <= length_s < lasts_s:
                yield _with(case, index, fault._replace(end_s=round(fault.begin_s + length_s, 1)))


def _earlier(case: FlightCase) -> Iterator[FlightCase]:
    faults = [parse(text) for text in case.faults]
    first_s = min((fault.begin_s for fault in faults), default=0.0)
    for by_s in (first_s / 2.0, 20.0, 5.0, 1.0):
        if 1.0 <= by_s <= first_s - 1.0:
            earlier = [str(fault.shifted(fault.begin_s - by_s)) for fault in faults]
            yield msgspec.structs.replace(case, faults=tuple(earlier))
    for index, fault in enumerate(faults):
        rounded = fault.shifted(float(round(fault.begin_s)))
        if rounded != fault:
            yield _with(case, index, rounded)


def _with(case: FlightCase, index: int, fault: FaultText) -> FlightCase:
    return msgspec.structs.replace(case, faults=(*case.faults[:index], str(fault), *case.faults[index + 1 :]))
