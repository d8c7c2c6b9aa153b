"""Plans that are not ours: read beside MAVSDK and pymavlink, shown, checked, and flown as they are."""

import json
import math
import tempfile
from collections.abc import Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import msgspec
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError
from pymavlink import mavwp
from tests.data_folders import PLANS
from tests.evidence.page import Bar, Figure, Progress
from tests.flight.card import Card
from tests.sitl.mavsdk_client import client_of

from gloc3.errors import InputError
from gloc3.mavlink.services.plan import units_per_degree
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.formats import load_plan, plan_text, read_plan, read_wpl, to_mission, write_plan, write_wpl
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.formats.items import ForeignPlan, MavItem
from gloc3.mission.showing.plan_listing import plan_listing
from gloc3.plan_wire import to_wire
from gloc3.platform.reader import load_platform
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.flights import FarAway
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.command_client import Declined

LEAST: Final = 60
LEAST_FLOWN: Final = 30
SOURCES: Final = "sources.txt"
"""Names the repositories of the files, with their commits; `collect_plans` writes it."""
LONGEST_S: Final = 1200.0
"""Longest flight; those with an estimate of up to 60 % of it are flown."""
ENDED: Final = ("done", "failed", "aborted", "paused")


def vehicle(name: str) -> str:
    """The platform that flies a file, by the name of its folder."""
    lower = name.lower()
    for platform, words in (
        ("vtol", ("vtol", "quadplane", "shiplanding")),
        ("rover", ("rover",)),
        ("submarine", ("ardusub", "/sub")),
        ("plane", ("plane", "fw_", "foamy")),
    ):
        if any(word in lower for word in words):
            return platform
    return "copter"


def _row(command: int, frame: int, params: Sequence[float], x: int, y: int, z: float) -> list[float]:
    """An item as it is compared: positions in the wire's units."""
    single = [_plain(value) for value in params]
    return [command, frame, *single, x, y, _plain(z)]


def _plain(value: float) -> float:
    return 0.0 if math.isnan(value) else round(value, 4)


def ours_as_rows(items: Sequence[MavItem]) -> list[list[float]]:
    """Items as they are compared."""
    sent = [to_wire(one, "item") for one in items]
    return [_row(s.command, s.frame, (s.param1, s.param2, s.param3, s.param4), s.x, s.y, s.z) for s in sent]


def imported(raw: MissionRaw, path: Path) -> list[list[float]] | None:
    """What MAVSDK's importer makes of a file: all items; None where it refuses it."""
    read = (
        raw.import_qgroundcontrol_mission_from_string
        if path.suffix == ".plan"
        else raw.import_mission_planner_mission_from_string
    )
    try:
        data = read(path.read_text(errors="replace"))
    except MissionRawError:
        return None
    rows = []
    for one in (*data.mission_items, *data.geofence_items, *data.rally_items):
        params = (one.param1, one.param2, one.param3, one.param4)
        rows.append(_row(one.command, one.frame, params, one.x, one.y, one.z))
    return rows


def loaded(path: Path) -> list[list[float]] | None:
    """What pymavlink's loader makes of a file of waypoints; None where it refuses it, or is not for it."""
    if path.suffix == ".plan":
        return None
    loader = mavwp.MAVWPLoader()
    try:
        loader.load(str(path))
    except mavwp.MAVWPError:
        return None
    found = []
    for number in range(loader.count()):
        one = loader.wp(number)
        params = (one.param1, one.param2, one.param3, one.param4)
        units = units_per_degree(one.frame)
        found.append(_row(one.command, one.frame, params, round(one.x * units), round(one.y * units), one.z))
    return found


def agrees(plan: ForeignPlan, theirs: list[list[float]] | None, called: str) -> str:
    """Whether our reading is another program's, item by item."""
    if theirs is None:
        return f"{called} does not read it"
    items = [*plan.items, *plan.fence_items(), *plan.rally_items()]
    rows, others = ours_as_rows(items), theirs
    if plan.is_from_waypoints and len(others) == len(rows) + 1:
        others = others[1:]  # home, which is no item
    if len(rows) != len(others):
        return f"{called}: {len(others)} items, ours {len(rows)}: DIFFERENT"
    for number, (one, other) in enumerate(zip(rows, others, strict=True), start=1):
        if not _is_same(one, other):
            return f"{called}: item {number} DIFFERENT: {one} and {other}"
    return f"equal to {called}"


def _is_same(one: list[float], other: list[float]) -> bool:
    is_fence = one[0] >= 5000  # the height and the frame of a corner mean nothing
    pairs = list(zip(one, other, strict=True))
    kept = [pairs[index] for index in (0, 2, 6, 7)] if is_fence else pairs
    return all(abs(a - b) <= max(1.0 if index >= 6 else 1e-4, 1e-6 * abs(a)) for index, (a, b) in enumerate(kept))


def written(plan: ForeignPlan, raw: MissionRaw) -> str:
    """What MAVSDK and pymavlink read of what we write: of every item that the format holds."""
    told = []
    for suffix in (".plan", ".waypoints"):
        kept = msgspec.structs.replace(plan, fence_return=None)  # MAVSDK does not read the return point of a .plan
        if suffix == ".waypoints" and plan.items:
            kept = msgspec.structs.replace(plan, raw=None, fence=(), fence_return=None, rally=())
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"written{suffix}"
            file.write_text(plan_text(plan, suffix, file.name)[0])
            if suffix == ".waypoints" and not plan.items:
                kept = load_plan(file)
            told.append(f"{suffix}: {agrees(kept, imported(raw, file), 'MAVSDK')}")
            if suffix == ".waypoints":
                told[-1] += f", {agrees(kept, loaded(file), 'pymavlink')}"
    return "; ".join(told)


def reading(path: Path, raw: MissionRaw) -> str:
    """What becomes of a file when it is read, listed, and written and read again."""
    theirs = imported(raw, path)
    try:
        plan = load_plan(path)
    except InputError as error:
        told = str(error.findings[0]).removeprefix(f"{path}")
        also = "MAVSDK refuses it, too" if theirs is None else "MAVSDK reads it: DIFFERENT"
        return f"refused{told}; {also}"
    again = read_plan(write_plan(plan), "a") if path.suffix == ".plan" else read_wpl(write_wpl(plan), "a")
    count = len(plan.items) + len(plan.fence) + len(plan.rally)
    shown = "shown" if plan_listing(plan).count("\n") >= count else "NOT SHOWN: DIFFERENT"
    lost = "" if again.items == plan.items or plan.is_from_waypoints else "; written and read again DIFFERENT"
    parts = f"{len(plan.items)} items, {len(plan.fence)} fence areas, {len(plan.rally)} rally points"
    others = [agrees(plan, theirs, "MAVSDK")]
    if path.suffix != ".plan":
        others.append(agrees(plan, loaded(path), "pymavlink"))
    read = f"read: {parts}, {shown}; {'; '.join(others)}{lost}"
    return f"{read}; written again, {written(plan, raw)}; as a mission: {converted(plan, path)}"


def converted(plan: ForeignPlan, path: Path) -> str:
    """Whether it becomes a mission of ours, or the first reason why not, with its line."""
    try:
        _, warnings = to_mission(plan, path.stem, "", load_platform(vehicle(str(path))))
    except InputError as error:
        findings = [one for one in error.findings if not one.is_warning]
        return "refused, " + str(findings[0]).removeprefix(":").partition(" (")[0]
    return f"yes, {len(warnings)} warnings"


def mission_of(path: Path) -> str:
    """A mission that has the autopilot fly the file as it is."""
    carried = json.dumps({path.name: path.read_text()})
    return f"mission: as it is\nframe: geo\ntasks:\n  fly:\n    flown_by: autopilot\n    plan: {carried}\n"


def check(path: Path) -> CheckReport:
    """The check of that mission for the platform of its folder."""
    return check_text(mission_of(path), "m", Circumstances(platform=load_platform(vehicle(str(path)))))


def fitness(path: Path) -> dict[str, Any]:
    """Whether it may be flown as it is: the estimate, or the first reason against it with the plan's line."""
    report = check(path)
    wrong = [finding.message for finding in report.findings if not finding.is_warning]
    order = next((one.order for one in report.mission.actions().values()), None) if report.mission else None
    ends = isinstance(order, FlyFileOrder) and not order.never_ends and bool(order.path)
    return {
        "wrong": wrong[:1],
        "duration_s": report.estimate.duration_s if report.estimate is not None else 0.0,
        "ends": ends,
        "digest": sha256(path.read_bytes()).hexdigest(),
    }


def begun(card: Card, mission: str, platform: str) -> str:
    """Starts a mission as an operator does, who confirms what the station asks; returns what that was."""
    try:
        card.begin(mission, platform=platform)
    except FarAway as far:
        card.run(confirmed(card))
        return f" (after the question: {far})"
    return ""


async def confirmed(card: Card) -> None:
    """Uploads and starts the mission although it begins far away."""
    flown = card.flight
    plan = CheckedPlan(name=flown.mission_file.name, title=flown.mission.name, text=flown.mission.text)
    await flights.stream(flown.station, flown.name, plan, is_far_ok=True)
    await flights.start(flown.station, flown.name)


def flight(path: Path) -> str:
    """Flies it as it is on the embedded autopilot, in virtual time."""
    is_px4 = "px4" in str(path).lower() and vehicle(str(path)) in (
        "copter",
        "vtol",
    )  # the classes that it has in its style
    style = "px4" if is_px4 else "ardupilot"
    with tempfile.TemporaryDirectory() as folder:
        card = Card(style, Path(folder))
        try:
            platform = vehicle(str(path))
            asked = begun(card, mission_of(path), platform)
            card.until(lambda: card.state("mission") in ENDED, LONGEST_S, "the mission has ended")
            state = card.state("mission")
            reasons = [event.text for event in card.events if "fly" in event.text and "failed" in event.text]
            armed = ", disarmed" if not card.autopilot.is_armed else ""
            return f"{state} after {card.now_s:.0f} s{armed}{asked}" + (f": {reasons[0]}" if reasons else "")
        except Declined as refusal:  # where it stands, home and its altitude are known
            lines = str(refusal).splitlines()
            return "refused by the vehicle: " + next((line for line in lines if "item" in line), lines[0])
        finally:
            card.close()


def plans(progress: Progress) -> list[Figure]:
    """All files: read, shown, compared; then a part of them flown."""
    paths = sorted(path for path in PLANS.rglob("*") if path.is_file() and path.name != SOURCES)
    sources = (PLANS / SOURCES).read_text().splitlines() if (PLANS / SOURCES).is_file() else ["not noted"]
    names = {path: str(path.relative_to(PLANS)) for path in paths}
    if any(not progress.knows(f"read {name}") for name in names.values()):
        with client_of() as client:
            raw = client.plugin(MissionRaw)
            for path, name in names.items():
                progress.part(f"read {name}", partial(reading, path, raw))
    texts = {name: str(progress.part(f"read {name}", str)) for name in names.values()}
    fit = {
        path: progress.part(f"fit {name}", partial(fitness, path))
        for path, name in names.items()
        if texts[name].startswith("read")
    }
    chosen = _chosen(fit)
    flown = {}
    for path in chosen:
        progress.report(f"flies {names[path]}")
        flown[path] = str(progress.part(f"fly {names[path]}", partial(flight, path)))
    refused = sum("wrong" in one and bool(one["wrong"]) for one in fit.values())
    with_line = sum(bool(one["wrong"]) and ", line " in one["wrong"][0] for one in fit.values())
    settled = len(flown) + with_line + len(paths) - len(fit)
    both = sum(text.count("equal to MAVSDK") >= 2 and "equal to pymavlink" in text for text in texts.values())
    figures = [
        Figure("files that are not ours", str(len(paths)), f">= {LEAST}", len(paths) >= LEAST),
        Figure("their repositories", "; ".join(sources)),
        Figure("read", str(len(fit)), "the others are refused with a reason", True),
        Figure("equal to MAVSDK, item by item", str(sum("equal to MAVSDK" in text for text in texts.values()))),
        Figure("equal to pymavlink, item by item", str(sum("equal to pymavlink" in text for text in texts.values()))),
        Figure("written again, and read equal by MAVSDK and pymavlink", str(both), f">= {LEAST}", both >= LEAST),
        Figure("become a mission of ours", str(sum("as a mission: yes" in text for text in texts.values()))),
        Figure("fit to be flown as they are", str(len(fit) - refused), "the others name the reason", True),
        Figure("flown as they are", str(len(flown)), f">= {LEAST_FLOWN}", len(flown) >= LEAST_FLOWN),
        Figure("flown, or refused with the line and the reason", str(settled), f">= {LEAST}", settled >= LEAST),
    ]
    for path, name in names.items():
        text = texts[name]
        if path in fit:
            wrong = fit[path]["wrong"]
            text += f"; as it is: {'refused, ' + wrong[0] if wrong else 'fit'}"
        figures.append(Figure(name, text.replace("|", "\\|"), "read equal, or a reason", "DIFFERENT" not in text))
    for path, text in flown.items():
        is_met = text.startswith("done") or ("refused" in text and "line" in text)
        name = f"flown by {vehicle(str(path))}: {names[path]}"
        figures.append(Figure(name, text.replace("|", "\\|"), "done, or refused with the line", is_met))
    return figures


def _chosen(fit: dict[Path, Any]) -> list[Path]:
    """The files that are flown: those that are fit and end in time, no content twice."""
    found: dict[str, Path] = {}
    for path, facts in fit.items():
        if not facts["wrong"] and facts["ends"] and facts["duration_s"] <= 0.6 * LONGEST_S:
            found.setdefault(facts["digest"], path)
    return sorted(found.values())


BARS = (
    Bar(
        "plans",
        "Public plans of other projects are read as their own programs read them, and flown",
        "Public files from the repositories of ArduPilot, PX4, MAVProxy and MAVSDK (in the folder that the variable "
        "GLOC3_PLANS names) are read item by item as MAVSDK's importer and pymavlink read them, or refused with a "
        "line and a reason. They are shown, and flown unchanged by the embedded autopilot under GLOC3's supervision.",
        plans,
    ),
)
