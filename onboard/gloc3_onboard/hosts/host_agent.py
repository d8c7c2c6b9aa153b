"""Host agent, in a host's main process: starts and controls the child processes, reports presence and state."""

import os
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from gloc3.component.context import HostContext
from gloc3.exchange import Publisher
from gloc3.exchange.base import Unsubscribe
from gloc3.messages.hosts import HOSTS, HostStatus, ProcessLine
from gloc3.messages.readiness import SensorCondition
from gloc3.messages.software import own_software
from gloc3.platform.places import ProcessPlace, child_processes, clock_host, rows_at
from gloc3.platform.platform import Platform
from gloc3_onboard.hosts.child import ChildPhase, ChildProcess, Lives
from gloc3_onboard.hosts.pipe import ChildSetup
from gloc3_onboard.hosts.stand_in import ComponentPlaceholder

STATUS_S: Final = 1.0


class ClockState(NamedTuple):
    """A host's knowledge of the platform's time."""

    offset_s: float = 0.0
    bound_s: float = 0.0
    round_trip_s: float = 0.0
    age_s: float = 0.0


class HostAgent:
    """Manages the processes of one host.

    Args:
        platform: the platform.
        host: name of the host.
        context: context of the main process.
        order: makes a child's setup, from its name and the states to restore.
        report: called with each line of output.
        clock: returns the state of the platform's time.
        sensors: returns the conditions of the main process's sensors.
        log_problem: returns why the main process's log is not written any more; empty while it is.
        vehicle_boot_s: returns the platform's time of the autopilot's boot.
    """

    def __init__(
        self,
        platform: Platform,
        host: str,
        context: HostContext,
        order: Callable[[str, Lives | None], ChildSetup],
        report: Callable[[str], None],
        *,
        clock: Callable[[], ClockState] = ClockState,
        sensors: Callable[[], list[SensorCondition]] = list,
        log_problem: Callable[[], str] = str,
        vehicle_boot_s: Callable[[], float | None] = lambda: None,
    ) -> None:
        self._platform, self._host, self._context = platform, host, context
        self._clock, self._sensors, self._log_problem, self._vehicle_boot_s = (
            clock,
            sensors,
            log_problem,
            vehicle_boot_s,
        )
        self._topic = f"{platform.platform}/{HOSTS}/{host}"
        self._is_clock_host = clock_host(platform) == host
        self._publisher = Publisher(context.exchange, platform.platform, f"host_{host}", context.random.getrandbits(32))
        self.children: Final = [
            ChildProcess(
                name,
                rows_at(platform, ProcessPlace(host, name)),
                context,
                lambda lives, name=name: order(name, lives),  # type: ignore[misc] # each its own name
                report,
            )
            for name in child_processes(platform, host)
        ]
        self._timer = context.loop.call_later(STATUS_S, self._report)
        self._withdraw: Unsubscribe | None = None

    @property
    def placeholders(self) -> list[ComponentPlaceholder]:
        """The components of the child processes."""
        return [child.component(row.name) for child in self.children for row in child.rows]

    @property
    def is_beginning(self) -> bool:
        """Whether a child has not been there yet."""
        return any(child.phase is ChildPhase.BEGINNING and not child.restarts for child in self.children)

    def begin(self) -> None:
        """Declares the host alive, and starts its children."""
        self._withdraw = self._context.exchange.declare_alive(self._topic)
        for child in self.children:
            child.begin()
        self._send_setup()

    def give_up_beginning(self) -> None:
        """Waits for no child that is still beginning."""
        for child in self.children:
            child.give_up_beginning()

    async def end(self) -> None:
        """Ends the children, after their components have left."""
        for child in self.children:
            await child.end()
        self.close()

    def close(self) -> None:
        """Ends without ceremony."""
        self._timer.cancel()
        for child in self.children:
            child.close()
        if self._withdraw is not None:
            self._withdraw()

    def child_sensors(self) -> list[SensorCondition]:
        """How the sensors of the child processes are."""
        return [sensor for child in self.children for sensor in child.sensors]

    def log_problems(self) -> list[str]:
        """Why logs of children are not written any more, each in words."""
        return [f"{child.name}: {child.log_problem}" for child in self.children if child.log_problem]

    def pass_time_on(self, offset_s: float) -> None:
        """Tells the children how far the platform's time is from this computer's."""
        for child in self.children:
            child.send_offset(offset_s)

    def announce_renewal(self) -> None:
        """Announces a short absence of this host."""
        self._send_setup(is_renewing=True)

    def _report(self) -> None:
        self._timer = self._context.loop.call_later(STATUS_S, self._report)
        self._send_setup()

    def _send_setup(self, *, is_renewing: bool = False) -> None:
        clock = self._clock()
        status = HostStatus(
            host=self._host,
            is_clock_host=self._is_clock_host,
            processes=list(self._lines()),
            **own_software()._asdict(),
            clock_offset_s=clock.offset_s,
            clock_bound_s=clock.bound_s,
            clock_round_trip_s=clock.round_trip_s,
            clock_age_s=clock.age_s,
            load=round(os.getloadavg()[0] / (os.cpu_count() or 1), 2),
            vehicle_boot_s=self._vehicle_boot_s(),
            sensors=[*self._sensors(), *self.child_sensors()],
            is_renewing=is_renewing,
        )
        self._publisher.publish(self._topic, status, self._context.loop.time())

    def _lines(self) -> Iterator[ProcessLine]:
        mine = [row.name for row in rows_at(self._platform, ProcessPlace(self._host))]
        yield ProcessLine("", os.getpid(), ChildPhase.UP, mine, log_problem=self._log_problem())
        for child in self.children:
            yield ProcessLine(
                child.name,
                child.pid,
                child.phase,
                [row.name for row in child.rows],
                child.restarts,
                child.cause,
                child.log_problem,
            )
