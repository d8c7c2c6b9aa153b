"""The search: draws cases, flies them on all cores, keeps those that reach something new, and remembers it all in a folder.

It goes by rounds: every case of a round is drawn from what the rounds before have found, so that the same seed gives the
same flights, in whichever order they are flown and on however many cores.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from hashlib import sha256
from multiprocessing import get_context, parent_process
from pathlib import Path
from random import Random
from threading import Thread
from typing import Final

import msgspec

from gloc3.clock import Clock
from gloc3.errors import UNREADABLE, Gloc3Error, Refused
from gloc3.messages.software import own_software
from gloc3.platform.reader import load_platform, whole_text
from gloc3_sitl.faults.fault_menu import PossibleFault, possible_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.draw import Alone, Course, Draw
from gloc3_sitl.proof.invariant import BrokenInvariant, Invariant
from gloc3_sitl.proof.reached import worth
from gloc3_sitl.proof.trial import TrialResult, fly_case, fly_to_judge
from gloc3_sitl.vehicles.table import vehicle_named, vehicle_of

ROUND: Final = 16
"""Flights of a round; the same on every machine."""
FRESH: Final = 0.35
"""The share of cases that are drawn without looking at what was found."""
STATE: Final = "search.jsonl"
MOST_ENERGY: Final = 24
MOST_CHANGES: Final = 20
Invariants = tuple[type[Invariant], ...]
FlyAll = Callable[[Sequence[FlightCase], Invariants], Iterator[TrialResult]]
"""Flies cases and judges them by invariants; the results come in the order of the cases."""


class SearchedFlight(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A flight of the search, as it is remembered."""

    case: FlightCase
    broken: tuple[BrokenInvariant, ...] = ()
    new: tuple[str, ...] = ()
    """What no flight before had reached."""
    state: str = ""
    refused: str = ""
    ended_s: float = 0.0
    changes_s: tuple[float, ...] = ()
    """When the mission's state, its policy or the autopilot's mode has changed; empty where nothing was new."""


class SearchHead(msgspec.Struct, frozen=True, kw_only=True):
    """The first line of what a search remembers: which one it is."""

    case: FlightCase
    sources: str
    """Digest of mission, platform, world and version: with others the same case is another flight."""
    invariants: tuple[str, ...]
    """By which the flights are judged."""


class _Seed(msgspec.Struct):
    """A case that reached something new, and how often it is still worth a try."""

    case: FlightCase
    energy: float
    changes_s: tuple[float, ...]


class Search:
    """A search for one mission on one platform.

    Args:
        base: what is flown, without faults.
        fly: flies cases and gives their results in the same order.
        out: the folder in which it is remembered; None for nowhere.
        kinds: the invariants.
    """

    def __init__(self, base: FlightCase, fly: FlyAll, kinds: Invariants, out: Path | None = None) -> None:
        self.base: Final = base
        self.flights: Final[list[SearchedFlight]] = []
        self.reached: Final[set[str]] = set()
        self.course = Course(0.0, 0.0, ())
        self.broken_at_rest: tuple[BrokenInvariant, ...] = ()
        """What the flight without a fault breaks: it is not judged in the others, where it would hide everything else."""
        self.kinds = kinds
        """The invariants that are judged."""
        self.processor_s = 0.0
        """What the flights of this run have cost, in seconds of one processor."""
        self._fly, self._out = fly, out
        self._corpus: list[_Seed] = []
        self._kept: list[SearchedFlight] = []
        self._menu: list[PossibleFault] = []
        self._alone: list[Alone] = []
        self._draw: Draw

    # --- begin ---

    def begin(self) -> TrialResult:
        """Flies without a fault, and reads what an interrupted search has left.

        Raises:
            Gloc3Error: the mission cannot be flown at all, or the folder holds another search.
        """
        menu: list[PossibleFault] = []

        def prepare(flight: Flight) -> None:
            menu.extend(possible_faults(flight))

        flown = fly_case(self.base, kinds=self.kinds, is_stopping=False, prepare=prepare)
        if flown.refused:
            raise Gloc3Error(f"the mission cannot be flown: {flown.refused}")
        if not flown.started_s:
            raise Gloc3Error(f"the mission does not start without any fault: {flown.reason}")
        self.broken_at_rest = flown.broken
        names = {one.invariant for one in flown.broken}
        self.kinds = tuple(kind for kind in self.kinds if kind.name not in names)
        self.course = Course(flown.started_s, flown.ended_s, flown.phases, flown.changes_s)
        self._menu = menu
        swims = vehicle_named(_vehicle(self.base)).swims
        self._draw = Draw(self.base, menu, self.course, swims=swims)
        self._alone = self._draw.alone()
        Random(self.base.seed).shuffle(self._alone)
        self.reached.update(flown.reached)
        self._kept = self._read()
        return flown

    def _read(self) -> list[SearchedFlight]:
        path = self._path
        if path is None:
            return []
        names = tuple(kind.name for kind in self.kinds)
        head = msgspec.json.encode(SearchHead(case=self.base, sources=sources(self.base), invariants=names))
        data = path.read_bytes() if path.exists() else b""
        lines = data.splitlines() or [head]
        if lines.pop(0) != head:
            raise Refused(
                f"{path} belongs to another search, or mission, platform, world, invariants or version have changed since; "
                "choose another folder or remove it"
            )
        kept = []
        for line in lines:
            try:
                kept.append(msgspec.json.decode(line, type=SearchedFlight))
            except UNREADABLE:
                break  # the last line of a run that was killed
        kept = kept[: len(kept) // ROUND * ROUND]
        whole = b"\n".join([head, *lines[: len(kept)], b""])
        if whole != data:  # what follows is appended to whole rounds
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(whole)
        return kept

    @property
    def _path(self) -> Path | None:
        return None if self._out is None else self._out / STATE

    # --- rounds ---

    def round(self) -> list[SearchedFlight]:
        """Flies one round, or takes it from what is remembered; returns its flights."""
        first = len(self.flights)
        cases = [self._next(index, Random(f"{self.base.seed}/{index}")) for index in range(first, first + ROUND)]
        kept = self._kept[first : first + ROUND]
        if len(kept) == ROUND and [one.case for one in kept] == cases:
            made = kept
            for one in made:
                self._learn(one.case, one.new, one.changes_s)
        else:
            made = [self._judge(result) for result in self._fly(cases, self.kinds)]
            self._remember(made)
        self.flights.extend(made)
        return made

    def _judge(self, result: TrialResult) -> SearchedFlight:
        self.processor_s += result.processor_s
        new = tuple(word for word in result.reached if word not in self.reached)
        changes_s = result.changes_s[:MOST_CHANGES] if new else ()
        self._learn(result.case, new, changes_s)
        return SearchedFlight(
            case=result.case,
            broken=result.broken,
            new=new,
            state=result.state,
            refused=result.refused,
            ended_s=result.ended_s,
            changes_s=changes_s,
        )

    def _learn(self, case: FlightCase, new: Sequence[str], changes_s: tuple[float, ...]) -> None:
        self.reached.update(new)
        if new:
            self._corpus.append(_Seed(case, min(MOST_ENERGY, 1.0 + sum(map(worth, new))), changes_s))

    def _remember(self, made: Sequence[SearchedFlight]) -> None:
        if self._path is not None:
            with self._path.open("ab") as file:
                file.writelines(msgspec.json.encode(one) + b"\n" for one in made)

    def _next(self, index: int, random: Random) -> FlightCase:
        """The case of a flight: at first every other one has a single short trouble, once in each phase and at each change."""
        if index % 2 == 0 and index // 2 < len(self._alone):
            return self._draw.single(self._alone[index // 2], random)
        if not self._corpus or random.random() < FRESH:
            return self._draw.fresh(random)
        weights = [seed.energy for seed in self._corpus]
        seed = random.choices(self._corpus, weights)[0]
        seed.energy = max(0.2, 0.9 * seed.energy)
        other = random.choice(self._corpus)
        return self._draw.mutated(seed.case, other.case, seed.changes_s, random)

    @property
    def found(self) -> list[SearchedFlight]:
        """The flights that broke an invariant."""
        return [one for one in self.flights if one.broken]


def sources(base: FlightCase) -> str:
    """Digest of what a case only names: the texts of its mission, platform and world, and the version."""
    from gloc3.mission.formats import mission_text

    mission = base.text or mission_text(base.mission, load_platform(base.platform))[1]
    world = Path(base.world)
    world_text = world.read_text(encoding="utf-8") if world.is_file() else ""
    parts = (mission, whole_text(base.platform), world_text, own_software().version)
    return sha256("\0".join(parts).encode()).hexdigest()


def _vehicle(base: FlightCase) -> str:
    return vehicle_of(load_platform(base.platform))


# --- many flights at once ---


def _fly_one(case: FlightCase, kinds: Invariants) -> TrialResult:
    """In a process of its own: a flight."""
    began_s = Clock.processor_s()
    result = fly_to_judge(case, kinds)
    return msgspec.structs.replace(result, processor_s=round(Clock.processor_s() - began_s, 3))


def _end_with_parent() -> None:
    """Ends this worker when the process that began it ends, killed or not: otherwise it would wait for work for ever."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    Thread(target=watch, name="parent", daemon=True).start()


@contextmanager
def flying(jobs: int) -> Iterator[FlyAll]:
    """Gives a function that flies cases in as many processes."""
    if jobs <= 1:
        yield lambda cases, kinds: iter([_fly_one(case, kinds) for case in cases])
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_end_with_parent) as pool:
        yield lambda cases, kinds: pool.map(_fly_one, cases, [kinds] * len(cases))
