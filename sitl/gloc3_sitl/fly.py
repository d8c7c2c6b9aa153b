"""Flies a mission in virtual time from start-up to report; what `gloc3 fly` runs."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from gloc3.ci import CiEvent, MissionSummary
from gloc3.clock import Clock
from gloc3.messages import Envelope
from gloc3.mission.checker import Circumstances, check_file
from gloc3.platform import load_platform
from gloc3.vehicle import AutopilotState, ImageRecorded
from gloc3_onboard.requested_path import RequestedPath
from gloc3_sitl.flight import Flight, FlightPlan
from gloc3_sitl.flight_report import FlightReport, as_json, judge
from gloc3_sitl.wind import CALM, Wind

PATIENCE: Final = 3.0
"""A mission that takes so many times its estimate, and a minute, is given up."""
SETTLE_S: Final = 1.0

Narrate = Callable[[str], None]


class FlyOptions(msgspec.Struct, frozen=True, kw_only=True):
    """What is flown, and how."""

    mission: str
    platform: str = "pelican"
    autopilot: str = "px4"
    seed: int = 0
    wind: Wind = CALM
    faults: tuple[str, ...] = ()
    out: Path | None = None


class _Watch:
    """Collects what the report tells, and narrates."""

    def __init__(self, flight: Flight, narrate: Narrate | None) -> None:
        self.report = FlightReport(
            mission=flight.mission.name,
            mission_state="waiting",
            platform=flight.name,
            autopilot=flight.plan.autopilot,
            seed=flight.plan.seed,
        )
        self.path = RequestedPath(flight.exchange, flight.name)
        self._narrate = narrate
        self._armed_s: float | None = None
        self._started_s: float | None = None
        subscribe, name = flight.exchange.subscribe, flight.name
        subscribe(f"{name}/ci/event", self._event)
        subscribe(f"{name}/ci/mission", self._mission)
        subscribe(f"{name}/autopilot", self._autopilot)
        subscribe(f"{name}/image_recorded", self._image)

    def _event(self, envelope: Envelope[CiEvent]) -> None:
        event = envelope.payload
        line = f"{event.t_s:8.2f} s  {event.source}: {event.text}"
        self.report.events.append(line.strip())
        if self._narrate is not None:
            self._narrate(line)

    def _mission(self, envelope: Envelope[MissionSummary]) -> None:
        mission = envelope.payload
        if mission.state == "running" and self._started_s is None:
            self._started_s = envelope.t_s
        if mission.state and self._started_s is not None:
            if mission.state != self.report.mission_state:
                self.report.mission_time_s = round(envelope.t_s - self._started_s, 3)
            self.report.mission_state, self.report.reason = mission.state, mission.reason
            self.report.tasks = dict(mission.tasks)

    def _autopilot(self, envelope: Envelope[AutopilotState]) -> None:
        state = envelope.payload
        if state.is_armed and self._armed_s is None:
            self._armed_s = envelope.t_s
        elif not state.is_armed and self._armed_s is not None:
            self.report.flight_time_s = round(self.report.flight_time_s + envelope.t_s - self._armed_s, 3)
            self._armed_s = None
        if state.battery_remaining >= 0.0:
            self.report.battery_remaining = round(state.battery_remaining, 3)

    def _image(self, envelope: Envelope[ImageRecorded]) -> None:
        self.report.images += 1


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
    check = check_file(options.mission, Circumstances(platform=load_platform(options.platform)))
    check.flyable()
    estimate_s = check.estimate.duration_s if check.estimate is not None else 600.0
    plan = FlightPlan(
        mission=options.mission,
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
        watch = _Watch(flight, narrate)
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
