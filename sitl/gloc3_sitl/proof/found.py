"""What a broken invariant leaves: a command, a replay file, a log, a picture and five lines of cause."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3_sitl.flight.outputs import recreate
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.invariant import BrokenInvariant, Invariant
from gloc3_sitl.proof.trial import TrialResult, fly_case, fly_to_judge

REPLAY: Final = "replay.json"
CAUSE: Final = "cause.txt"
MISSION: Final = "mission.yaml"
_SHOWN: Final = 3


class FoundCase(msgspec.Struct, frozen=True, kw_only=True):
    """A broken invariant with the smallest flight that breaks it."""

    broken: BrokenInvariant
    case: FlightCase
    command: str
    folder: str = ""
    cause: tuple[str, ...] = ()
    flights: int = 0
    """How many were flown to shrink it."""


def signature(invariant: str, case: FlightCase) -> tuple[str, tuple[str, ...]]:
    """What two findings of the same kind share: the invariant, and what went wrong, without values and times."""
    kinds = {text.partition("@")[0].partition("=")[0] for text in case.faults}
    return invariant, tuple(sorted(kinds))


def write_found(case: FlightCase, kind: type[Invariant], folder: Path | None, flights: int = 0) -> FoundCase | None:
    """Flies a case once more, and writes what it leaves into a folder.

    Returns:
        What was found; None where it does not break the invariant any more.
    """
    if folder is not None:
        recreate(folder)
        (folder / REPLAY).write_text(case.contained().line() + "\n", encoding="utf-8")
        if case.text:
            (folder / MISSION).write_text(case.text, encoding="utf-8")
    result = fly_to_judge(case, (kind,), folder)
    if not result.broken:
        return None
    mission = str(folder / MISSION) if folder is not None and case.text else ""
    cause = five_lines(result, kind)
    if folder is not None:
        (folder / CAUSE).write_text("\n".join(cause) + "\n", encoding="utf-8")
    return FoundCase(
        broken=result.broken[0],
        case=case,
        command=case.command(mission),
        folder="" if folder is None else str(folder),
        cause=tuple(cause),
        flights=flights,
    )


def five_lines(result: TrialResult, kind: type[Invariant]) -> list[str]:
    """The cause in five lines: what must hold, what was so instead, and what led there."""
    broken = result.broken[0]
    before = [line for line in result.story if _time(line) <= broken.t_s]
    faults = [line for line in before if " fault " in line]
    others = [line for line in before if (line not in faults and " mission: " in line) or " autopilot: " in line]
    begun = [line for line in faults if line.endswith(" begins")][: _SHOWN - 1]
    chosen = sorted(dict.fromkeys([*begun, *others[len(begun) - _SHOWN :]]), key=_time)
    lines = [f"must hold: {kind.sentence}", f"was so:    {broken.t_s:.2f} s  {broken.text}"]
    return [*lines, *(f"before:    {line.strip()}" for line in chosen)]


def _time(line: str) -> float:
    return float(line.split(" s ", 1)[0])


def replay(path: Path, out: Path | None) -> TrialResult:
    """Flies a replay file.

    Raises:
        Refused: it holds no case, or the case does not fit any more.
    """
    from gloc3_sitl.proof.case import read_case

    if out is not None:
        recreate(out)
    result = fly_case(read_case(path), out=out, is_stopping=False)
    if result.refused:
        raise Refused(f"{path}: {result.refused}")
    return result


def distinct(found: Sequence[tuple[str, FlightCase]], most: int) -> list[tuple[str, FlightCase]]:
    """One of each kind, those with the fewest faults first."""
    seen: set[tuple[str, tuple[str, ...]]] = set()
    chosen = []
    for invariant, case in sorted(found, key=lambda one: len(one[1].faults)):
        key = signature(invariant, case)
        if key not in seen:
            seen.add(key)
            chosen.append((invariant, case))
    return chosen[:most]
