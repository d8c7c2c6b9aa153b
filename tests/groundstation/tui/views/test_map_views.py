"""The map and the height profile, read as text: the fleet's past comes from a log that was recorded and read back."""

import zlib
from math import cos, pi, sin
from pathlib import Path
from random import Random

import numpy as np
import pytest
from msgspec.structs import replace
from tests.groundstation.flown import SITE, TEXT
from tests.groundstation.scripted_platform import VEHICLE

from gloc3.clock import Clock, VirtualLoop
from gloc3.exchange import LocalExchange, Publisher
from gloc3.log.reader import LogReader
from gloc3.log.record import Recorder
from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.motion import MotionSummary, SiteSummary
from gloc3.messages.perception import CELL_OCCUPIED, OccupancyMap
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.summaries import MissionSummary
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import ObstacleScan
from gloc3_groundstation.mapping.ground import Ground
from gloc3_groundstation.mapping.progress import PathProgress
from gloc3_groundstation.mapping.projection import Projection
from gloc3_groundstation.mapping.requested import requested
from gloc3_groundstation.mapping.tracks import Tracks
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.snapshots import Fleet
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.mission.map import (
    Chart,
    cursor_line,
    ellipse,
    extent,
    is_within,
    legend_lines,
    map_lines,
    map_title,
    vehicle_lines,
)
from gloc3_groundstation.tui.views.mission.profile import along_lines, time_lines
from gloc3_groundstation.tui.widgets.lines import Line, Tone, text_of

WALL_M = 6.0
"""North of the vehicle."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a minute of a flight east, with a wall to the north that the scanner sees, and a second vehicle."""
    file = tmp_path_factory.mktemp("log") / "flight.mcap"
    loop, exchange, random = VirtualLoop(), LocalExchange(), Random(4)
    recorder = Recorder(file, Clock(loop), TopicTable(TOPICS), {"platform": "heron"})
    recorder.attach(exchange)
    heron, tern = Publisher(exchange, "heron", "command_server", 1), Publisher(exchange, "tern", "command_server", 2)
    scanner = Publisher(exchange, "heron", "laser", 77)
    for n in range(120):
        t_s = n * 0.25
        y = -0.4 * t_s
        if n % 8 == 0:
            heron.publish("heron/ci/site", SITE, t_s)
            tern.publish("tern/ci/site", replace(SITE, frame="hold", home_m=None), t_s)
            state = "running" if n else "waiting"
            heron.publish("heron/ci/mission", MissionSummary(name="inspection", digest="d", state=state, tasks={}), t_s)
        heron.publish(
            "heron/ci/vehicle", replace(VEHICLE, t_s=t_s, position_m=(0.0, y, 2.0), speed_m_s=0.4, is_armed=True), t_s
        )
        tern.publish("tern/ci/vehicle", replace(VEHICLE, t_s=t_s, position_m=(-8.0, y / 2.0, 3.0)), t_s)
        heron.publish(
            "heron/ci/motion",
            MotionSummary(
                t_s=t_s,
                attitude_cdeg=(0, 0, 9000),
                position_cm=(0, round(100 * y), 200 + round(20 * sin(t_s))),
                velocity_cm_s=(0, -40, 0),
                is_pose_valid=True,
                setpoint_cm=(0, round(100 * y) - 300, 200),
                covariance_cm2=(40_000, 0, 10_000),
            ),
            t_s,
        )
        points = [(WALL_M + random.gauss(0.0, 0.02), -y + east / 4.0) for east in range(-16, 17)]
        scanner.publish("heron/obstacles", ObstacleScan(points_ne_m=points), t_s)
    recorder.close()
    loop.close()
    return file


@pytest.fixture(scope="module")
def seen(log: Path) -> StationView:
    """What a station knows that the log was played back to."""
    fleet, tracks, now_s = Fleet(), Tracks(), 0.0
    with LogReader(log, TopicTable(TOPICS).types) as reader:
        for entry in reader.entries("ci/*", "obstacles"):
            now_s = 100.0 + entry.envelope.t_s
            before, fleet = fleet, reducers.receive(fleet, entry.envelope, now_s)
            tracks.follow(before, fleet, now_s)
    return StationView(fleet, fleet.get("heron"), now_s, 90.0, "255", tracks=tracks)


def chart_of(view: StationView, text: str = "", width: int = 80, height: int = 24, up_deg: float = 0.0) -> Chart:
    ground = Ground(view.platform)
    projection = Projection(0.0, 0.0, 0.1, up_deg, 2 * width, 4 * height)
    chart = Chart(view, ground, projection, requested(text, ground.site) if text else None, bool(text))
    return chart._replace(projection=projection.fitted(extent(chart)))


def drawn(chart: Chart) -> list[Line]:
    return map_lines(chart, chart.projection.width // 2, chart.projection.height // 4)


def cells(lines: list[Line], tone: Tone) -> list[tuple[int, int]]:
    """Columns and lines of what is drawn in a tone."""
    found = []
    for row, line in enumerate(lines):
        column = 0
        for span in line:
            for letter in span.text:
                if span.tone is tone and letter != " ":
                    found.append((column, row))
                column += 1
    return found


def cell_of(chart: Chart, north: float, east: float) -> tuple[int, int]:
    x, y = chart.projection.dot(north, east)
    return int(x // 2), int(y // 4)


def test_the_map_of_a_vehicle_shows_what_is_occupied_at_its_height_and_a_damaged_one_nothing(seen: StationView) -> None:
    states = np.zeros((2, 10, 40), np.uint8)
    states[1, 5, :] = CELL_OCCUPIED
    found = OccupancyMap(
        corner_ne_m=(10.0, 0.0), cell_m=0.5, rows=10, columns=40, layer_m=0.5, levels=[3, 4], level=4,
        cells=zlib.compress(states.tobytes()),
    )  # fmt: skip

    def dim(received: OccupancyMap) -> set[tuple[int, int]]:
        fleet = reducers.receive(
            seen.fleet, Envelope("heron/map", Source("heron", "map", 1), 0, 0.0, "ned", "", received), seen.now_s
        )
        chart = chart_of(seen._replace(fleet=fleet, platform=fleet.get("heron")))
        return set(cells(drawn(chart._replace(projection=Projection(5.0, 10.0, 0.2, 0.0, 160, 96))), Tone.DIM))

    chart = chart_of(seen)._replace(projection=Projection(5.0, 10.0, 0.2, 0.0, 160, 96))
    added = dim(found) - dim(replace(found, level=0))
    assert len(added) > 30
    assert {row for _, row in added} == {cell_of(chart, 12.75, 5.0)[1]}
    assert dim(replace(found, cells=b"torn")) == dim(replace(found, level=0))


def test_a_played_back_scan_is_a_wall_where_it_stood(seen: StationView) -> None:
    chart = chart_of(seen)._replace(projection=Projection(2.0, 12.0, 0.15, 0.0, 160, 96))
    lines = drawn(chart)
    wall = [place for place in cells(lines, Tone.STRONG) if place[1] == cell_of(chart, WALL_M, 12.0)[1]]
    begin, end = cell_of(chart, WALL_M, 11.9 - 4.0)[0], cell_of(chart, WALL_M, 11.9 + 4.0)[0]
    assert {column for column, _ in wall} >= set(range(begin + 1, end - 1))


def test_an_old_scan_looks_old(seen: StationView) -> None:
    previous = chart_of(seen._replace(now_s=seen.now_s + 3.0))
    chart = previous._replace(projection=Projection(2.0, 12.0, 0.15, 0.0, 160, 96))
    assert len(cells(drawn(chart), Tone.STALE)) > 10


def test_the_ellipse_of_uncertainty_is_as_large_as_the_covariance_says(seen: StationView) -> None:
    edge = ellipse(4.0, 0.0, 1.0)
    assert edge.max(axis=0) == pytest.approx((4.896, 2.448), abs=0.02)
    turned = ellipse(2.5, 1.5, 2.5)
    longest = turned[np.hypot(turned[:, 0], turned[:, 1]).argmax()]
    assert abs(longest[0]) == pytest.approx(abs(longest[1]), rel=0.02)
    chart = chart_of(seen)._replace(projection=Projection(0.0, 11.9, 0.1, 0.0, 160, 160))
    rows = [row for _, row in cells(map_lines(chart, 80, 40), Tone.DIM)]
    assert min(rows) == cell_of(chart, 4.896, 11.9)[1]
    assert max(rows) == cell_of(chart, -4.896, 11.9)[1]


def test_trails_and_names_of_all_vehicles_are_in_their_colours(seen: StationView) -> None:
    chart = chart_of(seen)
    lines = drawn(chart)
    own, other = cells(lines, Tone.FIRST), cells(lines, Tone.SECOND)
    assert cell_of(chart, 0.0, 3.0) in own
    assert cell_of(chart, -8.0, 2.0) in other
    text = "\n".join(text_of(line) for line in lines)
    assert " heron " in text
    assert "tern" in text
    assert any("heron" in span.text and span.tone is Tone.CHOSEN for line in lines for span in line)


def test_a_mission_shows_its_fence_its_numbers_and_home(seen: StationView) -> None:
    chart = chart_of(seen, TEXT)
    lines = drawn(chart)
    north_wall, keep_out = cell_of(chart, 20.0, -5.0), cell_of(chart, 15.5, 0.0)
    assert north_wall in cells(lines, Tone.WARN)
    assert any(abs(column - keep_out[0]) <= 2 and row == keep_out[1] for column, row in cells(lines, Tone.BAD))
    text = [text_of(line) for line in lines]
    column, row = cell_of(chart, 12.0, -5.0)
    assert text[row][column] == "3"
    column, row = cell_of(chart, 0.0, 0.0)
    assert text[row][column] == "⌂"
    assert is_within(extent(chart), chart.projection)
    assert map_title(chart) == "frame hold, cargo hold inspection"
    assert map_title(chart._replace(is_loaded=False)) == "frame hold, cargo hold inspection (not loaded)"


def test_what_is_done_steps_back_and_what_is_not_loaded_does_too(seen: StationView) -> None:
    assert seen.platform is not None
    assert seen.platform.mission is not None

    def at_waypoint(chart: Chart) -> Tone:
        lines, place = drawn(chart), cell_of(chart, 12.0, -5.0)
        return next(tone for tone in (Tone.STRONG, Tone.DIM) if place in cells(lines, tone))

    chart = chart_of(seen, TEXT)
    assert at_waypoint(chart) is Tone.STRONG
    assert at_waypoint(chart._replace(is_loaded=False)) is Tone.DIM
    mission = replace(seen.platform.mission.value, tasks={"sweep.wall": "done"})
    flown = replace(seen.platform, mission=replace(seen.platform.mission, value=mission))
    assert at_waypoint(chart._replace(view=seen._replace(platform=flown))) is Tone.DIM


def test_the_map_tells_north_scale_and_middle_and_turns(seen: StationView) -> None:
    text = [text_of(line) for line in drawn(chart_of(seen))]
    assert "↑ N" in text[0]
    assert text[-1].startswith(" ├─")
    assert "┤ 2 m" in text[-1]
    assert text[12][40] == "+"
    assert "→ N" in text_of(drawn(chart_of(seen, up_deg=270.0))[0])


def test_the_cursor_is_told_in_frame_on_earth_and_from_the_vehicle(seen: StationView) -> None:
    chart = chart_of(seen)
    text = text_of(cursor_line(chart, (3.0, 15.9), 100))
    assert "x 3.0  y -15.9 m" in text
    assert "39.552827°  2.628685°" in text
    assert "5.0 m 053° from heron" in text
    assert "from heron" not in text_of(cursor_line(chart, (3.0, 15.9), 60))
    assert len(text_of(cursor_line(chart, (3.0, 15.9), 40))) <= 40


def test_vehicles_beside_the_map_have_position_and_say_when_they_are_not_on_it(seen: StationView) -> None:
    text = [text_of(line) for line in vehicle_lines(chart_of(seen))]
    assert " ► heron" in text
    assert "   x 0.0  y -11.9  h 1.8 m" in text
    assert "   not on this map" not in text
    assert not any("ago" in line for line in text)
    later = [text_of(line) for line in vehicle_lines(chart_of(seen._replace(now_s=seen.now_s + 60.0)))]
    assert any("that was 1 min" in line for line in later)
    assert seen.fleet.platforms["tern"].site is not None
    far = SiteSummary(frame="lab", x_axis_bearing_deg=0.0, origin_geo=(48.0, 11.0, 500.0))
    tern = replace(seen.fleet.platforms["tern"], site=replace(seen.fleet.platforms["tern"].site, value=far))
    fleet = replace(seen.fleet, platforms={**seen.fleet.platforms, "tern": tern})
    assert "   not on this map" in [text_of(line) for line in vehicle_lines(chart_of(seen._replace(fleet=fleet)))]


def test_the_signs_are_explained(seen: StationView) -> None:
    text = "\n".join(text_of(line) for line in legend_lines(chart_of(seen, TEXT)))
    for word in ("requested", "trail", "fence", "keep out", "home", "setpoint", "95 %"):
        assert word in text


def test_an_empty_map_still_tells_where_it_is() -> None:
    view = StationView(Fleet(), None, 0.0, 0.0, "255")
    chart = chart_of(view)
    assert "↑ x" in text_of(drawn(chart)[0])
    assert map_title(chart) == "frame not known, no mission"
    assert "x 0.0  y 0.0 m" in text_of(cursor_line(chart, (0.0, 0.0), 80))


def test_the_profile_along_the_path_shows_asked_and_flown_heights() -> None:
    request = requested(TEXT, SITE)
    assert request is not None
    progress = PathProgress(request.path_ned_m)
    progress.advance(np.array([(0.0, 0.0, -1.5 * n / 20.0, float(n)) for n in range(21)]))
    lines = along_lines(request, progress, Tone.FIRST, 80, 8)
    text = [text_of(line) for line in lines]
    assert len(lines) == 8
    assert text[0].startswith("     4 ┤")
    assert text[6].startswith("     0 ┤")
    assert text[-1].rstrip().endswith("m along the path")
    assert "◆" in "".join(text)
    assert len(cells(lines, Tone.FIRST)) >= 3
    assert len(cells(lines, Tone.TEXT)) > 30


def test_the_profile_over_time_shows_the_last_minutes(seen: StationView) -> None:
    lines = time_lines(seen.tracks, "heron", Tone.FIRST, seen.now_s, 80, 7)
    text = [text_of(line) for line in lines]
    assert len(lines) == 7
    assert text[-1].split() == ["-5", "min", "-2.5", "min", "now"]
    assert len(cells(lines, Tone.FIRST)) >= 6
    assert time_lines(seen.tracks, "nobody", Tone.FIRST, 0.0, 80, 7) == []


def test_a_circle_of_flight_is_a_circle_on_the_map() -> None:
    tracks, fleet = Tracks(), Fleet()
    exchange = LocalExchange()
    published = Publisher(exchange, "heron", "command_server", 1)
    received: list[Fleet] = [fleet]

    def handle(envelope: object) -> None:
        after = reducers.receive(received[0], envelope, envelope.t_s)  # type: ignore[arg-type, attr-defined]
        tracks.follow(received[0], after, 0.0)
        received[0] = after

    exchange.subscribe("heron/ci/*", handle)
    published.publish("heron/ci/site", SITE, 0.0)
    for n in range(200):
        angle = 2.0 * pi * n / 199.0
        position = (round(1000 * cos(angle)), round(1000 * sin(angle)), 200)
        published.publish(
            "heron/ci/motion",
            MotionSummary(
                t_s=n * 0.25, attitude_cdeg=(0, 0, 0), position_cm=position, velocity_cm_s=(0, 0, 0), is_pose_valid=True
            ),
            n * 0.25,
        )
    view = StationView(received[0], received[0].get("heron"), 50.0, 0.0, "255", tracks=tracks)
    chart = chart_of(view)._replace(projection=Projection(0.0, 0.0, 0.25, 0.0, 100, 100))
    found = cells(map_lines(chart, 50, 25), Tone.FIRST)
    away = [((column + 0.5 - 25.0) * 2.0, (row + 0.5 - 12.5) * 4.0) for column, row in found]
    assert len(found) > 50
    assert all(37.0 < (x * x + y * y) ** 0.5 < 43.0 for x, y in away)
