"""Flies a case in virtual time to its real end, and judges it."""

import asyncio
from collections.abc import Callable
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import msgspec

from gloc3.clock import VirtualLoop
from gloc3.component.workers import guard
from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3.messages.summaries import MissionSummary
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform
from gloc3.terrain import open_terrain
from gloc3_sitl.faults.fault_text import parse
from gloc3_sitl.faults.faults import Injection, read_fault
from gloc3_sitl.flight.flight import DEVICES, Flight
from gloc3_sitl.flight.mission_file import read_mission_file
from gloc3_sitl.flight.plan import FlightPlan
from gloc3_sitl.physics.wind import CALM, Wind, gusty
from gloc3_sitl.proof.branches import taken_branches
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.course import is_at_rest
from gloc3_sitl.proof.invariant import BrokenInvariant, Invariant, is_cut_off
from gloc3_sitl.proof.observer import Observer
from gloc3_sitl.proof.record import NoTraceback
from gloc3_sitl.proof.standard_invariants import all_invariants

START_WITHIN_S: Final = 150.0
PATIENCE: Final = 3.0
WAY_BACK_S: Final = 120.0
"""Beside three times its estimate and its policy's hold, a flight has so long to end."""
ALONE_S: Final = 600.0
"""So much longer lasts the flight of an autopilot without a companion, since only a low battery ends its hold.

In the first half the battery is emptied: by its own draw a rover's would last ten hours, and a boat's four days.
"""
SETTLED_S: Final = 4.0
"""A vehicle that stays disarmed for so long has ended its flight."""
UNTOLD_S: Final = 30.0
"""A mission of which nothing was told for so long does not run any more: its command server is lost."""
IN_HAND_S: Final = 60.0
"""A vehicle that a person has for so long, without a fault that begins or ends meanwhile, has ended its flight, too."""
POLL_PERIOD_S: Final = 0.2
AFTER_S: Final = 2.0
"""A flight goes on for so long after an invariant was broken, so that its log shows what follows."""


class TrialResult(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a flight."""

    case: FlightCase
    refused: str = ""
    """Why it could not be flown: the mission does not pass the check, a fault does not fit."""
    broken: tuple[BrokenInvariant, ...] = ()
    """The earliest first."""
    reached: tuple[str, ...] = ()
    state: str = ""
    """Of the mission, at the end."""
    reason: str = ""
    ended_s: float = 0.0
    """On the flight's clock."""
    started_s: float = 0.0
    """When the mission began to run; 0 where it never did."""
    phases: tuple[tuple[float, str], ...] = ()
    """When each action began: time and target."""
    changes_s: tuple[float, ...] = ()
    """When the mission's state, its policy or the autopilot's mode has changed."""
    story: tuple[str, ...] = ()
    """What happened, a line each."""
    processor_s: float = 0.0
    """What it has cost, where that was measured."""

    @property
    def is_done(self) -> bool:
        """Whether the mission was done."""
        return self.state == "done"


class Conditions(msgspec.Struct, frozen=True, kw_only=True):
    """What a case does not say of the surroundings."""

    wind: Wind
    terrain: Path | None = None
    """Folder of terrain tiles that the onboard process has; None for none."""
    parameters: dict[str, float] = {}
    """Of the autopilot, that differ from its defaults."""


def fly_case(
    case: FlightCase,
    *,
    out: Path | None = None,
    kinds: tuple[type[Invariant], ...] | None = None,
    is_stopping: bool = True,
    prepare: Callable[[Flight], None] | None = None,
    conditions: Conditions | None = None,
) -> TrialResult:
    """Flies a case and judges it.

    Args:
        case: what is flown.
        out: a folder for log, report and picture; None keeps nothing.
        kinds: the invariants; None for all that are installed.
        is_stopping: ends the flight soon after an invariant was broken.
        prepare: is given the flight before it begins.
        conditions: in place of the case's wind.

    Raises:
        Gloc3Error: there is no such platform or mission.
    """
    with TemporaryDirectory() as scratch:
        if conditions is None:
            conditions = Conditions(wind=gusty(case.wind_m_s, from_deg=270.0) if case.wind_m_s else CALM)
        trial = _Trial(case, conditions, Path(scratch), out, all_invariants() if kinds is None else kinds)
        trial.is_stopping, trial.prepare = is_stopping, prepare
        with taken_branches() as taken, asyncio.Runner(loop_factory=VirtualLoop) as runner:
            try:
                return runner.run(trial.fly(taken))
            except InputError as error:
                return TrialResult(case=case, refused=str(error).splitlines()[0])
            except Refused as error:
                return TrialResult(case=case, refused=str(error))


def fly_to_judge(case: FlightCase, kinds: tuple[type[Invariant], ...], out: Path | None = None) -> TrialResult:
    """Flies a case as `fly_case` does; an error in it breaks an invariant, too, and a case that is none is refused."""
    result, error = guard(lambda: fly_case(case, kinds=kinds, out=out))
    if result is not None:
        return result
    if isinstance(error, Gloc3Error):
        return TrialResult(case=case, refused=str(error).splitlines()[0])
    text = f"the flight ended with {type(error).__name__}: {error}"
    broken = BrokenInvariant(invariant=NoTraceback.name, t_s=0.0, text=text)
    return TrialResult(case=case, broken=(broken,) if NoTraceback in kinds else (), reason=text)


class _Trial:
    """One flight."""

    is_stopping = True
    prepare: Callable[[Flight], None] | None = None

    def __init__(
        self,
        case: FlightCase,
        conditions: Conditions,
        scratch: Path,
        out: Path | None,
        kinds: tuple[type[Invariant], ...],
    ) -> None:
        self._case, self._conditions, self._out, self._kinds = case, conditions, out, kinds
        self._platform_file, self._world_file = case.platform_file(scratch), case.world_file(scratch)
        self._platform: Platform = load_platform(self._platform_file, is_loading_classes=True, devices=DEVICES)
        self._mission = read_mission_file(
            case.file(scratch), self._platform, out or scratch, open_terrain(conditions.terrain), case.home
        )
        self._phases: list[tuple[float, str]] = []
        self._started_s = 0.0
        self._not_started = ""
        times = [t_s for fault in map(parse, case.faults) for t_s in (fault.begin_s, fault.end_s) if t_s is not None]
        self._last_fault_s = max((t_s for t_s in times if t_s < inf), default=0.0)

    async def fly(self, taken: set[str]) -> TrialResult:
        """Flies; `taken` fills with the branches of the executor meanwhile."""
        case, mission = self._case, self._mission
        plan = FlightPlan(
            mission=mission.file,
            platform=self._platform_file,
            autopilot=case.autopilot,
            seed=case.seed,
            wind=self._conditions.wind,
            waves_m=case.waves_m,
            current_m_s=case.current_m_s,
            world=self._world_file,
            home=mission.home,
            terrain=self._conditions.terrain,
            parameters=self._conditions.parameters,
            out=self._out,
        )
        faults = tuple(read_fault(text) for text in case.faults)
        async with Flight(plan) as flight:
            for fault in faults:
                Injection(flight, fault)
            if self.prepare is not None:
                self.prepare(flight)
            observer = Observer(flight, faults, self._kinds)
            flight.exchange.subscribe(
                f"{flight.name}/ci/mission", lambda envelope: self._note(envelope.payload, flight)
            )
            given_s = PATIENCE * mission.duration_s + flight.mission.policies.hold_s + WAY_BACK_S
            alone_s = ALONE_S if any(map(is_cut_off, faults)) else 0.0
            await self._to_the_end(flight, observer, given_s, alone_s)
            recorder = flight.log.recorder
            loop = flight.loop
            failures = [repr(one) for one in loop.failures] if isinstance(loop, VirtualLoop) else []
            lost = "" if recorder is None else recorder.problem
            if recorder is not None and recorder.lost and not lost:
                lost = f"{recorder.lost} messages were not recorded"
            if not (self.is_stopping and observer.broken):
                observer.end(given_s + alone_s, failures, lost)
            if recorder is not None:
                recorder.write_requested_path(observer.path.points_ned_m)
            if self._out is not None:
                _draw(self._out, flight, observer)
            return TrialResult(
                case=case,
                broken=tuple(observer.broken),
                reached=tuple(sorted(observer.reached.words | {f"branch {one}" for one in taken})),
                state=observer.mission_state,
                reason=observer.mission_reason or self._not_started,
                ended_s=round(flight.loop.time(), 3),
                started_s=self._started_s,
                phases=tuple(self._phases),
                changes_s=tuple(observer.changes_s),
                story=tuple(str(line) for line in observer.story),
            )

    def _note(self, summary: MissionSummary, flight: Flight) -> None:
        now_s = round(flight.loop.time(), 2)
        if summary.state == "running" and not self._started_s:
            self._started_s = now_s
        known = {target for _, target in self._phases}
        for target, state in summary.tasks.items():
            if state == "running" and "." in target and target not in known:
                self._phases.append((now_s, target))

    async def _to_the_end(self, flight: Flight, observer: Observer, given_s: float, alone_s: float) -> None:
        """Starts the mission and waits until the vehicle is at rest, whatever becomes of the mission.

        After the time that it is given, the battery is emptied in the first half of `alone_s`.
        """
        try:
            async with asyncio.timeout(START_WITHIN_S):
                await flight.upload_and_start()
        except Gloc3Error as error:
            self._not_started = f"not started: {error}"
        except TimeoutError:
            self._not_started = f"not started: not ready within {START_WITHIN_S:g} s"
        alone_from_s = flight.loop.time() + given_s
        end_s = alone_from_s + alone_s
        at_rest_s: float | None = None
        while flight.loop.time() < end_s:
            now_s = flight.loop.time()
            if now_s >= alone_from_s:
                battery = flight.simulator.sensors.battery
                battery.remaining = max(0.0, battery.remaining - 2.0 * POLL_PERIOD_S / alone_s)
            if self.is_stopping and observer.broken:
                await asyncio.sleep(AFTER_S)
                return
            settled_s = observer.settled_since_s
            if settled_s is not None and now_s - max(settled_s, self._last_fault_s) >= IN_HAND_S:
                return
            last = observer.last
            is_untold = now_s - observer.mission_reported_s > UNTOLD_S
            is_over = is_untold or observer.mission_state not in ("running", "")
            disarmed = last if last is not None and not last.is_armed else None
            if self._started_s:
                has_ended = is_over and disarmed is not None and is_at_rest(flight.platform, disarmed)
            else:
                has_ended = last is None or disarmed is not None
            is_waiting = observer.mission_state == "running" and disarmed is not None
            if has_ended:
                at_rest_s = now_s if at_rest_s is None else at_rest_s
                if now_s - at_rest_s >= SETTLED_S:
                    return
            elif not is_waiting:
                at_rest_s = None
            await asyncio.sleep(POLL_PERIOD_S)


def _draw(out: Path, flight: Flight, observer: Observer) -> None:
    """The picture beside the log."""
    from gloc3.log.report.plot import plot_path

    truth = flight.truth
    flown = [sample.position_ned_m for sample in truth.samples]
    plot_path(
        flown,
        observer.path.points_ned_m,
        out / "path.svg",
        home=flown[0] if flown else None,
        fence=flight.mission.fence,
        title=flight.mission.name,
    )
