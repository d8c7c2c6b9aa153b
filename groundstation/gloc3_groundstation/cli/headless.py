"""The station without a screen: sends a mission, starts it, narrates on stderr; stdout is data."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from typing import Final, Never

from gloc3.errors import Gloc3Error, NoContact
from gloc3.exchange.base import Unsubscribe
from gloc3.messages.envelope import Severity
from gloc3_groundstation.cli.script import ScriptCommand
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.flights import End, FarAway
from gloc3_groundstation.desk.vehicle_commands import VehicleCommand, VehicleCommands
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.reporting.lines import CommandData, NarrationLine, OrderData, ResultData
from gloc3_groundstation.reporting.narration import ChangeNarrator
from gloc3_groundstation.reporting.outcomes import RunOutcome, outcome_of
from gloc3_groundstation.shared_missions.assigning import assigned
from gloc3_groundstation.shared_missions.shared_flight import CrewOptions, Replacement, SharedFlight
from gloc3_groundstation.station.snapshots import Fleet
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.station.wording import duration

PROGRESS_EVERY_S: Final = 5.0
PATIENT_PROGRESS_EVERY_S: Final = 30.0
"""The same while a platform is silent."""
POLL_PERIOD_S: Final = 1.0
CATCH_UP_S: Final = 30.0
"""Time for which a run continues after its end to receive events from the time out of contact."""

NO_CREW: Final = CrewOptions()

Report = Callable[[NarrationLine], None]


class Headless:
    """One run of the station for scripts."""

    def __init__(
        self,
        station: Station,
        report: Report,
        *,
        platform: str | None = None,
        crew: CrewOptions = NO_CREW,
        is_taking_over: bool = False,
    ) -> None:
        """Creates a run.

        Args:
            station: receives from and commands the platforms.
            report: called with each line of narration.
            platform: the one to command; None for the first one received.
            crew: the vehicles for a mission with tasks for any platform.
            is_taking_over: takes control from another station without asking it.
        """
        self.is_taking_over: Final = is_taking_over
        self._station = station
        self._report = report
        self._platform, self._crew = platform, crew
        self._narrator = ChangeNarrator(station.now_s(), station.fleet.utc_offset_s)
        self._reported: dict[str, tuple[bool, bool, float]] = {}
        """Platform to whether it was silent and overdue at its last progress line, and when that was."""
        self._loop = asyncio.get_running_loop()
        self._unlisten: Unsubscribe = lambda: None
        self._timer: asyncio.TimerHandle | None = None
        self._commands: list[ScriptCommand] = []
        self._flying: tuple[Sequence[str], float] | None = None
        """The platforms whose mission has been started, and when."""
        self._waiting: list[asyncio.TimerHandle] = []
        """The commands whose time has not come."""
        self._sent: set[asyncio.Task[None]] = set()
        self._ordered: set[str] = set()
        """The vehicles that get the orders."""

    def command(self, command: ScriptCommand) -> None:
        """Has a command sent at its time after the start of the mission; at once where that is over."""
        self._commands.append(command)
        self._send_due()

    async def fly(
        self, plan: CheckedPlan, wait_s: float, override: str = "", author: str = "", *, is_far_ok: bool = False
    ) -> End:
        """Flies a mission to its end.

        Args:
            plan: the mission, checked.
            wait_s: how long to wait for contact with the platform, and then for it to be ready.
            override: reason to start although checks have failed; empty to refuse then.
            author: author of the override.
            is_far_ok: whether its first waypoint may be kilometres from the vehicle.

        Raises:
            Gloc3Error: the platform is not in contact, or refused a request.
        """
        station = self._station
        self._begin()
        try:
            names = await self._contacts(plan, wait_s)
            for name in names:
                missing = await flights.await_ready(station, name, max(wait_s, flights.READY_WITHIN_S))
                if missing:
                    self.narrate(f"{name} still lacks {', '.join(missing)}; the vehicle decides whether it starts")
            if self.is_taking_over:
                for name in names:
                    await flights.take_over(station, name)
            if plan.unassigned:
                plan, found = assigned(station, plan, names, self._crew.files)
                names = list(plan.platforms)
                for share in found.shares:
                    self.narrate(f"assigned to {share}")
            shared = SharedFlight(station, plan, self._crew.files)
            try:
                await flights.stream_to_all(station, names, plan, is_far_ok=is_far_ok)
            except FarAway as refusal:
                raise FarAway(f"{refusal}; --far-away-ok uploads it all the same") from None
            began_s = station.now_s()
            followers = await flights.start_all(station, names, override, author, wait_s)
            self._flying = names, station.now_s()
            self._send_due()
            if shared.is_shared:
                shared.begin(followers)
                end = await shared.follow(self._decide)
            else:
                end = await flights.follow_all(station, followers)
            used = duration(station.now_s() - began_s)
            await self._catch_up(names)
            reason = f" ({end.reason})" if end.reason else ""
            data = ResultData(mission=plan.title, state=end.state, reason=end.reason)
            landed = f"; {end.by} has landed the vehicle" if end.by else ""
            text = f"{plan.title!r}: {end.state}{reason} after {used}{landed}"
            whose = names[0] if len(names) == 1 else ""
            self._report(self._narrator.line(whose, "result", text, station.now_s(), data))
            return end
        finally:
            self.close()

    async def _contacts(self, plan: CheckedPlan, wait_s: float) -> list[str]:
        """Waits for contact with the platforms of a mission."""
        station, named = self._station, flights.addressed(plan, self._platform)
        if plan.unassigned:
            named = tuple(dict.fromkeys([*plan.platforms, *self._crew.names]))
        if not named:
            async with self._within(wait_s, ""):
                return await flights.await_platforms(station)
        return [await self._found(wait_s, one or "", flights.await_platform(station, one)) for one in named]

    async def _decide(self, _: Replacement) -> bool:
        """Whether the tasks of a vehicle that has dropped out go to the others; the events say which."""
        if not self._crew.is_reassigning:
            self.narrate("the others go on without these tasks; --reassign assigns them", Severity.WARNING)
        return self._crew.is_reassigning

    async def do(
        self,
        commands: VehicleCommands,
        vehicles: Sequence[str],
        orders: Sequence[VehicleCommand],
        wait_s: float,
        within_s: float,
    ) -> RunOutcome:
        """Commands vehicles at the same time; each gets one command after the other, up to the first that is not done.

        Args:
            commands: carries them out.
            vehicles: names or MAVLink systems; `all` for every vehicle that is heard.
            orders: the commands.
            wait_s: how long to wait for contact with a vehicle, and for it to be ready, s.
            within_s: the time for each command to be done, s.

        Returns:
            The first outcome, in the order of the vehicles, that is not done.
        """
        self._begin()
        try:
            if "all" in vehicles:
                await self._found(wait_s, "", flights.await_vehicle(self._station, None))
                vehicles = await flights.settled_vehicles(self._station)
            outcomes = await asyncio.gather(
                *(self._do(commands, vehicle, orders, wait_s, within_s) for vehicle in vehicles)
            )
            return next((outcome for outcome in outcomes if outcome is not RunOutcome.DONE), RunOutcome.DONE)
        finally:
            self.close()

    async def _do(
        self,
        commands: VehicleCommands,
        vehicle: str,
        orders: Sequence[VehicleCommand],
        wait_s: float,
        within_s: float,
    ) -> RunOutcome:
        """Commands one vehicle, once by whichever names; what fails is a line of it, and its outcome."""
        name = vehicle
        for number, order in enumerate(orders):
            outcome, text = RunOutcome.DONE, ""
            try:
                if not number:
                    name = await self._found(wait_s, vehicle, flights.await_vehicle(self._station, vehicle))
                    if name in self._ordered:
                        break  # it has another name or its system, too, on the command line
                    self._ordered.add(name)
                    await self._prepare(name)
                text = await commands.carry_out(name, order, ready_s=wait_s, within_s=within_s)
            except Gloc3Error as error:
                outcome, text = outcome_of(error), str(error)
            is_done = outcome is RunOutcome.DONE
            left = ", ".join(map(str, orders[number + 1 :])) if not is_done else ""
            shown = f"{order}: {outcome.replace('_', ' ')}: {text}" + (f"; not sent: {left}" if left else "")
            data = OrderData(command=str(order), outcome=outcome, reason="" if is_done else text)
            shown = shown if is_done else f"error: {shown}"
            self._report(self._narrator.line(name, "order", shown, self._station.now_s(), data))
            if not is_done:
                return outcome
        return RunOutcome.DONE

    async def _prepare(self, name: str) -> None:
        """Takes control of a vehicle where that was requested."""
        known = self._station.fleet.get(name)
        if self.is_taking_over and known is not None and known.has_companion:
            await flights.take_over(self._station, name)

    def _send_due(self) -> None:
        """Sets the time of each command, once there is a mission to command."""
        if self._flying is None:
            return
        names, started_s = self._flying
        for command in self._commands:
            wait_s = max(0.0, started_s + command.at_s - self._station.now_s())
            self._waiting.append(self._loop.call_later(wait_s, self._send, command, names))
        self._commands.clear()

    def _send(self, command: ScriptCommand, names: Sequence[str]) -> None:
        sent = self._loop.create_task(self._carry_out(command, names))
        self._sent.add(sent)
        sent.add_done_callback(self._sent.discard)

    async def _carry_out(self, command: ScriptCommand, names: Sequence[str]) -> None:
        """Sends a command to each platform that it concerns, and tells what became of it."""
        station = self._station
        for name in self._concerned(names, command.target):
            reason = ""
            try:
                await station.client.steer(name, command.verb, command.target)
            except Gloc3Error as error:
                reason = str(error)
            outcome = f"refused: {reason}" if reason else "accepted"
            data = CommandData(verb=command.verb, target=command.target, is_accepted=not reason, reason=reason)
            text = f"{'warning: ' if reason else ''}{command}: {outcome}"
            self._report(self._narrator.line(name, "command", text, station.now_s(), data))

    def _concerned(self, names: Sequence[str], target: str) -> Sequence[str]:
        """The platforms whose part of the mission has the target; all where it is the mission, or nobody's."""
        parts = {name: self._station.fleet.get(name) for name in names}
        having = [
            name for name, known in parts.items() if known and known.mission and target in known.mission.value.tasks
        ]
        return having or names

    async def _catch_up(self, names: Sequence[str]) -> None:
        """Waits for events from the time out of contact, where the end was received at a new contact."""
        station = self._station
        with suppress(TimeoutError):
            async with asyncio.timeout(CATCH_UP_S):
                await flights.until(
                    station, lambda: not any(station.feed.is_behind(name, station.now_s()) for name in names)
                )

    async def watch(self) -> Never:
        """Narrates until it is cancelled."""
        async with self.narrating():
            while True:
                await self._loop.create_future()

    @asynccontextmanager
    async def narrating(self) -> AsyncIterator[None]:
        """Narrates meanwhile."""
        self._begin()
        try:
            yield
        finally:
            self.close()

    def close(self) -> None:
        """Tells and commands nothing more."""
        self._unlisten()
        for waiting in self._waiting:
            waiting.cancel()
        for sent in self._sent:
            sent.cancel()
        if self._timer is not None:
            self._timer.cancel()

    def narrate(self, text: str, severity: Severity = Severity.INFO) -> None:
        """Tells something of the station's own."""
        self._report(self._narrator.remark(text, self._station.now_s(), severity))

    def _begin(self) -> None:
        """Reports the present state, and changes from now on."""
        self._changed(Fleet(), self._station.fleet, self._station.now_s())
        self._unlisten = self._station.listen(self._changed)
        self._report_progress()

    async def _found(self, wait_s: float, wanted: str, contact: Awaitable[str]) -> str:
        """Waits for contact with a platform."""
        async with self._within(wait_s, wanted):
            return await contact

    @asynccontextmanager
    async def _within(self, wait_s: float, wanted: str) -> AsyncIterator[None]:
        """The time for a contact, and what is said when it is over."""
        try:
            async with asyncio.timeout(wait_s):
                yield
        except TimeoutError:
            who = wanted or "a platform"
            others = ", ".join(platform.name for platform in self._station.fleet)
            hint = (
                f"heard: {others}; --platform names one"
                if others
                else "is it running, and does its link lead here? --link udpin://0.0.0.0:14550 hears a network"
            )
            raise NoContact(f"{who} did not respond within {duration(wait_s)}; {hint}") from None

    def _changed(self, before: Fleet, after: Fleet, now_s: float) -> None:
        for line in self._narrator.changes(before, after, now_s):
            self._report(line)

    def _report_progress(self) -> None:
        """Periodically prints a line for each platform in flight; less often for a silent one."""
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._report_progress)
        now_s = self._station.now_s()
        for platform in self._station.fleet:
            is_silent = platform.is_quiet_link(now_s)
            is_flying, is_overdue = platform.is_armed, platform.is_overdue(now_s)
            was_silent, was_overdue, reported_s = self._reported.get(platform.name, (False, False, float("-inf")))
            is_new = is_silent > was_silent or is_overdue > was_overdue
            period_s = PATIENT_PROGRESS_EVERY_S if is_silent and was_silent else PROGRESS_EVERY_S
            if (is_flying or is_silent) and (is_new or now_s - reported_s >= period_s):
                self._reported[platform.name] = is_silent, is_overdue, now_s
                self._report(self._narrator.progress(platform, now_s))
