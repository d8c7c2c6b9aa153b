"""Flies a mission in virtual time from start-up to report; what `gloc3 fly` runs."""

import asyncio
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import msgspec

from gloc3.clock import Clock
from gloc3.errors import Gloc3Error, Refused
from gloc3.mission.checking.estimate import MissionFigures
from gloc3.platform.platform import Platform
from gloc3.terrain import open_terrain
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.firmware.in_step import FirmwareInStep
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.mission_file import FlyableMission, read_mission_file
from gloc3_sitl.flight.plan import FlightPlan
from gloc3_sitl.flight.report import FlightReport, as_json, judge_within
from gloc3_sitl.flight.watch import FlightWatch, Narrate
from gloc3_sitl.physics.wind import CALM, Wind

START_WITHIN_S: Final = 300.0
"""Time for a platform to appear and become ready, s."""
PATIENCE: Final = 3.0
"""Multiple of the estimated duration (plus a minute) after which a mission is aborted."""


class FlyOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a flight in virtual time."""

    mission: Path
    """A file of any format."""
    platform: str = "pelican_rtk"
    autopilot: str = ""
    """`px4` or `ardupilot`; empty for the usual one of the vehicle."""
    is_firmware: bool = False
    """Whether the real firmware of that name replaces the embedded autopilot."""
    seed: int = 0
    wind: Wind = CALM
    waves_m: float = 0.0
    current_m_s: float = 0.0
    faults: tuple[str, ...] = ()
    world: str = ""
    """A world's name or file; where it is empty, the one that the mission's frame belongs to."""
    terrain: Path | None = None
    """Folder of terrain tiles that the onboard process has; None for none."""
    out: Path | None = None
    """A folder that is there; None keeps nothing."""


async def fly_mission(options: FlyOptions, platform: Platform, narrate: Narrate | None, begin_s: float) -> FlightReport:
    """Flies a mission to its end, successful or not.

    Args:
        options: mission, faults and output.
        platform: the platform file.
        narrate: called with a line for each event.
        begin_s: `Clock.cost_s()` at the start of the program, for the wall time in the report.

    Raises:
        InputError: the mission may not fly.
        Refused: a fault does not fit the flight, or the results cannot be written.
    """
    with TemporaryDirectory() as scratch:
        mission = read_mission_file(
            options.mission, platform, options.out or Path(scratch), open_terrain(options.terrain)
        )
        if narrate is not None:
            for warning in mission.warnings:
                narrate(str(warning))
        return await _fly(options, mission, narrate, begin_s)


async def _fly(options: FlyOptions, mission: FlyableMission, narrate: Narrate | None, begin_s: float) -> FlightReport:
    plan = FlightPlan(
        mission=mission.file,
        platform=options.platform,
        autopilot=options.autopilot,
        is_firmware=options.is_firmware,
        seed=options.seed,
        wind=options.wind,
        waves_m=options.waves_m,
        current_m_s=options.current_m_s,
        world=options.world,
        home=mission.home,
        terrain=options.terrain,
        out=options.out,
    )
    async with Flight(plan) as flight:
        schedule_faults(flight, options.faults)
        power = flight.platform.power
        watch = FlightWatch(
            flight.exchange,
            flight.name,
            mission.mission.name,
            flight.autopilot,
            options.seed,
            narrate,
            power.battery_wh if power is not None else 0.0,
        )
        watch.path.on_change = flight.log.show_path
        report = watch.report
        if mission.estimate is not None:
            report.estimate = _figures(mission.estimate)
            report.estimate_least = _figures(mission.estimate.least) if mission.estimate.least is not None else {}
        ready_s = Clock.cost_s()
        report.mission_state, report.reason = await _to_the_end(flight, mission.duration_s)
        if isinstance(flight.simulator, FirmwareInStep) and flight.simulator.problem:
            report.mission_state, report.reason = "failed", flight.simulator.problem
        watch.land(flight.loop.time())
        judge_within(flight.platform.limits, report, flight.truth.samples, watch.path.flights)
        if flight.log.recorder is not None:
            flight.log.recorder.write_requested_path(watch.path.points_ned_m)
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
        try:
            _write(options.out, report, flight, watch)
        except OSError as error:
            raise Refused(f"the folder {options.out} cannot be written: {error.strerror or error}") from error
        if flight.log.recorder is not None and flight.log.recorder.problem:
            raise Refused(f"{options.out}: {flight.log.recorder.problem}")
    return report


def _figures(estimate: MissionFigures) -> dict[str, float]:
    """The figures of the check, by the names of the report's own."""
    found = {"mission_time_s": round(estimate.duration_s, 1), "distance_m": round(estimate.length_m, 1)}
    return found | ({"energy_wh": round(estimate.energy_wh, 2)} if estimate.energy_wh else {})


async def _to_the_end(flight: Flight, estimate_s: float) -> tuple[str, str]:
    """Starts the mission and follows it; its state at the end, and the reason."""
    try:
        async with asyncio.timeout(START_WITHIN_S):
            follower = await flight.upload_and_start()
    except Gloc3Error as error:
        return "failed", f"not started: {error}"
    except TimeoutError:
        return "failed", f"not started: {flight.name} was not ready within {START_WITHIN_S:g} s"
    try:
        end = await flight.await_end(follower, within_s=PATIENCE * estimate_s + 60.0)
    except TimeoutError:
        return "failed", f"not ended within {PATIENCE:g} times the estimate of {estimate_s:.0f} s plus 60 s"
    return end.state, end.reason


def _write(out: Path, report: FlightReport, flight: Flight, watch: FlightWatch) -> None:
    """The files beside the log; a real firmware keeps its own."""
    from gloc3.log.report.plot import plot_path

    logs = [] if isinstance(flight.simulator, FirmwareInStep) else flight.simulator.autopilot.logger.logs
    for log in logs:
        (out / log.name).write_bytes(log.data)
    (out / "report.json").write_bytes(as_json(report))
    flown = [sample.position_ned_m for sample in flight.truth.samples]
    home = flown[0] if flown else None
    plot_path(
        flown, watch.path.points_ned_m, out / "path.svg", home=home, fence=flight.mission.fence, title=report.mission
    )
