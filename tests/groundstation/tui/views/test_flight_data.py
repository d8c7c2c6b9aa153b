"""Flight data, read as text: horizon, values with units, and charts that stand still while little changes."""

from math import nan, sin

import numpy as np
import pytest
from msgspec.structs import replace
from tests.groundstation.mapping.test_track_history import Followed

from gloc3_groundstation.mapping.history import HistorySeries
from gloc3_groundstation.mapping.tracks import TrackChannel
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.charts import (
    ChartWindow,
    Curve,
    Scale,
    chart_lines,
    duration,
    round_scale,
    window_at,
)
from gloc3_groundstation.tui.views.flight_data import (
    CHARTS,
    EIGHTHS,
    VEHICLE,
    attitude_lines,
    attitude_title,
    charts,
    charts_title,
    horizon_lines,
    shown_charts,
)
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, text_of


def texts(lines: list[Line]) -> list[str]:
    return [text_of(line) for line in lines]


def flown(seconds: float = 60.0) -> Followed:
    here = Followed()
    for n in range(int(seconds * 4)):
        t_s = n * 0.25
        here.move(
            t_s,
            attitude_cdeg=(round(500 * sin(t_s)), -300, round(35900 + 10 * n) % 36000),
            position_cm=(10 * n, -5 * n, 200 + round(50 * sin(t_s / 5.0))),
            setpoint_cm=(10 * n + 20, -5 * n, 200),
            setpoint_heading_cdeg=(35900 + 10 * n) % 36000,
            covariance_cm2=(900, 0, 400),
            height_std_cm=15,
        )
    return here


def view_of(here: Followed, now_s: float) -> StationView:
    return StationView(here.fleet, here.fleet.get("heron"), now_s, 0.0, "255", tracks=here.tracks)


def ground(lines: list[Line]) -> list[float]:
    """How high the ground reaches in each column, in lines from below; the vehicle's own cells are left out."""
    rows = [text_of(line) for line in lines]
    return [
        sum(EIGHTHS.find(row[column]) / 8.0 for row in rows if row[column] in EIGHTHS) for column in range(len(rows[0]))
    ]


def test_level_flight_has_the_ground_in_the_lower_half() -> None:
    found = ground(horizon_lines(0.0, 0.0, 20, 8))
    assert found[0] == found[-1] == 4.0


def test_the_nose_up_sinks_the_horizon_and_a_roll_to_the_right_lifts_it_on_the_left_hand_side() -> None:
    assert ground(horizon_lines(0.0, 10.0, 20, 8))[0] == pytest.approx(2.0)
    assert ground(horizon_lines(0.0, -10.0, 20, 8))[0] == pytest.approx(6.0)
    rolled = ground(horizon_lines(20.0, 0.0, 20, 8))
    assert rolled[0] < 4.0 < rolled[-1]
    assert ground(horizon_lines(0.0, 90.0, 20, 8))[0] == 0.0


def test_near_level_nothing_jumps_beside_the_vehicle() -> None:
    middle = {
        horizon_lines(roll, pitch, 21, 7)[3][1:-1] for roll in (-0.5, 0.0, 0.5) for pitch in (-2.0, -0.1, 0.0, 0.1)
    }
    assert middle == {(Span(VEHICLE, Tone.STRONG),)}


def test_upside_down_the_ground_is_above() -> None:
    rows = texts(horizon_lines(180.0, 0.0, 20, 8))
    assert rows[0] == "█" * 20
    assert rows[-1] == " " * 20
    assert len(horizon_lines(90.0, 45.0, 20, 8)) == 8


def test_an_old_attitude_looks_old() -> None:
    assert {span.tone for line in horizon_lines(5.0, 2.0, 20, 7, is_stale=True) for span in line} == {Tone.STALE}


def test_the_values_of_now_have_units_and_what_they_should_be() -> None:
    here = flown()
    track = here.track
    text = "\n".join(texts(attitude_lines(view_of(here, 60.0), track, 31, 20)))
    for expected in (
        "pitch -3.0°",
        "wanted 2.00",
        "heading 23°",
        " m/s",
        "± x, y  0.60 m  height 0.30 m",
        "14.80 V  12.1 A",
    ):
        assert expected in text
    here.move(60.0, attitude_cdeg=(0, 0, 35970))
    assert "heading 0°" in "\n".join(texts(attitude_lines(view_of(here, 60.0), track, 31, 20)))
    assert attitude_title(view_of(here, 60.0), track) == "heron"
    assert attitude_title(view_of(here, 75.0), track) == "heron, 15 s ago"
    previous = attitude_lines(view_of(here, 75.0), track, 31, 20)
    assert Tone.STRONG not in {span.tone for line in previous for span in line}


def test_what_is_not_known_is_said_to_be_so() -> None:
    here = Followed()
    assert "no data" in text_of(attitude_lines(view_of(here, 0.0), None, 30, 20)[0])
    assert "no data" in text_of(charts(None, 0.0, 0.0, 60.0, 0, 60, 20)[0])
    here.move(0.0, battery_cv=0, setpoint_cm=None)
    text = "\n".join(texts(charts(here.track, 1.0, 1.0, 60.0, 0, 60, 60)))
    assert "wanted ?" in text


@pytest.mark.parametrize(("width", "height", "count"), [(48, 21, 4), (80, 33, 6), (160, 55, 10), (48, 5, 1)])
def test_as_many_charts_are_shown_as_there_is_room_for(width: int, height: int, count: int) -> None:
    assert shown_charts(width, height) == count
    lines = texts(charts(flown().track, 60.0, 60.0, 60.0, 0, width, height))
    assert len(lines) <= height
    assert all(len(line) <= width for line in lines)
    names = [row.name for row in CHARTS[:count]]
    assert all(any(name in line for line in lines) for name in names)


def test_a_chart_shows_the_line_the_edges_and_the_newest_values() -> None:
    lines = texts(charts(flown().track, 60.0, 60.0, 60.0, 0, 60, 6))
    assert lines[0].startswith("height  m")
    assert lines[0].endswith("wanted 2.00 ")
    assert lines[1].startswith("   3.0 ┤")
    assert lines[4].startswith("   1.0 ┤") or lines[4].startswith("   1.5 ┤")
    assert lines[-1].split() == ["-1", "min", "-30", "s", "now"]


def test_a_heading_that_passes_north_is_one_line() -> None:
    lines = texts(charts(flown().track, 60.0, 60.0, 60.0, 2, 60, 6))
    labels = [line[:6].strip() for line in lines if "┤" in line]
    assert labels[-1] in ("350", "355")
    assert float(labels[0]) < 40.0
    column = [line[8:] for line in lines[1:-1]]
    assert all(any(row[at] != " " for row in column) for at in range(1, 50))


def test_a_direction_all_round_goes_from_north_to_north() -> None:
    here = Followed()
    for n in range(100):
        here.move(n * 0.25, attitude_cdeg=(0, 0, 360 * n % 36000))
    labels = [line[:6].strip() for line in texts(charts(here.track, 25.0, 25.0, 30.0, 2, 60, 6)) if "┤" in line]
    assert labels[0] == "360"
    assert labels[-1] == "0"


def test_between_two_steps_of_the_window_nothing_changes() -> None:
    track = flown().track
    one = charts(track, 50.02, 50.02, 60.0, 0, 68, 21)
    assert charts(track, 50.9, 50.9, 60.0, 0, 68, 21) == one
    assert charts(track, 51.1, 51.1, 60.0, 0, 68, 21) != one
    assert window_at(50.02, 60.0, 60) == ChartWindow(-9.0, 51.0)


@pytest.mark.parametrize(
    ("low", "high", "least", "scale"),
    [
        (0.0, 3.1, 1.0, Scale(0.0, 4.0, 0)),
        (2.0, 2.0, 1.0, Scale(1.5, 2.5, 1)),
        (-12.0, 9.0, 1.0, Scale(-20.0, 10.0, 0)),
        (14.61, 14.83, 0.1, Scale(14.6, 14.9, 1)),
    ],
)
def test_the_edges_are_round(low: float, high: float, least: float, scale: Scale) -> None:
    found = round_scale(low, high, least)
    assert found.decimals == scale.decimals
    assert (found.low, found.high) == pytest.approx((scale.low, scale.high))


def test_a_range_of_values_is_drawn_from_its_lowest_to_its_highest() -> None:
    series = HistorySeries(np.array([5.0]), np.array([2.0], np.float32), np.array([8.0], np.float32), 1.0)
    lines = chart_lines((), [Curve("", series, Tone.GOOD)], ChartWindow(0.0, 10.0), Scale(0.0, 10.0, 0), 18, 11)
    filled = [any("\u2801" <= letter <= "\u28ff" for letter in text_of(line)) for line in lines[1:]]
    assert filled[2:8] == [True] * 6
    assert not any((filled[0], filled[9]))


def test_a_gap_in_the_values_is_a_gap_in_the_line() -> None:
    values = np.array([1.0, 1.0, nan, 1.0, 1.0], np.float32)
    series = HistorySeries(np.array([0.0, 2.0, 5.0, 8.0, 10.0]), values, values, 0.0)
    row = next(
        text_of(line)
        for line in chart_lines((), [Curve("", series, Tone.GOOD)], ChartWindow(0, 10), Scale(0.0, 2.0, 0), 28, 4)[1:]
        if any(letter > "\u2800" for letter in text_of(line))
    )
    assert row[8 + 1] != " "
    assert row[8 + 10] == " "
    assert row[8 + 18] != " "


@pytest.mark.parametrize(
    ("seconds", "text"), [(45.0, "45 s"), (59.7, "1 min"), (150.0, "2.5 min"), (1800.0, "30 min"), (28800.0, "8 h")]
)
def test_times_are_short(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_the_title_says_that_charts_are_frozen_and_since_when() -> None:
    assert charts_title(None, 100.0, 100.0, 600.0, is_frozen=False) == "last 10 min"
    assert charts_title(None, 70.0, 100.0, 60.0, is_frozen=True) == "1 min, FROZEN 30 s ago"


def test_values_of_a_vehicle_that_is_silent_are_not_shown_as_those_of_now() -> None:
    track = flown().track
    assert track.latest_s is not None
    now_s = track.latest_s + 14.0
    assert charts_title(track, now_s, now_s, 60.0, is_frozen=False) == "last 1 min, no data for 14 s"
    previous, live = (charts(track, at_s, at_s, 60.0, 0, 60, 20)[0] for at_s in (now_s, track.latest_s))
    assert "was" in text_of(previous)
    assert {span.tone for span in previous} <= {Tone.STRONG, Tone.DIM, Tone.STALE, Tone.TEXT}
    assert "was" not in text_of(live)
    assert Tone.STALE not in {span.tone for span in live}


def test_a_vehicle_without_charge_says_so() -> None:
    here = Followed()
    here.move(0.0)
    assert here.fleet.platforms["heron"].vehicle is None
    text = "\n".join(texts(attitude_lines(view_of(here, 0.0), here.track, 31, 20)))
    assert "battery ? %  14.80 V" in text
    fleet = replace(here.fleet, platforms={})
    assert attitude_title(StationView(fleet, None, 0.0, 0.0, "255"), None) == "flight data"
    assert np.isnan(here.track.latest[TrackChannel.BATTERY_PERCENT])
