"""A soak: missions one after another in one boot, with what comes and goes in a day, while the process is measured."""

import asyncio
import gc
import os
import sys
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import msgspec
import numpy as np

from gloc3.clock import VirtualLoop, run_virtual
from gloc3.errors import Gloc3Error
from gloc3.mavlink.codec import Encoder, MavlinkMessage, message
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import CiEvent
from gloc3.mission.examples import find_mission
from gloc3.platform.reader import load_platform
from gloc3_groundstation.desk import flights
from gloc3_onboard.command_server.report_store import MOST_KEPT, SPARE, ReportStore
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.flight.flight import DEVICES, Flight
from gloc3_sitl.flight.mission_file import read_mission_file
from gloc3_sitl.flight.plan import FlightPlan

HOUR_S: Final = 3600.0
PATIENCE: Final = 3.0
"""A mission may take so many times its estimate, and two minutes."""
LANDED_WITHIN_S: Final = 120.0
REST_S: Final = 5.0
"""Between two missions, on the ground, with a fresh battery."""
SAMPLE_EVERY_S: Final = 300.0
"""The process is measured between two missions, at most so often."""
KEPT_LOGS_BYTES: Final = 50_000_000
DISTURBED_AFTER_S: Final = 8.0
"""So long after the start of a mission something comes or goes."""
AWAY_S: Final = 3.0
"""So long it lasts: a lost link is back before a mission takes it for lost."""
GUESTS: Final = 100
"""Other people's stations have system ids from 100 to 199, one after another."""
REQUESTS: Final[tuple[tuple[str, dict[str, Any]], ...]] = (
    ("PARAM_REQUEST_LIST", {}),
    ("MISSION_REQUEST_LIST", {}),
    ("LOG_REQUEST_LIST", {"end": 0xFFFF}),
    ("COMMAND_LONG", {"command": 512, "param1": 148.0}),
)
"""What they ask of the autopilot and of the onboard computer: parameters, plans, logs, the version."""


class Course(msgspec.Struct, frozen=True, kw_only=True):
    """What is flown, again and again."""

    mission: str
    platform: str
    autopilot: str = ""
    """Empty for the usual one of the vehicle."""
    parameters: dict[str, float] = {}
    """Of the autopilot, as the platform file wants them."""

    def __str__(self) -> str:
        return f"{self.mission} on {self.platform}" + (f" ({self.autopilot})" if self.autopilot else "")


class Sample(msgspec.Struct, frozen=True):
    """The process between two missions, after a garbage collection."""

    t_s: float
    """Virtual time."""
    resident_mb: float
    objects: int
    """Objects that the garbage collector traces."""
    blocks: int
    """Blocks of memory that Python holds."""
    handles: int
    """Open files and sockets."""
    threads: int


class Soaked(msgspec.Struct, kw_only=True):
    """The result of a soak."""

    samples: list[Sample] = []
    ends: dict[str, int] = {}
    """How many missions ended in which state."""
    problems: list[str] = []
    """Of missions that were not done: the first reasons."""
    cpu_s: float = 0.0

    @property
    def hours(self) -> float:
        """Virtual hours soaked."""
        return self.samples[-1].t_s / HOUR_S if self.samples else 0.0


def slope_per_h(samples: Sequence[Sample], name: str, after_h: float) -> float:
    """The growth of one quantity per virtual hour, by least squares over the samples after a warm-up."""
    counted = [one for one in samples if one.t_s >= after_h * HOUR_S]
    if len(counted) < 3:
        return float("nan")
    hours = np.array([one.t_s / HOUR_S for one in counted])
    values = np.array([float(getattr(one, name)) for one in counted])
    return float(np.polyfit(hours, values, 1)[0])


def measure(t_s: float) -> Sample:
    """Measures this process."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return Sample(
        t_s,
        pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        len(gc.get_objects()),
        sys.getallocatedblocks(),
        sum(1 for _ in Path("/proc/self/fd").iterdir()),
        threading.active_count(),
    )


def soak(
    course: Course,
    hours: float,
    report: Callable[[Soaked], None] = lambda _: None,
    after_mission: Callable[[Flight], None] = lambda _: None,
    every_s: float = SAMPLE_EVERY_S,
    seed: int = 0,
) -> Soaked:
    """Flies missions one after another in one process and one boot.

    Args:
        course: what is flown.
        hours: of virtual time, at least.
        report: is given what there is after each sample.
        after_mission: is called on the ground after each mission.
        every_s: the least time between two samples.
        seed: of the flight.
    """
    with TemporaryDirectory() as folder:
        return run_virtual(_Soak(course, Path(folder), report, after_mission, every_s).run(hours * HOUR_S, seed))


class _Soak:
    """One soak."""

    def __init__(
        self,
        course: Course,
        out: Path,
        report: Callable[[Soaked], None],
        after_mission: Callable[[Flight], None],
        every_s: float,
    ) -> None:
        self._every_s = every_s
        self._course, self._out, self._report, self._after_mission = course, out, report, after_mission
        self._soaked: Final = Soaked(samples=[], ends=Counter(), problems=[])
        self._comings: Final = (
            self._nothing,
            self._loss_of_the_station_link,
            self._another_station_of_ours,
            self._pause,
            self._guest,
            self._crash,
            self._cable_loss,
        )
        self._flown = 0

    async def run(self, until_s: float, seed: int) -> Soaked:
        """Flies until this time."""
        course, out = self._course, self._out
        platform = load_platform(course.platform, is_loading_classes=True, devices=DEVICES)
        mission = read_mission_file(find_mission(course.mission), platform, out)
        plan = FlightPlan(
            mission=mission.file,
            platform=course.platform,
            autopilot=course.autopilot,
            home=mission.home,
            parameters=course.parameters,
            seed=seed,
            out=out,
        )
        begin_s = os.times().user
        flight = Flight(plan)
        _fill(flight)
        async with flight:
            self._guest_end = flight.process.add_radio().a
            self._guest_end.on_data = lambda _: None
            self._measure(flight)
            while flight.loop.time() < until_s:
                await self._mission(flight, PATIENCE * mission.duration_s + 120.0)
                self._tidy(flight)
                self._after_mission(flight)
                self._soaked.cpu_s = os.times().user - begin_s
                self._measure(flight)
        return self._soaked

    def _measure(self, flight: Flight) -> None:
        now_s, samples = flight.loop.time(), self._soaked.samples
        if not samples or now_s >= samples[-1].t_s + self._every_s:
            samples.append(measure(now_s))
            self._report(self._soaked)

    async def _mission(self, flight: Flight, within_s: float) -> None:
        """One mission to its end, the vehicle on the ground, and charged again."""
        disturb = self._comings[self._flown % len(self._comings)]
        self._flown += 1
        state, reason = "not started", ""
        try:
            follower = await flight.upload_and_start()
            state = "not ended"
            await disturb(flight)
            end = await flight.await_end(follower, within_s)
            state, reason = end.state, end.reason
            async with asyncio.timeout(LANDED_WITHIN_S):
                await flights.until(flight.station, lambda: not self._is_armed(flight))
        except (Gloc3Error, TimeoutError) as error:
            state, reason = state if state != "done" else "not landed", str(error) or type(error).__name__
        self._soaked.ends[state] += 1
        if state != "done" and len(self._soaked.problems) < 5:
            self._soaked.problems.append(f"mission {self._flown}, {disturb.__name__.strip('_')}: {state}: {reason}")
        flight.simulator.sensors.battery.remaining = 1.0
        await asyncio.sleep(REST_S)

    @staticmethod
    def _is_armed(flight: Flight) -> bool:
        platform = flight.station.fleet.get(flight.name)
        return platform is None or platform.vehicle is None or platform.vehicle.value.is_armed

    def _tidy(self, flight: Flight) -> None:
        """What the simulation notes in memory is not kept; the log goes on in a new file, and the oldest are deleted."""
        flight.truth.samples.clear()
        flight.simulator.autopilot.logger.erase()
        flight.log.cut()
        logs = sorted(self._out.glob("log*.mcap"), key=lambda path: path.stat().st_mtime_ns)
        total = sum(path.stat().st_size for path in logs)
        for path in logs[:-1]:
            if total > KEPT_LOGS_BYTES:
                total -= path.stat().st_size
                path.unlink()
        if isinstance(flight.loop, VirtualLoop) and flight.loop.failures:
            raise flight.loop.failures[0]

    # --- what comes and goes ---

    async def _nothing(self, flight: Flight) -> None:
        """A mission without a disturbance."""

    async def _loss_of_the_station_link(self, flight: Flight) -> None:
        await self._fault(flight, "link_loss", AWAY_S)

    async def _cable_loss(self, flight: Flight) -> None:
        await self._fault(flight, "cable_loss=0.3", AWAY_S)

    async def _crash(self, flight: Flight) -> None:
        """A sampler raises an error, and is initialized again."""
        await self._fault(flight, "crash:computer", None)

    @staticmethod
    async def _fault(flight: Flight, text: str, for_s: float | None) -> None:
        begin_s = flight.loop.time() + DISTURBED_AFTER_S
        span = f"@{begin_s}" if for_s is None else f"@{begin_s}..{begin_s + for_s}"
        schedule_faults(flight, (text + span,))

    async def _another_station_of_ours(self, flight: Flight) -> None:
        """The station is closed in flight and comes back as after its computer's restart."""
        await asyncio.sleep(DISTURBED_AFTER_S)
        await flight.ground.close()
        await asyncio.sleep(1.0)
        flight.start_station(self._flown)
        await flights.await_platform(flight.station, flight.name)

    async def _pause(self, flight: Flight) -> None:
        await asyncio.sleep(DISTURBED_AFTER_S)
        schedule_faults(flight, ("operator:pause",))
        await asyncio.sleep(AWAY_S)
        schedule_faults(flight, ("operator:resume",))

    async def _guest(self, flight: Flight) -> None:
        """Another program's station comes with an id of its own, asks for everything, and goes."""
        encoder = Encoder(100 + self._flown % GUESTS, 190)
        for _ in range(5):
            self._send(encoder, message("HEARTBEAT", type=6, autopilot=8))
            await asyncio.sleep(1.0)
        for component in (1, 191):
            for name, fields in REQUESTS:
                self._send(encoder, message(name, target_system=1, target_component=component, **fields))
                await asyncio.sleep(1.0)

    def _send(self, encoder: Encoder, asked: MavlinkMessage) -> None:
        self._guest_end.send(encoder.encode(asked))


def _fill(flight: Flight) -> None:
    """The store of events is full from the begin, as that of a vehicle that has flown before."""
    store = ReportStore(flight.process.storage.reports, 1)
    for number in range(MOST_KEPT + SPARE):
        store.add(
            CiEvent(severity=Severity.INFO, source="soak", text=f"of an earlier flight, number {number}", t_s=0.0)
        )
