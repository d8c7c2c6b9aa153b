"""The past of a vehicle: exact where it is fresh, true to its peaks where it is old, and never larger than it may be."""

from math import cos, nan, pi, sin

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.groundstation.scripted_platform import VEHICLE

from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.motion import MotionSummary, SiteSummary
from gloc3.messages.summaries import MissionSummary
from gloc3.messages.wire import type_name
from gloc3_groundstation.mapping.history import History, HistoryLevel, Ring
from gloc3_groundstation.mapping.tracks import FRESH, MOST, Track, TrackChannel, Tracks, Trail, thinned
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.snapshots import Fleet

pytestmark = pytest.mark.thorough

MOTION = MotionSummary(
    t_s=0.0,
    attitude_cdeg=(150, -250, 9000),
    position_cm=(0, 0, 0),
    velocity_cm_s=(300, 400, 50),
    is_pose_valid=True,
    setpoint_cm=(100, 0, 200),
    battery_cv=1480,
    battery_ca=1210,
)
TOPICS = {"MotionSummary": "motion", "VehicleSummary": "vehicle", "SiteSummary": "site", "MissionSummary": "mission"}


class Followed:
    """A fleet that is told things, and its tracks."""

    def __init__(self) -> None:
        self.fleet = Fleet()
        self.tracks = Tracks()
        self.sequence = 0

    def receive(self, message: Message, now_s: float, *, name: str = "heron", boot: int = 1) -> None:
        self.sequence += 1
        topic = f"{name}/ci/{TOPICS[type(message).__name__]}"
        source = Source(name, "command_server", boot)
        envelope = Envelope(topic, source, self.sequence, 0.0, "", type_name(type(message)), message)
        before, self.fleet = self.fleet, reducers.receive(self.fleet, envelope, now_s)
        self.tracks.follow(before, self.fleet, now_s)

    def move(self, now_s: float, t_s: float | None = None, **changes: object) -> None:
        self.receive(msgspec.structs.replace(MOTION, t_s=now_s if t_s is None else t_s, **changes), now_s)

    @property
    def track(self) -> Track:
        found = self.tracks.get("heron")
        assert found is not None
        return found


@settings(max_examples=30)
@given(st.integers(1, 40), st.integers(0, 300))
def test_a_ring_holds_the_last_rows_in_order(most: int, count: int) -> None:
    ring = Ring(2, most)
    for n in range(count):
        ring.append(float(n), np.array((n, -n), np.float32))
    assert ring.times_s.tolist() == list(range(count))[-most:]
    assert ring.rows[:, 1].tolist() == [-n for n in range(count)][-most:]


def test_a_peak_of_one_sample_is_still_there_hours_later() -> None:
    history = History(1, 100, (HistoryLevel(2.0, 200), HistoryLevel(30.0, 200)))
    for n in range(8000):
        history.append(n * 0.5, np.array((9.0 if n == 2000 else 1.0,), np.float32))
    fresh = history.series(0, 3980.0, 4000.0, 80)
    assert fresh.step_s == 0.0
    assert len(fresh.times_s) <= 44
    middle = history.series(0, 3700.0, 4000.0, 400)
    assert middle.step_s == 2.0
    previous = history.series(0, 0.0, 4000.0, 50)
    at = int(previous.highs.argmax())
    assert previous.highs[at] == 9.0
    assert previous.lows[at] == 1.0
    assert abs(previous.times_s[at] - 1000.0) <= 80.0
    assert len(previous.times_s) <= 52


def test_what_is_not_known_is_a_gap_and_time_never_runs_back() -> None:
    history = History(1, 10, ())
    for t_s, value in ((0.0, 1.0), (1.0, nan), (0.5, 7.0), (2.0, 3.0)):
        history.append(t_s, np.array((value,), np.float32))
    series = history.series(0, 0.0, 5.0, 100)
    assert series.times_s.tolist() == [0.0, 1.0, 2.0]
    assert np.isnan(series.lows).tolist() == [False, True, False]
    assert series.last == 3.0


def test_points_of_a_moving_window_do_not_change_while_it_moves() -> None:
    history = History(1, 5000, ())
    for n in range(4000):
        history.append(n * 0.25, np.array((sin(n / 9.0),), np.float32))
    one, other = history.series(0, 100.0, 700.0, 120), history.series(0, 103.0, 703.0, 120)
    shared = set(one.times_s.tolist()) & set(other.times_s.tolist())
    assert len(shared) > 110


def test_thinning_keeps_corners_and_stays_within_the_tolerance() -> None:
    way = [(float(n), 0.0, 2.0, float(n)) for n in range(50)] + [(49.0, float(n), 2.0, 50.0 + n) for n in range(50)]
    kept = thinned(np.array(way), 0.05)
    assert kept[:, :2].tolist() == [[0.0, 0.0], [49.0, 0.0], [49.0, 49.0]]
    circle = np.array([(cos(a), sin(a), 0.0, a) for a in np.linspace(0.0, 2.0 * pi, 500)])
    kept = thinned(circle, 0.02)
    assert 10 < len(kept) < 60
    angles = np.interp(circle[:, 3], kept[:, 3], np.arange(len(kept)))
    below = np.minimum(angles.astype(int), len(kept) - 2)
    share = (angles - below)[:, None]
    line = kept[below, :2] * (1.0 - share) + kept[below + 1, :2] * share
    assert np.hypot(*(circle[:, :2] - line).T).max() < 0.03


def test_thinning_never_joins_what_a_gap_parts() -> None:
    gap = [(nan, nan, nan, nan)]
    way = np.array(
        [*[(float(n), 0.0, 0.0, 0.0) for n in range(9)], *gap, *[(float(n), 5.0, 0.0, 0.0) for n in range(9)]]
    )
    kept = thinned(way, 1.0)
    assert np.isnan(kept[:, 0]).tolist() == [False, False, True, False, False]


def test_a_trail_of_eight_hours_stays_small_and_keeps_its_shape() -> None:
    trail = Trail()
    for n in range(20_000):
        angle, radius = n / 40.0, 20.0 + 10.0 * sin(n / 1000.0)
        trail.add(n * 0.5, (radius * cos(angle), radius * sin(angle), 2.0))
    assert len(trail) <= MOST + FRESH
    assert trail.tolerance_m < 5.0
    reach = np.hypot(trail.points[:, 0], trail.points[:, 1])
    assert reach.max() == pytest.approx(30.0, abs=0.1)


def test_a_vehicle_that_stands_adds_nothing() -> None:
    trail = Trail()
    for n in range(1000):
        trail.add(float(n), (1.0, 2.0, 0.001 * (n % 3)))
    assert len(trail) == 2
    assert trail.points[-1, 3] == 999.0


def test_motion_is_kept_in_metres_and_degrees() -> None:
    here = Followed()
    here.receive(VEHICLE, 0.0)
    here.move(10.0, position_cm=(1234, -50, 210))
    latest = here.track.latest
    assert latest[TrackChannel.X] == pytest.approx(12.34)
    assert latest[TrackChannel.SPEED] == pytest.approx(5.0)
    assert latest[TrackChannel.HEADING] == pytest.approx(90.0)
    assert latest[TrackChannel.WANTED_HEIGHT] == pytest.approx(2.0)
    assert latest[TrackChannel.BATTERY_PERCENT] == pytest.approx(97.0)
    assert latest[TrackChannel.BATTERY_V] == pytest.approx(14.8)
    assert np.isnan(latest[TrackChannel.WANTED_CLIMB])


def test_without_motion_the_vehicles_summary_stands_in() -> None:
    here = Followed()
    here.receive(msgspec.structs.replace(VEHICLE, position_m=(1.0, 2.0, 3.0)), 0.0)
    assert here.track.latest[TrackChannel.HEIGHT] == 3.0
    here.move(1.0)
    here.receive(msgspec.structs.replace(VEHICLE, position_m=(9.0, 9.0, 9.0)), 1.2)
    assert here.track.latest[TrackChannel.HEIGHT] == 0.0


def test_delays_of_the_link_do_not_shake_the_times() -> None:
    here = Followed()
    delays = (0.05, 0.4, 0.05, 0.3, 0.06, 0.05)
    for n, delay_s in enumerate(delays):
        here.move(100.0 + n + delay_s, t_s=float(n))
    times_s = here.track.history.samples.times_s
    assert np.diff(times_s) == pytest.approx([1.0] * 5, abs=0.01)


def test_silence_is_a_gap_of_trail_and_charts() -> None:
    here = Followed()
    for now_s in (0.0, 0.25, 10.0, 10.25):
        here.move(now_s, position_cm=(round(now_s * 100), 0, 0))
    assert np.isnan(here.track.trail.points[:, 0]).tolist() == [False, False, True, False, False]
    assert np.isnan(here.track.series(TrackChannel.X, 0.0, 20.0, 100).lows).tolist() == [
        False,
        False,
        True,
        False,
        False,
    ]


def test_an_invalid_position_is_a_gap() -> None:
    here = Followed()
    here.move(0.0)
    here.move(0.25, is_pose_valid=False)
    here.move(0.5, position_cm=(100, 0, 0))
    assert np.isnan(here.track.trail.points[:, 0]).tolist() == [False, True, False]
    assert here.track.latest[TrackChannel.ROLL] == 1.5


def test_a_heading_that_is_not_known_is_a_gap() -> None:
    here = Followed()
    here.receive(msgspec.structs.replace(VEHICLE, heading_deg=-1), 10.0)
    assert np.isnan(here.track.latest[TrackChannel.HEADING])


def test_another_frame_begins_another_track() -> None:
    here = Followed()
    here.receive(SiteSummary(frame="hold", x_axis_bearing_deg=0.0), 0.0)
    here.move(0.25)
    here.receive(SiteSummary(frame="hold", x_axis_bearing_deg=0.0), 2.0)
    assert len(here.track.trail) == 1
    here.receive(SiteSummary(frame="dock", x_axis_bearing_deg=30.0), 4.0)
    assert len(here.track.trail) == 0


def test_a_frame_that_is_raised_with_home_keeps_the_track() -> None:
    here = Followed()
    here.receive(SiteSummary(frame="", x_axis_bearing_deg=0.0, origin_geo=(47.0, 8.0, 500.0)), 0.0)
    here.move(0.25)
    here.receive(SiteSummary(frame="", x_axis_bearing_deg=0.0, origin_geo=(47.0, 8.0, 520.0)), 2.0)
    assert len(here.track.trail) == 1
    here.receive(SiteSummary(frame="", x_axis_bearing_deg=0.0, origin_geo=(47.1, 8.0, 520.0)), 4.0)
    assert len(here.track.trail) == 0


def test_the_begin_of_a_mission_is_remembered_and_a_pause_is_none() -> None:
    here = Followed()
    mission = MissionSummary(name="m", digest="d", state="waiting")
    for now_s, state in ((0.0, "waiting"), (5.0, "running"), (9.0, "paused"), (12.0, "running")):
        here.receive(msgspec.structs.replace(mission, state=state), now_s)
    assert here.track.started_s == 5.0


@pytest.mark.thorough
def test_eight_hours_of_ten_vehicles_take_little_memory_and_no_time_to_show() -> None:
    track = Track()
    rows = np.zeros((1, len(TrackChannel)), np.float32)
    for n in range(8 * 3600 * 4):
        t_s = n * 0.25
        rows[0, 0] = sin(t_s / 60.0)
        track.history.append(t_s, rows[0])
        track.trail.add(t_s, (30.0 * sin(t_s / 60.0), 20.0 * cos(t_s / 47.0), 3.0 + sin(t_s / 5.0)))
    assert 10 * track.bytes < 30_000_000
    day = track.series(TrackChannel.X, 0.0, 8 * 3600.0, 400)
    assert len(day.times_s) > 300
    assert day.highs.max() == pytest.approx(1.0, abs=0.01)
