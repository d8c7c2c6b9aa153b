"""Five vehicles in one survey for any platform, of which one is lost; and vehicles on crossing ways."""

import asyncio
import tempfile
from functools import partial
from math import dist
from pathlib import Path

import msgspec
from tests.evidence.fleet_picture import draw_tracks
from tests.evidence.page import PAGES, Bar, Figure, Progress
from tests.flight import crossing
from tests.flight.crossing import SEPARATION_M, tracks_of
from tests.flight.shared_mission import SharedMission, at, block

from gloc3.clock import VirtualLoop
from gloc3.errors import Finding
from gloc3.mission.assigning.assignment import AvailableVehicle, assign
from gloc3.mission.checking.checker import Circumstances
from gloc3.platform.reader import load_platform
from gloc3_groundstation.shared_missions.shared_flight import LOST_AFTER_S, Replacement

SIZE_M, SPEEDS = 8.0, (1.0, 2.0, 3.0)
SHARED_PICTURE, CROSSING_PICTURE = "fleet_survey.svg", "fleet_crossing.svg"
HOMES = {"alpha": (0.0, -40.0), "bravo": (0.0, -20.0), "charlie": (0.0, 0.0), "delta": (0.0, 20.0), "echo": (0.0, 40.0)}
KINDS = {"bravo": "copter", "delta": "copter"}
BLOCKS = {f"block_{row}{number}": (12.0 + 14.0 * row, 20.0 * number - 44.0) for row in range(2) for number in range(5)}
PICTURES = "block_12"
"""Its pictures are taken, too, which the copters cannot do."""
LOST = ("echo", "bravo")
"""The vehicle that is lost, in each run."""


def survey_mission() -> str:
    """Ten blocks of one survey for any platform; each vehicle departs and arrives for itself."""
    tasks = []
    for name, corner in BLOCKS.items():
        more = ", shots: {record_images: {camera: ground, every_m: 2}, until: lines}" if name == PICTURES else ""
        tasks.append(
            f"  {name}: {{platform: any, after: [up], actions: {{lines: {block(*corner, size_m=SIZE_M)}{more}}}}}\n"
        )
    head = "mission: one survey\nframe: geo\non_failure: return\non_link_loss: continue\non_low_battery: land\ntasks:\n"
    up = "  up: {platform: each, actions: {go: {take_off: {height_m: 4}}}}\n"
    down = (
        "  down: {platform: each, after: [NAMES], actions: {home: {return_home: {}}, end: {land: {}, after: [home]}}}\n"
    )
    return head + up + "".join(tasks) + down.replace("NAMES", ", ".join(BLOCKS))


class Surveyed(msgspec.Struct):
    """What came of a survey."""

    lost: str
    end: str
    reason: str
    assigned: dict[str, tuple[str, ...]]
    left: tuple[str, ...] = ()
    took_over: dict[str, tuple[str, ...]] = {}
    decided_s: float = -1.0
    flown: tuple[str, ...] = ()
    """Blocks whose middle some vehicle has really passed within 3 m."""


async def survey(lost: str, folder: Path, picture: Path | None) -> Surveyed:
    """Flies it, and has the computer of a vehicle die in its first block."""
    shared, asked = SharedMission(folder, survey_mission(), HOMES, KINDS), list[tuple[float, Replacement]]()
    async with shared.fleet() as fleet:
        station = fleet.grounds[0].station

        async def agree(found: Replacement) -> bool:
            asked.append((fleet.loop.time(), found))
            return True

        flight, found = await shared.begun(station)
        follow = asyncio.ensure_future(flight.follow(agree))
        first = found.assigned[lost][0]
        await fleet.flights[lost].expect("ci/mission", lambda mission: mission.tasks.get(first) == "running", 120.0)
        await asyncio.sleep(5.0)
        fleet.flights[lost].process.kill()
        killed_s = fleet.loop.time()
        async with asyncio.timeout(900.0):
            end = await follow
        tracks = tracks_of(fleet)
        killed = min(tracks[lost], key=lambda one: abs(one[0] - killed_s))[1]
        tracks[lost] = [one for one in tracks[lost] if one[0] <= killed_s]
        half_m = SIZE_M / 2.0
        flown = tuple(
            name
            for name, (north, east) in BLOCKS.items()
            if any(dist(at[:2], (north + half_m, east + half_m)) < 3.0 for track in tracks.values() for _, at in track)
        )
        if picture is not None:
            areas = {name: (*corner, SIZE_M) for name, corner in BLOCKS.items()}
            title = f"One survey by five vehicles; {lost} is lost, and others do its blocks (true paths)"
            draw_tracks(picture, title, tracks, areas, {f"{lost} is lost": killed})
    now_s, replaced = asked[0] if asked else (-1.0, None)
    return Surveyed(
        lost=lost,
        end=end.state,
        reason=end.reason,
        assigned=found.assigned,
        left=replaced.tasks if replaced else (),
        took_over=dict(replaced.assigned) if replaced else {},
        decided_s=round(now_s - killed_s, 1),
        flown=flown,
    )


def flown_survey(number: int) -> Surveyed:
    """One run."""
    picture = PAGES / SHARED_PICTURE if number == 0 else None
    with tempfile.TemporaryDirectory() as name, asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(survey(LOST[number], Path(name), picture))


def crossed(speed_m_s: float, *, is_limited: bool) -> tuple[float, str]:
    """The least distance by truth, and how the mission ended."""
    limits = crossing.LIMITS if is_limited else ""
    with tempfile.TemporaryDirectory() as name, asyncio.Runner(loop_factory=VirtualLoop) as runner:
        found = runner.run(crossing.cross(Path(name), limits, speed_m_s=speed_m_s))
    if is_limited and speed_m_s == SPEEDS[1]:
        title = f"Crossing ways at {speed_m_s:g} m/s with {SEPARATION_M:g} m of separation (true paths)"
        draw_tracks(PAGES / CROSSING_PICTURE, title, found.tracks, {}, {})
    return found.nearest_m, found.end.state


def _is_about_it(finding: Finding) -> bool:
    return "alpha_across.go" in finding.message and "beta_across.go" in finding.message


def proof() -> tuple[str, bool]:
    """What the checker says of the crossing ways before the start, and whether its hint would do."""
    with tempfile.TemporaryDirectory() as name:
        shared = SharedMission(Path(name), crossing.crossing_mission(), crossing.HOMES, limits=crossing.LIMITS)
        text = shared.mission.read_text()
        vehicles = [
            AvailableVehicle(platform=load_platform(file), home=at(*crossing.HOMES[one]))
            for one, file in shared.files.items()
        ]
        after = text.replace("after: [beta_up]", "after: [beta_up, alpha_across]")
        found, again = (
            [
                one
                for one in assign(written, "crossing.yaml", vehicles, Circumstances()).report.findings
                if _is_about_it(one)
            ]
            for written in (text, after)
        )
    first = next(iter(found), None)
    return (f"{first.message} ({first.hint})" if first else "nothing"), bool(first) and not again


def fleet(progress: Progress) -> list[Figure]:
    """Figures of both."""
    figures = []
    for number, lost in enumerate(LOST):
        progress.report(f"survey without {lost}")
        one = msgspec.convert(progress.part(f"survey {number}", partial(flown_survey, number)), Surveyed)
        name = f"survey, {lost} lost"
        shares = "; ".join(f"{who}: {', '.join(tasks)}" for who, tasks in one.assigned.items())
        more = {who: [task for task in tasks if task in one.left] for who, tasks in one.took_over.items()}
        takers = "; ".join(f"{who}: {', '.join(tasks)}" for who, tasks in more.items() if tasks)
        camera = [who for who, tasks in one.assigned.items() if PICTURES in tasks]
        figures += [
            Figure(f"{name}: assigned", shares, f"{PICTURES} to a vehicle with a camera", camera[0] not in KINDS),
            Figure(
                f"{name}: left, and taken over by",
                f"{', '.join(one.left)}; {takers}",
                "all",
                sum(map(len, more.values())) == len(one.left) > 0,
            ),
            Figure(
                f"{name}: from its last message to the new assignment",
                f"{one.decided_s:.1f} s",
                f"≤ {LOST_AFTER_S + 2.0:g} s",
                0.0 <= one.decided_s <= LOST_AFTER_S + 2.0,
            ),
            Figure(
                f"{name}: blocks that were really flown",
                f"{len(one.flown)} of {len(BLOCKS)}",
                "all",
                len(one.flown) == len(BLOCKS),
            ),
            Figure(f"{name}: the mission", f"{one.end} ({one.reason})", "done", one.end == "done"),
        ]
    for speed in SPEEDS:
        progress.report(f"crossing at {speed:g} m/s")
        apart_m, end = progress.part(f"crossing {speed}", partial(crossed, speed, is_limited=True))
        near_m, _ = progress.part(f"crossing {speed} unlimited", partial(crossed, speed, is_limited=False))
        name = f"crossing ways at {speed:g} m/s: least distance by truth"
        figures += [
            Figure(
                f"{name}, with a separation of {SEPARATION_M:g} m",
                f"{apart_m:.2f} m, {end}",
                f"≥ {SEPARATION_M:g} m, done",
                apart_m >= SEPARATION_M and end == "done",
            ),
            Figure(f"{name}, without", f"{near_m:.2f} m", f"< {SEPARATION_M:g} m", near_m < SEPARATION_M),
        ]
    said, is_solved = proof()
    figures.append(Figure("what the checker says before the start", said, "an error whose hint would do", is_solved))
    return figures


BARS = (
    Bar(
        "fleet",
        "Five vehicles finish a survey after one is lost, and crossing vehicles keep 6 m apart",
        "Five vehicles of two kinds fly one mission whose ten blocks say `platform: any`. The station assigns them by "
        "capability, position and budget, and has each part checked. The companion computer of one vehicle dies in "
        "its first block; the station assigns the remaining blocks to the others, which continue in flight by the new "
        "mission. In further flights two vehicles cross each other's path at the same height and time, with and "
        "without a separation in their platform files. Whole stacks run in virtual time; distances and blocks are "
        "those of the simulated truth.",
        fleet,
        seeds="0 to 4, one for each vehicle",
        pictures=(SHARED_PICTURE, CROSSING_PICTURE),
    ),
)
