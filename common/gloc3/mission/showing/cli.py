"""`gloc3 mission`: check, show and convert mission files."""

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final

from cyclopts import App, Parameter

from gloc3.cli.counting import counted
from gloc3.documents.characters import printable
from gloc3.errors import Finding, InputError, NotFound, Refused
from gloc3.installed import installed_points
from gloc3.mission.assigning.assignment import AvailableVehicle, TaskAssignment, assign
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.checking.estimate import about
from gloc3.mission.checking.plan_check import check_plan
from gloc3.mission.examples import find_mission
from gloc3.mission.formats import (
    MISSION_SUFFIXES,
    as_it_is_text,
    exported,
    is_plan_file,
    load_plan,
    mission_text,
    plan_formats,
    plan_text,
    to_mission,
)
from gloc3.mission.reading.reader import MissionReferences, load_mission
from gloc3.mission.showing.picture import picture
from gloc3.mission.showing.plan_listing import parts_summary, plan_listing
from gloc3.mission.showing.show import drawing, mermaid
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform
from gloc3.terrain import open_terrain

app = App(
    name="gloc3 mission",
    help="""Make, check, show, simulate and convert mission files; list capabilities.

    For example:

    - `gloc3 mission check my.yaml --platform pelican_rtk`: all errors, with file, line and column
    - `gloc3 mission show inspection`: tasks and actions in their order, with estimated times
    - `gloc3 mission new survey --platform boat`: a valid mission to start from
    - `gloc3 mission capabilities go_to --platform pelican`: what an action takes, with units, bounds and an example
    - `gloc3 mission convert field.plan field.yaml`: a plan of QGroundControl; also back, and waypoints

    Exit codes: 0 done; 1 not fit to fly, or not convertible; 2 wrong use.""",
    help_format="markdown",
    version_flags=[],
)

_BROUGHT: Final = {"simulate": "Fly a mission in simulation, and compare the flight with its estimate."}
"""What the list of commands says of those of other packages, without loading any of them."""

for _point in installed_points("gloc3.mission_commands"):
    app.command(_point.value, name=_point.name, help=_BROUGHT.get(_point.name, f"From {_point.value}."))  # loaded late

OK: Final = 0
FAILED: Final = 1
WRONG_USE: Final = 2
CLEARANCE_MAX_M: Final = 10_000.0

Mission = Annotated[str, Parameter(help="A mission file, a plan, or the name of an example.")]
OnPlatform = Annotated[str | None, Parameter(help="A platform file, or the name of an installed platform.")]
OnPlatforms = Annotated[list[str] | None, Parameter(name="--platform", negative=())]


@app.command
def check(
    mission: Mission,
    /,
    *,
    platforms: OnPlatforms = None,
    terrain: Path | None = None,
    clearance: float | None = None,
    json_output: Annotated[bool, Parameter(name="--json")] = False,
) -> int:
    """Check a mission: its order, arguments, claims, space, time, energy and policies.

    Args:
        mission: The mission to check.
        platforms: A platform file or the name of an installed platform to check against; without it only the file
            itself is checked. May be given again for a mission whose tasks are for several platforms; then the parts of
            platforms that are not given are checked separately. Tasks with platform: any are assigned to those given.
        terrain: A folder with terrain tiles (SRTM .hgt or .hgt.zip) to check heights above the ground against; needed
            for height_above: ground. None is downloaded.
        clearance: Least height above that ground in metres; default: the platform's limits.ground_clearance_m.
        json_output: Print the report as JSON.
    """
    try:
        path, on = find_mission(mission), [load_platform(name) for name in platforms or ()]
    except InputError as error:
        return _fail(error, WRONG_USE)
    around = _above(terrain, clearance)
    try:
        if is_plan_file(path):
            return _check_plan(path, replace(around, platform=on[0] if on else None), json_output=json_output)
        if assignment := _assignment(path, around, on):
            return _print_assignment(assignment, json_output=json_output)
        report = _report(path, replace(around, platform=on[0] if len(on) == 1 else None), on)
    except NotFound as error:
        return _fail(error, WRONG_USE)
    except InputError as error:
        report = CheckReport(file=mission, findings=error.findings)
    return _print_report(report, _verdict(report), json_output=json_output, is_ok=report.is_ok)


def _above(terrain: Path | None, clearance_m: float | None) -> Circumstances:
    """The ground to check against.

    Raises:
        Refused: the folder holds no tiles, or the clearance goes with none.
    """
    if clearance_m is not None and (terrain is None or not 0.0 <= clearance_m <= CLEARANCE_MAX_M):
        raise Refused(f"--clearance goes with --terrain, and is from 0 to {CLEARANCE_MAX_M:g} m")
    return Circumstances(terrain=open_terrain(terrain), clearance_m=clearance_m)


def _check_plan(path: Path, circumstances: Circumstances, *, json_output: bool) -> int:
    """Checks a plan of another program, or its fence or rally points alone."""
    _, report, _ = found = check_plan(path, circumstances)
    if not found.is_parts_alone:
        return _print_report(report, _verdict(report), json_output=json_output, is_ok=report.is_ok)
    is_ok = all(finding.is_warning for finding in report.findings)
    verdict = f"{path} can be uploaded: {parts_summary(found.plan)}; it holds no mission"
    return _print_report(report, verdict if is_ok else _verdict(report), json_output=json_output, is_ok=is_ok)


def _print_report(report: CheckReport, verdict: str, *, json_output: bool, is_ok: bool) -> int:
    if json_output:
        _print(json.dumps(report.as_dict() | {"is_ok": is_ok}, indent=2))
    else:
        for finding in report.findings:
            _print(str(finding))
        _print(verdict)
    return OK if is_ok else FAILED


def _assignment(path: Path, circumstances: Circumstances, on: Sequence[Platform]) -> TaskAssignment | None:
    """Who does what, where the mission leaves that open and platforms are given.

    Raises:
        Refused: two of the platforms have one name.
    """
    names = [one.platform for one in on]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise Refused(f"two platform files are named {twice}: vehicles that fly together need names of their own")
    if not on or is_plan_file(path):
        return None
    file, text, _ = mission_text(str(path))
    mission = check_text(text, file, replace(circumstances, is_assigned_later=True)).mission
    if mission is None or not mission.unassigned:
        return None
    return assign(text, file, [AvailableVehicle(platform=one) for one in on], circumstances)


def _print_assignment(assignment: TaskAssignment, *, json_output: bool) -> int:
    report = assignment.report
    if not json_output:
        for share in assignment.shares:
            _print(str(share))
        return _print_report(report, _verdict(report), json_output=False, is_ok=report.is_ok)
    shares = {share.platform: share.as_dict() for share in assignment.shares}
    _print(json.dumps(report.as_dict() | {"assigned": shares}, indent=2))
    return OK if report.is_ok else FAILED


@app.command
def show(
    mission: Mission,
    /,
    *,
    platforms: OnPlatforms = None,
    terrain: Path | None = None,
    mermaid_output: Annotated[bool, Parameter(name="--mermaid")] = False,
    svg: Path | None = None,
) -> int:
    """Draw the partial order of a mission, with estimated times; with terrain tiles also its heights over the ground.

    Args:
        mission: The mission to draw.
        platforms: The platform that flies it, for better estimates. May be given again: tasks with platform: any are
            assigned to those given.
        terrain: A folder with terrain tiles (SRTM .hgt or .hgt.zip), to draw heights above the ground as well.
        mermaid_output: Draw a Mermaid flowchart instead.
        svg: Draw its path in plan view and its order over time into this file instead.
    """
    try:
        path, given = find_mission(mission), [load_platform(name) for name in platforms or ()]
    except InputError as error:
        return _fail(error, WRONG_USE)
    around, on = _above(terrain, None), given[0] if len(given) == 1 else None
    try:
        if is_plan_file(path) and (listed := _listed(path, on)):
            _print(listed, end="")
            return OK
        assignment = _assignment(path, around, given)
        report = assignment.report if assignment else _report(path, replace(around, platform=on), given[1:] and given)
        found = report.flyable()
        for share in assignment.shares if assignment else ():
            _print(str(share))
    except InputError as error:
        return _fail(error, WRONG_USE if isinstance(error, NotFound) else FAILED)
    if svg is not None:
        return _write(svg, picture(report))
    _print(mermaid(found) if mermaid_output else drawing(report, Circumstances(platform=on).capabilities(), on), end="")
    return OK


@app.command
def capabilities(
    name: str | None = None,
    /,
    *,
    platform: OnPlatform = None,
    json_output: Annotated[bool, Parameter(name="--json")] = False,
) -> int:
    """List the capabilities that missions can use, or explain one: arguments, units, bounds, an example.

    Args:
        name: The capability to explain; default: list all.
        platform: The platform whose capabilities are listed; default: all installed kinds.
        json_output: Print JSON.
    """
    from gloc3.cli.tables import print_json
    from gloc3.mission.showing.capability_lines import capability_line, capability_lines, explain, list_capabilities

    try:
        on = _platform(platform)
        found = capability_line(name, on) if name is not None else capability_lines(on)
    except InputError as error:
        return _fail(error, WRONG_USE)
    if json_output:
        print_json(found)
    elif isinstance(found, tuple):
        list_capabilities(found, on)
    else:
        explain(found, on)
    return OK


@app.command
def new(template: str | None = None, /, *, platform: str = "pelican_rtk", file: Path | None = None) -> int:
    """Make a mission file from a template, and beside it the schema by which editors complete and check it.

    Args:
        template: The template; default: list all.
        platform: The platform that flies it: a platform file or the name of an installed one.
        file: The file to write; default: TEMPLATE.yaml here. An existing file is never overwritten.
    """
    from gloc3.documents.json_schema import as_text
    from gloc3.mission.reading.mission_schema import mission_schema
    from gloc3.mission.templates import mission_from, templates

    if template is None:
        for name, purpose in templates().items():
            _print(f"{name:<12}{purpose}")
        _print("\nmake one of them: gloc3 mission new survey --platform NAME")
        return OK
    try:
        on = load_platform(platform)
    except InputError as error:
        return _fail(error, WRONG_USE)
    path = file or Path(f"{template}.yaml")
    beside = path.with_name(f"{on.platform}.mission.schema.json")
    text = mission_from(template, on, beside.name)
    if path.exists():
        _report_problem(f"{path} already exists; choose another with --file")
        return WRONG_USE
    if (code := _write(path, text)) != OK or (code := _write(beside, as_text(mission_schema(on)))) != OK:
        return code
    _print(f"wrote {path}, and {beside} for editors. Adapt its positions, and check it:")
    _print(f"  gloc3 mission check {path} --platform {platform}")
    return OK


@app.command
def schema(*, platform: OnPlatform = None, out: Path | None = None) -> int:
    """Print the JSON Schema of mission files, with which editors complete, explain and check them.

    Args:
        platform: The platform whose capabilities, cameras and frames it lists; default: all installed kinds.
        out: The file to write; default: print the schema.
    """
    from gloc3.documents.json_schema import as_text
    from gloc3.mission.reading.mission_schema import mission_schema

    try:
        text = as_text(mission_schema(_platform(platform)))
    except InputError as error:
        return _fail(error, WRONG_USE)
    if out is None:
        _print(text, end="")
        return OK
    return _write(out, text)


@app.command
def convert(source: Mission, target: Path, /, *, platform: OnPlatform = None, as_it_is: bool = False) -> int:
    """Convert between missions (.yaml), plans (.plan), waypoints (.waypoints, .txt) and formats of plug-ins, by suffix.

    Args:
        source: The file to convert.
        target: The file to write.
        platform: Its speed limit applies to a converted plan; its frames give local positions a place on Earth, so that
            a mission in one of them can become a plan, which the autopilot flies alone.
        as_it_is: Make a mission that has the autopilot fly the plan unchanged, with all its commands.
    """
    formats = plan_formats()
    if target.suffix not in (*MISSION_SUFFIXES, *formats.by_suffix):
        hint = formats.hint(*MISSION_SUFFIXES, is_written=True)
        _report_problem(f"{target}: unknown kind of file {target.suffix!r} ({hint})")
        return WRONG_USE
    try:
        path, on = find_mission(source), _platform(platform)
    except InputError as error:
        return _fail(error, WRONG_USE)
    if as_it_is and not (is_plan_file(path) and target.suffix in MISSION_SUFFIXES):
        _report_problem("--as-it-is makes a mission (.yaml) of a plan (.plan, .waypoints, .txt)")
        return WRONG_USE
    try:
        text, warnings = (as_it_is_text(path, target), []) if as_it_is else _converted(path, target.suffix, on)
    except InputError as error:
        return _fail(error, WRONG_USE if isinstance(error, NotFound) else FAILED)
    code = _write(target, text)
    for warning in warnings if code == OK else ():
        _report_problem(str(warning))
    return code


def _converted(source: Path, suffix: str, platform: Platform | None) -> tuple[str, list[Finding]]:
    if not is_plan_file(source):
        frames = platform.local_frames() if platform is not None else None
        return exported(
            load_mission(str(source), MissionReferences.of(platform, is_ground_level=True)), suffix, str(source), frames
        )
    plan = load_plan(source)
    if suffix in MISSION_SUFFIXES:
        return to_mission(plan, source.stem, str(source), platform)
    return plan_text(plan, suffix, str(source))


def _write(file: Path, text: str) -> int:
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        _report_problem(f"{file}: cannot be written: {(error.strerror or str(error)).lower()}")
        return WRONG_USE
    return OK


def _platform(name: str | None) -> Platform | None:
    return load_platform(name) if name is not None else None


def _listed(path: Path, platform: Platform | None) -> str:
    """The items of a plan that cannot become a mission; empty for one that can."""
    plan = load_plan(path)
    try:
        to_mission(plan, path.stem, str(path), platform)
    except InputError:
        return plan_listing(plan)
    return ""


def _report(path: Path, circumstances: Circumstances, known: Sequence[Platform] = ()) -> CheckReport:
    if is_plan_file(path):
        return check_plan(path, circumstances).report
    found = {one.platform: one for one in known}
    file, text, _ = mission_text(str(path))
    around = replace(circumstances, known=found.get if found else None, is_assigned_later=not found)
    return check_text(text, file, around)


def _verdict(report: CheckReport) -> str:
    numbers = f": {about(report.estimate)}" if report.estimate is not None else ""
    errors = sum(not finding.is_warning for finding in report.findings)
    warnings = len(report.findings) - errors
    if report.is_ok and report.mission is not None and report.mission.unassigned:
        left = ", ".join(report.mission.unassigned)
        return f"{report.file} is well written; --platform A --platform B assigns {left}, and checks all parts"
    also = f" ({counted(warnings, 'warning')})" if warnings else ""
    if report.is_ok and report.unknown:
        return f"{report.file} is well written; what {', '.join(report.unknown)} needs was not checked{also}"
    if report.is_ok:
        return f"{report.file} is fit to fly{numbers}{also}"
    return f"{report.file} is not fit to fly: {counted(errors, 'error')}"


def _fail(error: InputError, code: int = FAILED) -> int:
    _report_problem(str(error))
    return code


def _print(text: str, end: str = "\n") -> None:
    sys.stdout.write(printable(text) + end)


def _report_problem(text: str) -> None:
    sys.stderr.write(printable(text) + "\n")
