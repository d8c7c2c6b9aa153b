"""A hundred whole vehicles and three stations on one virtual clock, and what each vehicle costs."""

import asyncio
import resource
import tempfile
import time
from pathlib import Path

import msgspec
from tests.flight.fleet_flight import FleetFlight

from gloc3.clock import VirtualLoop
from gloc3.platform.reader import whole_text
from gloc3_sitl.flight.plan import FlightPlan

SETTLE_S = 10.0


class Cost(msgspec.Struct):
    """What so many vehicles cost."""

    platforms: int
    components: int
    """Of each platform."""
    stations: int
    span_s: float
    """Virtual time that was measured."""
    cpu_s: float
    known: list[int]
    """By station: the platforms of which it knows everything, at the end."""
    memory_mb: float
    """Of the whole process, at most."""

    @property
    def per_platform_ms(self) -> float:
        """Milliseconds of processor time for each second of each platform's time."""
        return 1e3 * self.cpu_s / self.span_s / self.platforms


STANDBYS = """\
  - {name: hold_standby, class: "gloc3_onboard.components.controllers.hold:HoldController", rate_hz: 20, trigger: pose, begin: quiet, standby_for: hold, ports: {grant: motion/grant, setpoint_wanted: setpoint_wanted/hold, action_status: action_status/hold}}
  - {name: landing_standby, class: "gloc3_onboard.components.controllers.landing:LandingController", rate_hz: 10, begin: quiet, standby_for: landing, ports: {setpoint_wanted: setpoint_wanted/landing, manoeuvre_wanted: manoeuvre_wanted/landing, action_status: action_status/landing}}
"""
"""Two more components beside the 18 of the platform."""


async def _run(platforms: int, stations: int, span_s: float, file: Path) -> Cost:
    file.write_text(whole_text("pelican_rtk").rstrip("\n") + "\n" + STANDBYS)
    plans = [FlightPlan(mission="hop", platform=str(file), name=f"vehicle{n}", seed=n) for n in range(platforms)]
    async with FleetFlight(plans, stations) as fleet:
        await asyncio.sleep(SETTLE_S)
        began_s = time.process_time()
        await asyncio.sleep(span_s)
        cpu_s = time.process_time() - began_s
        known = [
            sum(not one.is_incomplete and not one.is_quiet_link(fleet.loop.time()) for one in ground.station.fleet)
            for ground in fleet.grounds
        ]
        first = next(iter(fleet.flights.values()))
        return Cost(
            platforms=platforms,
            components=len(first.platform.components),
            stations=stations,
            span_s=span_s,
            cpu_s=round(cpu_s, 2),
            known=known,
            memory_mb=round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0),
        )


def measure(platforms: int, stations: int, span_s: float) -> Cost:
    """Lets them stand on the ground, all components at work, and measures."""
    with tempfile.TemporaryDirectory() as name, asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(_run(platforms, stations, span_s, Path(name) / "pelican.yaml"))
