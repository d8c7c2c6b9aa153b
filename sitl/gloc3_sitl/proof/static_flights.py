"""The cells of a static proof in flight: the component dies for good, and what was answered has to happen."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import msgspec

from gloc3.documents.document import load_bytes
from gloc3.errors import Gloc3Error
from gloc3.platform.reader import check_platform, find_platform, read_document
from gloc3_sitl.flight.mission_file import read_mission_file
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.search import FlyAll
from gloc3_sitl.proof.standard_invariants import all_invariants
from gloc3_sitl.proof.static_proof import StaticCell, StaticProof, prove_statically
from gloc3_sitl.proof.trial import TrialResult, fly_case

LATER_S: Final = 1.0
"""So long after an action has begun its component dies."""
AT_ONCE: Final = 16


class FlownCell(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A cell that was flown."""

    cell: StaticCell
    case: FlightCase
    state: str
    """Of the mission, at the end."""
    problem: str = ""
    """What was otherwise than answered; empty where nothing was."""


def prove_case(base: FlightCase) -> StaticProof:
    """Proves platform and mission of a case statically.

    Raises:
        Gloc3Error: one of them does not pass its check.
    """
    path = find_platform(base.platform)
    document = read_document(load_bytes(path), str(path))
    platform = check_platform(document, is_loading_classes=True)
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        mission = read_mission_file(base.file(folder), platform, folder, home=base.home).mission
    return prove_statically(platform, mission, document)


def distinct_cells(cells: Iterable[StaticCell], known: Iterable[tuple[str, ...]] = ()) -> list[StaticCell]:
    """The first cell of each kind, without the kinds that are known."""
    found: dict[tuple[str, ...], StaticCell] = {}
    for cell in cells:
        found.setdefault(cell.signature, cell)
    for signature in known:
        found.pop(signature, None)
    return list(found.values())


def fly_cells(
    cells: Sequence[StaticCell], base: FlightCase, fly: FlyAll, report: Callable[[str], None]
) -> Iterator[FlownCell]:
    """Flies cells, one flight each. What the flight without a fault breaks is not judged in them.

    Raises:
        Gloc3Error: the mission does not start without a fault, or an action of a cell does not begin in it.
    """
    course = fly_case(base, is_stopping=False)
    if not course.started_s:
        raise Gloc3Error(f"the mission does not start without any fault: {course.reason or course.refused}")
    begins = {target: t_s for t_s, target in course.phases}
    if missing := sorted({cell.phase for cell in cells} - set(begins)):
        raise Gloc3Error(f"without any fault {', '.join(missing)} does not begin; the mission is {course.state}")
    at_rest = {one.invariant for one in course.broken}
    kinds = tuple(kind for kind in all_invariants() if kind.name not in at_rest)
    for first in range(0, len(cells), AT_ONCE):
        part = cells[first : first + AT_ONCE]
        cases = [_case(base, cell, begins[cell.phase]) for cell in part]
        for cell, result in zip(part, fly(cases, kinds), strict=True):
            yield FlownCell(cell=cell, case=result.case, state=result.state, problem=_problem(cell, result))
        report(f"{min(first + AT_ONCE, len(cells))} of {len(cells)} cells flown")


def _case(base: FlightCase, cell: StaticCell, begin_s: float) -> FlightCase:
    fault = f"crash:{cell.component}@{begin_s + LATER_S:.1f}.."
    return msgspec.structs.replace(base, faults=(fault,))


def _problem(cell: StaticCell, result: TrialResult) -> str:
    """What was otherwise than the cell says."""
    if result.refused:
        return f"cannot be flown: {result.refused}"
    if result.broken:
        return str(result.broken[0]).strip()
    if cell.policy or result.is_done:
        return ""
    return f"the mission was to go on, and is {result.state or 'not started'}" + (
        f": {result.reason}" if result.reason else ""
    )
