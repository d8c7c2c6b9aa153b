"""File formats of plans: the two that are built in, and those that installed packages add by entry point."""

from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import msgspec

from gloc3.component.workers import guard
from gloc3.documents.document import load_bytes
from gloc3.errors import Finding, Gloc3Error, InputError
from gloc3.installed import installed_points
from gloc3.mission.formats.items import ForeignPlan
from gloc3.mission.formats.plan import read_plan, write_plan
from gloc3.mission.formats.plan_source import MAX_BYTES
from gloc3.mission.formats.wpl import read_wpl, write_wpl

FORMATS: Final = "gloc3.plan_formats"
"""Entry points that load a `PlanFormat`."""
NEEDS_PLUG_IN: Final = "the format of a plug-in cannot be sent with a mission: the vehicle may lack the plug-in"
CONVERT_FIRST: Final = "convert it to .plan first: gloc3 mission convert FILE FILE.plan"
MISSION_SUFFIXES: Final = (".yaml", ".yml")
_WITH_HEADING: Final = frozenset({16, 21, 22, 84, 85})
"""Commands with a heading in parameter 4."""

PlanReader = Callable[[bytes, str], ForeignPlan]
"""Reads the bytes of a file, of which the name goes into findings; raises `InputError` for what is wrong in it."""
PlanWriter = Callable[[ForeignPlan, str], tuple[str, list[Finding]]]
"""The text of a plan, of which the name goes into findings, and warnings of what the format cannot hold."""


class PlanFormat(msgspec.Struct, frozen=True, kw_only=True):
    """A format of plan files: a reader, and a writer where it has one."""

    title: str
    """Shown beside a file's name, as `GPX route`."""
    suffixes: tuple[str, ...]
    """Ends of its files' names, as `.gpx`; those of another format are not taken."""
    read: PlanReader
    write: PlanWriter | None = None


def _plan_text(plan: ForeignPlan, _file: str) -> tuple[str, list[Finding]]:
    return write_plan(plan), []


def _waypoint_text(plan: ForeignPlan, file: str) -> tuple[str, list[Finding]]:
    return write_wpl(plan), lost_in_waypoints(plan, file)


def lost_in_waypoints(plan: ForeignPlan, file: str) -> list[Finding]:
    """What of a plan a file of waypoints cannot carry."""
    lost = []
    if plan.items and (plan.fence or plan.rally):
        lost.append(("a waypoint file cannot hold the fence and rally points beside a mission", "convert it to .plan"))
    if any(item.command in _WITH_HEADING and item.params[3] is None for item in plan.items):
        lost.append(("a waypoint file cannot leave a heading open: 0 is written", "PX4 turns to north there"))
    return [Finding(file=file, message=message, hint=hint, is_warning=True) for message, hint in lost]


PLAN: Final = PlanFormat(title="QGroundControl plan", suffixes=(".plan",), read=read_plan, write=_plan_text)
WAYPOINTS: Final = PlanFormat(
    title="waypoints", suffixes=(".waypoints", ".txt", ".wpl", ".mission"), read=read_wpl, write=_waypoint_text
)


class PlanFormats(msgspec.Struct, frozen=True):
    """The formats that there are."""

    by_suffix: dict[str, PlanFormat]
    left_out: tuple[str, ...]
    """A line about each plug-in that cannot be used."""

    def hint(self, *also: str, is_written: bool = False) -> str:
        """The known suffixes, and what is the matter with plug-ins.

        Args:
            also: other suffixes that are possible.
            is_written: only those of formats that can be written.
        """
        known = (one for one, found in self.by_suffix.items() if found.write is not None or not is_written)
        return "; ".join((f"known: {', '.join((*also, *known))}", *self.left_out))


def plan_formats() -> PlanFormats:
    """The formats of this installation."""
    return _formats(tuple(installed_points(FORMATS)))


@cache
def _formats(points: tuple[Any, ...]) -> PlanFormats:
    found = {suffix: one for one in (PLAN, WAYPOINTS) for suffix in one.suffixes}
    left_out: list[str] = []
    for point in points:
        loaded, error = guard(point.load)
        for suffix, reason in _usable(loaded, error, found, point.value):
            if reason:
                left_out.append(f"plug-in {point.name} ({FORMATS}) is left out: {' '.join(reason.split())}")
            elif isinstance(loaded, PlanFormat):
                found[suffix] = loaded
    return PlanFormats(found, tuple(left_out))


def _usable(
    loaded: object, error: BaseException | None, found: dict[str, PlanFormat], value: str
) -> Iterator[tuple[str, str]]:
    """The suffixes of a plug-in, each with the reason why it is not taken; empty where it is."""
    if error is not None:
        yield "", f"{type(error).__name__}: {error}"
    elif not isinstance(loaded, PlanFormat):
        yield "", f"{value} is no PlanFormat"
    else:
        for suffix in loaded.suffixes:
            taken = found[suffix].title if suffix in found else "GLOC3 missions" if suffix in MISSION_SUFFIXES else ""
            yield suffix, f"the suffix {suffix} belongs to {taken}" if taken else ""


def is_added(suffix: str) -> bool:
    """Whether a suffix belongs to the format of a plug-in."""
    return plan_formats().by_suffix.get(suffix) not in (PLAN, WAYPOINTS, None)


def is_plan_file(path: Path) -> bool:
    """Whether a file of that name is a plan of another program."""
    return path.suffix in plan_formats().by_suffix


def load_plan(path: Path) -> ForeignPlan:
    """Reads a plan, or a file of waypoints, by its suffix.

    Raises:
        InputError: it cannot be read; with the reason.
    """
    formats, file = plan_formats(), str(path)
    data, found = load_bytes(path, MAX_BYTES), formats.by_suffix.get(path.suffix)
    if found is None:
        message = f"unknown kind of file {path.suffix!r}"
        raise InputError([Finding(file=file, message=message, hint=formats.hint())])
    if not is_added(path.suffix):
        return found.read(data, file)
    plan = _run(partial(found.read, data, file), found, file)
    if not isinstance(plan, ForeignPlan):
        raise _fault(found, file, f"it returned {type(plan).__name__}, not ForeignPlan")
    return plan


def plan_text(plan: ForeignPlan, suffix: str, file: str) -> tuple[str, list[Finding]]:
    """The text of a plan in the format of a suffix, and warnings of what the format cannot hold.

    Args:
        plan: the plan.
        suffix: of the file that is written.
        file: name of the plan in findings.

    Raises:
        InputError: the format is unknown or only read, or cannot express the plan.
    """
    formats = plan_formats()
    found = formats.by_suffix.get(suffix)
    if found is None or found.write is None:
        what = f"unknown kind of file {suffix!r}" if found is None else f"a {found.title} ({suffix}) is only read"
        raise InputError([Finding(file=file, message=what, hint=formats.hint(is_written=True))])
    if not is_added(suffix):
        return found.write(plan, file)
    written = _run(partial(found.write, plan, file), found, file)
    if not (isinstance(written, tuple) and len(written) == 2 and isinstance(written[0], str)):
        raise _fault(found, file, "it returned no text with warnings")
    return written[0], list(written[1])


def _run(job: Callable[[], Any], found: PlanFormat, file: str) -> Any:
    """The result of a plug-in.

    Raises:
        InputError: what it finds in the file, or its own failure.
    """
    result, error = guard(job)
    if isinstance(error, Gloc3Error):
        raise error
    if error is not None:
        raise _fault(found, file, f"{type(error).__name__}: {error}") from error
    return result


def _fault(found: PlanFormat, file: str, reason: str) -> InputError:
    message = f"the plug-in for a {found.title} has failed: {' '.join(reason.split())}"
    return InputError([Finding(file=file, message=message, hint="report it to the author of the plug-in")])
