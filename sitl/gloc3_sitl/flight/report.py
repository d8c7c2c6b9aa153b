"""The report of a simulated flight: result of the mission and path error."""

import itertools
import math
from collections.abc import Sequence

import msgspec

from gloc3.evaluation.requested_path import RequestedFlight
from gloc3.mission.checking.estimate import span
from gloc3.platform.limits import Limits
from gloc3_sitl.flight.path_error import PASSED_M, LegResult, PathResult, TruthSample, path_error

CERTAIN_M = 0.25
"""A smaller standard deviation is not mentioned in words."""


class FlightReport(msgspec.Struct, kw_only=True):
    """`report.json`: everything but `wall` is the same for the same seed."""

    mission: str
    mission_state: str
    reason: str = ""
    tasks: dict[str, str] = {}
    """Task, and `TASK.ACTION`, to its state."""
    platform: str
    autopilot: str
    seed: int
    flight_time_s: float = 0.0
    """From leaving the ground to the landing."""
    mission_time_s: float = 0.0
    """From the start of the mission to its end."""
    distance_m: float = 0.0
    """Way that was truly flown."""
    path_rms_error_m: float | None = None
    """Of the true positions, at 10 Hz while waypoints were followed; None where there were none."""
    path_max_error_m: float | None = None
    waypoints: int = 0
    waypoints_passed: int = 0
    """In their order, within `passed_within_m`."""
    passed_within_m: float = PASSED_M
    """So near a waypoint counts as passed."""
    slowest_leg_share: float | None = None
    """Lowest mean speed of a leg, as a share of the requested speed."""
    position_std_m: float | None = None
    """Horizontal standard deviation that the pose claimed when the mission ended; None where there was no valid pose."""
    images: int = 0
    battery_remaining: float | None = None
    energy_wh: float | None = None
    """Taken from the battery in the mission; None where the platform's file states no battery."""
    estimate: dict[str, float] = {}
    """Estimate of the check before the flight: `mission_time_s`, `distance_m`, and `energy_wh` with a power model."""
    estimate_least: dict[str, float] = {}
    """The same estimate where guards skip all they can and loops end early; empty where nothing is optional."""
    events: list[str] = []
    wall: dict[str, float] = {}
    """What the flight cost: seconds of wall time."""


def judge_within(
    limits: Limits, report: FlightReport, samples: Sequence[TruthSample], requested: Sequence[RequestedFlight]
) -> None:
    """Fills in the figures of the path, as near and in as many dimensions as the platform's limits have it."""
    if limits.survey_height_m == 0.0:  # it stays on the ground or on the water, and is lifted by that
        samples = _level(samples)
    judge(report, samples, requested, max(PASSED_M, limits.survey_acceptance_m))


def judge(
    report: FlightReport, samples: Sequence[TruthSample], requested: Sequence[RequestedFlight], near_m: float = PASSED_M
) -> list[PathResult]:
    """Fills in the figures of the path; returns those of each flight along waypoints."""
    report.passed_within_m = near_m
    results: list[PathResult] = []
    for flight in requested:
        end_s = math.inf if flight.end_s is None else flight.end_s
        flown = [sample for sample in samples if flight.start_s <= sample.t_s <= end_s]
        if flown:
            points = flight.polyline_ned_m[1:]
            if flight.is_height_kept:
                flown, points = _level(flown), [(north, east, 0.0) for north, east, _ in points]
            polyline = [flown[0].position_ned_m, *points]
            results.append(path_error(flown, polyline, near_m))
    count = sum(result.samples for result in results)
    if count:
        square = sum(result.rms_m**2 * result.samples for result in results)
        report.path_rms_error_m = round(math.sqrt(square / count), 4)
        report.path_max_error_m = round(max(result.max_m for result in results), 4)
        report.waypoints = sum(len(result.legs) for result in results)
        report.waypoints_passed = sum(result.passed for result in results)
        shares = [
            leg.mean_speed_m_s / flight.speed_m_s
            for flight, result in zip(requested, results, strict=False)
            for leg in _long(result.legs)
        ]
        report.slowest_leg_share = round(min(shares), 4) if shares else None
    report.distance_m = round(_distance_m(samples), 2)
    return results


def _level(samples: Sequence[TruthSample]) -> list[TruthSample]:
    """The samples without their heights."""
    return [TruthSample(one.t_s, (one.position_ned_m[0], one.position_ned_m[1], 0.0)) for one in samples]


def _long(legs: Sequence[LegResult]) -> list[LegResult]:
    """The legs that are long enough to have a mean speed."""
    return [leg for leg in legs if leg.length_m >= 0.5]


def _distance_m(samples: Sequence[TruthSample]) -> float:
    return sum(math.dist(a.position_ned_m, b.position_ned_m) for a, b in itertools.pairwise(samples))


def _compared(report: FlightReport) -> list[str]:
    """Each estimated figure compared with the flight: its deviation, or that it was within the estimate."""
    found: list[str] = []
    for name, unit in (("mission_time_s", "s"), ("distance_m", "m"), ("energy_wh", "Wh")):
        most, was = report.estimate.get(name), getattr(report, name)
        if not most or was is None:
            continue
        least = report.estimate_least.get(name, most)
        nearest = max(least, min(most, was))
        off = (
            f"{100.0 * (was - nearest) / nearest:+.0f} %" if nearest and (was != nearest or least == most) else "within"
        )
        found.append(f"{span(least, most, 1 if unit == 'Wh' else 0)} {unit} ({off})")
    return found


def as_json(report: FlightReport) -> bytes:
    """The report as indented JSON."""
    return msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n"


def as_lines(report: FlightReport) -> list[str]:
    """Returns the report as readable text."""
    lines = [f"{report.mission}: {report.mission_state}" + (f" ({report.reason})" if report.reason else "")]
    lines.append(f"  flown    {report.flight_time_s:.1f} s, {report.distance_m:.1f} m")
    if report.path_rms_error_m is not None:
        lines.append(f"  path     RMS {report.path_rms_error_m:.3f} m, max {report.path_max_error_m:.3f} m")
        lines.append(
            f"  passed   {report.waypoints_passed} of {report.waypoints} waypoints in order within {report.passed_within_m:g} m"
        )
    if report.slowest_leg_share is not None:
        lines.append(f"  speed    slowest leg at {100.0 * report.slowest_leg_share:.0f} % of the requested speed")
    if report.position_std_m is not None and report.position_std_m > CERTAIN_M:
        lines.append(f"  position known to {report.position_std_m:.1f} m at the end (standard deviation, as claimed)")
    if report.estimate:
        lines.append("  estimate " + ", ".join(_compared(report)))
    if report.images:
        lines.append(f"  images   {report.images}")
    if "total_s" in report.wall:
        factor = report.wall.get("real_time_factor", 1.0)
        faster = f", {factor:.0f} times faster than real time" if factor > 1.0 else ""
        lines.append(f"  wall     {report.wall['total_s']:.1f} s{faster}")
    return lines
