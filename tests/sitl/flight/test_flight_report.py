"""The report of a flight: its figures come from the true positions and the path that was requested."""

import itertools
import math

import msgspec
import pytest

from gloc3.evaluation.requested_path import RequestedFlight
from gloc3.messages.frames import Vector3
from gloc3_sitl.flight.path_error import TruthSample
from gloc3_sitl.flight.report import FlightReport, as_json, as_lines, judge

WAY: list[Vector3] = [(0.0, 0.0, -2.0), (10.0, 0.0, -2.0), (10.0, 5.0, -2.0)]
SPEED_M_S = 0.5


def fly(points: list[Vector3], begin_s: float, speed_m_s: float = SPEED_M_S) -> list[TruthSample]:
    """Positions at 10 Hz along straight lines."""
    samples, t_s = [], begin_s
    for a, b in itertools.pairwise(points):
        steps = round(math.dist(a, b) / speed_m_s * 10)
        for step in range(steps):
            n, e, d = (p + (q - p) * step / steps for p, q in zip(a, b, strict=True))
            samples.append(TruthSample(t_s, (n, e, d)))
            t_s += 0.1
    return [*samples, TruthSample(t_s, points[-1])]


def requested(begin_s: float, end_s: float | None, way: list[Vector3] = WAY) -> RequestedFlight:
    return RequestedFlight("sweep.wall", begin_s, list(way), SPEED_M_S, end_s)


def blank() -> FlightReport:
    return FlightReport(mission="m", mission_state="done", platform="pelican", autopilot="px4", seed=1)


def test_a_good_flight_has_good_figures() -> None:
    report, samples = blank(), fly(WAY, 10.0)
    judge(report, samples, [requested(10.0, 40.0)])
    assert report.path_rms_error_m == pytest.approx(0.0, abs=1e-6)
    assert (report.waypoints, report.waypoints_passed) == (2, 2)
    assert report.slowest_leg_share == pytest.approx(1.0, abs=0.02)
    assert report.distance_m == pytest.approx(15.0, abs=0.01)


def test_only_what_was_flown_while_the_action_ran_is_judged() -> None:
    report = blank()
    away = fly([(0.0, -30.0, -2.0), (0.0, 0.0, -2.0)], 0.0, 3.0)
    samples = [*away[:-1], *fly(WAY, 10.0), *fly([WAY[-1], (40.0, 5.0, -2.0)], 40.1, 3.0)]
    judge(report, samples, [requested(10.0, 40.0)])
    assert report.path_max_error_m is not None
    assert report.path_max_error_m < 0.01


def test_the_heights_of_waypoints_do_not_count_where_a_distance_to_the_ground_is_kept() -> None:
    report, hill = blank(), [(n, e, d - 0.3 * n) for n, e, d in WAY]
    way = msgspec.structs.replace(requested(0.0, None), is_height_kept=True)
    judge(report, fly(hill, 0.0), [way])
    assert report.path_max_error_m == pytest.approx(0.0, abs=1e-6)
    assert report.waypoints_passed == 2


def test_an_action_that_never_ended_is_judged_by_what_was_flown_of_it() -> None:
    report = blank()
    judge(report, fly(WAY[:2], 0.0), [requested(0.0, None)])
    assert (report.waypoints, report.waypoints_passed) == (2, 1)


def test_the_errors_of_several_flights_are_taken_together() -> None:
    report = blank()
    second: list[Vector3] = [WAY[-1], (0.0, 5.0, -2.0)]
    # the way is taken from where the flight began: the error grows along the leg, from 0 to 0.4 m
    beside: list[Vector3] = [(n, e + 0.4, d) for n, e, d in second]
    judge(report, [*fly(WAY, 0.0), *fly(beside, 100.0)], [requested(0.0, 50.0), requested(100.0, 150.0, second)])
    assert report.path_max_error_m == pytest.approx(0.4, abs=0.02)
    assert report.path_rms_error_m == pytest.approx(math.sqrt(0.4**2 / 3 * 201 / 502), abs=0.005)
    assert (report.waypoints, report.waypoints_passed) == (3, 2)


def test_a_slow_leg_shows() -> None:
    report = blank()
    judge(report, [*fly(WAY[:2], 0.0)[:-1], *fly(WAY[1:], 20.0, 0.3)], [requested(0.0, 60.0)])
    assert report.slowest_leg_share == pytest.approx(0.6, abs=0.02)
    assert any("slowest leg at 6" in line for line in as_lines(report))


def test_without_waypoints_there_are_no_figures_of_a_path() -> None:
    report = blank()
    judge(report, fly(WAY, 0.0), [])
    assert report.path_rms_error_m is None
    assert report.slowest_leg_share is None
    assert not any("path" in line for line in as_lines(report))


def test_the_report_is_json_with_every_field() -> None:
    found = msgspec.json.decode(as_json(blank()))
    assert list(found) == list(FlightReport.__struct_fields__)


def test_a_mission_that_failed_says_why() -> None:
    report = blank()
    report.mission_state, report.reason = "failed", "sweep.wall: too late"
    assert as_lines(report)[0] == "m: failed (sweep.wall: too late)"


def test_what_the_flight_took_is_told_beside_the_estimate_or_its_range() -> None:
    report = blank()
    report.mission_time_s, report.distance_m, report.energy_wh = 66.0, 60.0, 2.2
    report.estimate = {"mission_time_s": 60.0, "distance_m": 50.0, "energy_wh": 2.2}
    assert "  estimate 60 s (+10 %), 50 m (+20 %), 2.2 Wh (+0 %)" in as_lines(report)
    report.estimate = {"mission_time_s": 100.0, "distance_m": 50.0, "energy_wh": 4.0}
    report.estimate_least = {"mission_time_s": 40.0, "distance_m": 20.0, "energy_wh": 2.75}
    assert "  estimate 40 to 100 s (within), 20 to 50 m (+20 %), 2.8 to 4.0 Wh (-20 %)" in as_lines(report)


@pytest.mark.parametrize(("std_m", "told"), [(None, 0), (0.07, 0), (1.94, 1)])
def test_an_uncertain_position_is_told_in_the_report(std_m: float | None, told: int) -> None:
    report = FlightReport(
        mission="dive", mission_state="done", platform="auv", autopilot="ardupilot", seed=1, position_std_m=std_m
    )
    assert len([line for line in as_lines(report) if "known to 1.9 m at the end" in line]) == told
