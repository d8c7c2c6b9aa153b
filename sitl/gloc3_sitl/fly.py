"""Flies a mission in virtual time from start-up to report; what `gloc3 fly` runs."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import msgspec

from gloc3.clock import Clock
from gloc3.mission.checker import Circumstances, Report, check_file
from gloc3.platform import load_platform
from gloc3_onboard.requested_path import RequestedPath
from gloc3_sitl.earth import as_yaml
from gloc3_sitl.flight import Flight, FlightPlan
from gloc3_sitl.flight_report import FlightReport, as_json, judge
from gloc3_sitl.flight_watch import FlightWatch, Narrate
from gloc3_sitl.wind import CALM, Wind

PATIENCE: Final = 3.0
"""A mission that takes so many times its estimate, and a minute, is given up."""


class FlyOptions(msgspec.Struct, frozen=True, kw_only=True):
    """What is flown, and how."""

    mission: str
    platform: str = "pelican"
    autopilot: str = "px4"
    seed: int = 0
    wind: Wind = CALM
    faults: tuple[str, ...] = ()
    out: Path | None = None


async def fly_mission(options: FlyOptions, narrate: Narrate | None, begin_s: float) -> FlightReport:
    """Flies a mission to its end.

    Args:
        options: what is flown.
        narrate: takes a line for each thing that happens.
        begin_s: `Clock.cost_s()` at the start of the program, for the wall time in the report.

    Raises:
        InputError: the mission may not fly.
        Gloc3Error: the platform turned something down.
    """
    platform = load_platform(options.platform)
    with TemporaryDirectory() as scratch:
        name = as_yaml(options.mission, platform.limits.speed_m_s, options.out or Path(scratch))
        check = check_file(name, Circumstances(platform=platform))
        check.flyable()
        return await _fly_checked(options, name, check, narrate, begin_s)


async def _fly_checked(
    options: FlyOptions, name: str, check: Report, narrate: Narrate | None, begin_s: float
) -> FlightReport:
    estimate_s = check.estimate.duration_s if check.estimate is not None else 600.0
    plan = FlightPlan(
        mission=name,
        platform=options.platform,
        autopilot=options.autopilot,
        seed=options.seed,
        wind=options.wind,
        out=options.out,
    )
    async with Flight(plan) as flight:
        if options.faults:
            from gloc3_sitl.faults import schedule_faults

            schedule_faults(flight, options.faults)
        watch = FlightWatch(flight.exchange, flight.name, flight.mission.name, options.autopilot, options.seed, narrate)
        ready_s = Clock.cost_s()
        follower = await flight.upload_and_start()
        try:
            end = await flight.await_end(follower, within_s=PATIENCE * estimate_s + 60.0)
        except TimeoutError:
            watch.report.reason = f"not ended after {PATIENCE:g} times the estimate of {estimate_s:.0f} s"
            watch.report.mission_state = "failed"
        else:
            watch.report.mission_state, watch.report.reason = end.state, end.reason
        report = watch.report
        judge(report, flight.samples, watch.path.flights)
        if flight.recorder is not None:
            flight.recorder.write_requested_path(watch.path.points_ned_m)
        end_s, simulated_s = Clock.cost_s(), flight.loop.time()
    total_s = Clock.cost_s() - begin_s
    report.wall = {
        "total_s": round(total_s, 3),
        "setup_s": round(ready_s - begin_s, 3),
        "flight_s": round(end_s - ready_s, 3),
        "simulated_s": round(simulated_s, 3),
        "real_time_factor": round(simulated_s / total_s, 1),
    }
    if options.out is not None:
        _write(options.out, report, flight, watch.path)
    return report


def _write(out: Path, report: FlightReport, flight: Flight, path: RequestedPath) -> None:
    """The files beside the log."""
    from gloc3.log.plot import plot_path

    (out / "report.json").write_bytes(as_json(report))
    flown = [sample.position_ned_m for sample in flight.samples]
    home = flown[0] if flown else None
    plot_path(flown, path.points_ned_m, out / "path.svg", home=home, fence=flight.mission.fence, title=report.mission)
