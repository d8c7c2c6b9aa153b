"""Pictures of a log: they contain what they must, and are the same bytes each time."""

from pathlib import Path

import pytest

from gloc3.errors import Gloc3Error, Refused
from gloc3.log.fields import plot_series, read_series
from gloc3.log.reader import LogReader
from gloc3.log.report.flight_path import distances_along, read_flight_path
from gloc3.log.report.plot import plot_flight, plot_path
from gloc3.log.report.timeline import plot_timelines, read_timelines
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.summaries import Health
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Pose

from .samples import FENCE, POSE, REQUESTED, LogInMemory, flight_log

pytestmark = pytest.mark.thorough

LOG = flight_log()


@pytest.fixture
def reader(tmp_path: Path) -> LogReader:
    file = tmp_path / "log.mcap"
    file.write_bytes(LOG)
    return LogReader(file, TopicTable(TOPICS).types)


def test_the_flight_is_what_the_log_tells(reader: LogReader) -> None:
    path = read_flight_path(reader)
    assert path.requested == REQUESTED
    assert len(path.flown) == 81
    assert path.source == "pose"
    assert path.home == (0.0, 0.1, 0.0)
    assert path.fence == FENCE
    assert path.mission == "round"


def test_the_truth_of_a_simulation_goes_before_the_pose_and_invalid_poses_are_left_out(tmp_path: Path) -> None:
    def pose(north_m: float, *, is_valid: bool = True) -> Pose:
        return Pose(
            position_ned_m=(north_m, 0.0, 0.0),
            velocity_ned_m_s=(0.0, 0.0, 0.0),
            ned_from_frd=(1.0, 0.0, 0.0, 0.0),
            is_valid=is_valid,
        )

    log = LogInMemory()
    log.send("pose", pose(1.0), 0.0, POSE)
    log.send("pose", pose(9.0, is_valid=False), 0.1, POSE)
    file = tmp_path / "log.mcap"
    log.recorder.flush(1e9)
    file.write_bytes(log.stream.getvalue())
    assert read_flight_path(LogReader(file)).flown == [(1.0, 0.0, 0.0)]
    log.send("sim/truth", pose(2.0), 0.2, POSE)
    file.write_bytes(log.close())
    assert read_flight_path(LogReader(file)).flown == [(2.0, 0.0, 0.0)]


def test_the_picture_shows_both_paths_home_fence_and_waypoints_the_same_each_time(
    reader: LogReader, tmp_path: Path
) -> None:
    one, other = tmp_path / "one.svg", tmp_path / "other.svg"
    plot_flight(read_flight_path(reader), one)
    plot_flight(read_flight_path(reader), other)
    text = one.read_text()
    for part in ("requested", "flown", "waypoints", "home", "fence", "keep-out", "requested height", "flown height"):
        assert f'id="{part}"' in text
    assert 'id="ceiling"' in text
    requested = text.partition('id="requested"')[2].partition("</g>")[0]
    flown = text.partition('id="flown"')[2].partition("</g>")[0]
    assert "stroke-dasharray" in requested
    assert "#e02020" in requested
    assert "stroke-dasharray" not in flown
    assert "#1f4fd8" in flown
    assert "dc:date" not in text
    assert one.read_bytes() == other.read_bytes()


def test_a_flight_without_a_mission_is_drawn_too(tmp_path: Path) -> None:
    plot_path([], [], tmp_path / "none.png")
    assert (tmp_path / "none.png").read_bytes()[:4] == b"\x89PNG"


def test_formats_that_cannot_be_drawn_are_refused(tmp_path: Path) -> None:
    with pytest.raises(Gloc3Error, match=r"use one of \.svg"):
        plot_path([], [], tmp_path / "path.docx")
    with pytest.raises(Gloc3Error, match="cannot write"):
        plot_path([], [], tmp_path / "no" / "path.png")


def test_height_is_drawn_over_the_progress_along_the_requested_path() -> None:
    path = [(0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (4.0, 4.0, 0.0)]
    flown = [(0.0, 0.1, 0.0), (1.5, 0.1, 0.0), (3.0, 0.0, -1.0), (4.2, 1.0, 0.0), (3.0, 0.0, 0.0), (4.0, 2.5, 0.0)]
    assert distances_along(flown, path) == pytest.approx([0.0, 1.5, 3.0, 5.0, 5.0, 6.5])
    assert distances_along(path, []) == [0.0, 4.0, 8.0]
    assert distances_along([], path) == []


def test_timelines_tell_each_component_s_states(reader: LogReader, tmp_path: Path) -> None:
    timelines = {timeline.component: timeline for timeline in read_timelines(reader)}
    assert list(timelines) == ["pose", "server", "camera"]
    bars = [(bar.state, bar.start_s, bar.end_s) for bar in timelines["camera"].bars]
    assert bars == [
        (Health.IDLE, 0.0, 0.2),
        (Health.WORKING, 0.2, 2.0),
        (Health.FAULTY, 2.0, 3.0),
        (Health.WORKING, 3.0, 8.0),
        (Health.ABSENT, 8.0, 8.0),
    ]
    assert timelines["camera"].errors_s == [2.0]
    file = tmp_path / "components.svg"
    plot_timelines(list(timelines.values()), file)
    text = file.read_text()
    for part in ("camera-faulty", "camera-errors", "server-quiet", "pose-working"):
        assert f'id="{part}"' in text
    with pytest.raises(Refused, match="no component"):
        plot_timelines([], file)


def test_fields_are_found_by_name_index_or_structure(reader: LogReader, tmp_path: Path) -> None:
    assert [s.name for s in read_series(reader, "pose", ["position_ned_m[2]", "quality"])] == [
        "position_ned_m[2]",
        "quality",
    ]
    series = read_series(reader, "pose", ["position_ned_m"])
    assert [one.name for one in series] == [f"position_ned_m[{axis}]" for axis in range(3)]
    assert series[0].t_s[:2] == [0.0, 0.1]
    file = tmp_path / "pose.svg"
    plot_series(series, file, "pelican/pose")
    assert 'id="position_ned_m[2]"' in file.read_text()
    with pytest.raises(Refused, match="did you mean 'quality'"):
        read_series(reader, "pose", ["qualty"])
