"""The last way down: lands the vehicle when the components that should do so have failed for good.

It is no component, so that no component's failure takes it along: it needs the process, and the autopilot's link.
"""

import asyncio
from collections.abc import Callable
from math import dist, inf
from typing import Final, Protocol

from gloc3.component.settings import load_settings
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.frames import Vector3
from gloc3.messages.summaries import Summary
from gloc3.messages.vehicle import AutopilotState, DriverState, FlightMode, LandedState, Manoeuvre, ManoeuvreKind
from gloc3.platform.platform import Platform
from gloc3_onboard.components.drivers.manoeuvres import (
    Arm,
    AutopilotCommand,
    Climb,
    Disarm,
    DriverSettings,
    ManoeuvreMachine,
    RestMeter,
    SetMode,
    StartMission,
)
from gloc3_onboard.sensors.devices import AutopilotBehaviour, CommandAnswer, Stamped

PERIOD_S: Final = 0.5
LEADERLESS_S: Final = 60.0
"""A vehicle in the air without a working command interface is landed after this time; meanwhile it holds."""
LOW_BATTERY_S: Final = 5.0
"""The same with a battery below the platform's reserve."""
DRIVER_SILENT_S: Final = 15.0
"""A driver that has not reported for this time, in which it is started several times, carries out no landing."""
REQUESTED_S: Final = 5.0
"""The command interface repeats its request for a landing within this time, as long as it stands."""
STALE_S: Final = 1.0
AIRBORNE: Final = (LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING)
COMES_DOWN: Final = (FlightMode.LAND, FlightMode.RETURN)
FLOWN_BY_HAND: Final = (FlightMode.MANUAL, FlightMode.OTHER)
DRIVER: Final = "autopilot_driver"


class LandingDevice(Protocol):
    """The part of an autopilot's device that a landing needs."""

    @property
    def behaviour(self) -> AutopilotBehaviour:
        """How the connected autopilot is commanded."""

    def state(self) -> AutopilotState:
        """Mode, arming, battery."""

    def pose(self) -> Stamped | None:
        """The autopilot's latest estimate; None before the first."""

    def command_mode(self, mode: FlightMode) -> int:
        """Requests a mode."""

    def command_disarm(self) -> int:
        """Requests disarming."""

    def answer(self, ticket: int) -> CommandAnswer | None:
        """The answer to a command; None while there is none."""


class LandingWatch:
    """Decides when the vehicle has to be landed without its components, and how. A pure machine.

    Args:
        device: the autopilot.
        settings: of the autopilot driver.
        reserve: battery level below which the vehicle lands at once, 0 to 1.
        report: receives events.
        now_s: the time.
    """

    def __init__(
        self,
        device: LandingDevice,
        settings: DriverSettings,
        reserve: float,
        report: Callable[[Severity, str], None],
        now_s: float,
    ) -> None:
        self._device, self._reserve, self._report = device, reserve, report
        self._settings = settings
        self._machine: ManoeuvreMachine | None = None
        self._rest = RestMeter(settings)
        self._led_s = now_s
        """When the command interface worked last."""
        self._driver: DriverState | None = None
        self._driver_s = self._requested_s = -inf
        self._home_ned_m: Vector3 | None = None
        """Where it was armed, in the autopilot's frame."""
        self._was_reached = False
        """Whether the autopilot has been seen in our landing."""
        self._is_taken_over = False
        """Whether another party has ended our landing; nothing is commanded until the vehicle is disarmed."""

    def led(self, now_s: float) -> None:
        """The command interface works."""
        self._led_s = now_s

    def driven(self, driver: DriverState, now_s: float) -> None:
        """The driver has reported its state."""
        self._driver, self._driver_s = driver, now_s

    def requested(self, kind: ManoeuvreKind, now_s: float) -> None:
        """The command interface has requested the autopilot's own landing, or a hold that breaks it off."""
        if kind is ManoeuvreKind.LAND:
            self._requested_s = now_s
            return
        self._requested_s = -inf
        if now_s - self._driver_s > STALE_S and not self._is_flown_by_hand(self._device.state(), now_s):
            self._machine, self._was_reached = None, False
            self._device.command_mode(FlightMode.HOLD)

    def tick(self, now_s: float) -> None:
        """Begins, continues or ends the landing."""
        state, pose = self._device.state(), self._device.pose()
        young = pose if pose is not None and now_s - pose.t_s <= STALE_S else None
        if not state.is_armed:
            self._home_ned_m = self._home_ned_m if young is None else young.pose.position_ned_m
            self._machine, self._was_reached, self._is_taken_over = None, False, False
            return
        reason = self._reason(state, now_s)
        if not reason:
            self._machine = None
            return
        if self._machine is None or not self._machine.is_running:
            self._begin(reason, young, now_s)
        self._advance(state, young, now_s)

    def _reason(self, state: AutopilotState, now_s: float) -> str:
        """Why the vehicle is to be landed; empty where it is not."""
        has_come_down = state.mode in COMES_DOWN or state.mode_name in self._device.behaviour.lands_into
        self._is_taken_over |= self._was_reached and not has_come_down
        is_airborne = state.is_connected and state.landed in AIRBORNE
        is_begun = self._machine is not None and state.is_connected
        if not (is_airborne or is_begun) or self._is_taken_over or self._is_flown_by_hand(state, now_s):
            return ""
        comes_down = state.mode in COMES_DOWN and self._device.behaviour.disarms_itself
        if comes_down and self._machine is None:
            return ""
        alone_s = now_s - self._led_s
        is_low = 0.0 <= state.battery_remaining < self._reserve
        if alone_s >= LEADERLESS_S or (is_low and alone_s >= LOW_BATTERY_S):
            battery = ", the battery is low" if is_low else ""
            return f"no command interface for {alone_s:.0f} s{battery}"
        is_driven = now_s - self._driver_s <= DRIVER_SILENT_S
        if now_s - self._requested_s <= REQUESTED_S and not is_driven:
            return "no driver carries out the landing"
        return ""

    def _is_flown_by_hand(self, state: AutopilotState, now_s: float) -> bool:
        """Whether a pilot with a transmitter has the vehicle."""
        if not state.has_transmitter:
            return False
        driver = self._driver if now_s - self._driver_s <= STALE_S else None
        is_pilots = driver is not None and driver.has_pilot_control and not driver.is_failsafe
        return is_pilots or state.mode in FLOWN_BY_HAND

    def _begin(self, reason: str, pose: Stamped | None, now_s: float) -> None:
        if self._machine is None:
            self._report(Severity.CRITICAL, f"{reason}: the autopilot is commanded to land")
        self._machine = ManoeuvreMachine(self._settings)
        behaviour = self._device.behaviour
        self._machine.begin(Manoeuvre(action_id="", kind=ManoeuvreKind.LAND), now_s, behaviour, self._away_m(pose))
        if behaviour.floats:
            self._rest.begin_to_rise()

    def _advance(self, state: AutopilotState, pose: Stamped | None, now_s: float) -> None:
        machine = self._machine
        assert machine is not None
        machine.away_m = self._away_m(pose)
        velocity = None if pose is None else pose.pose.velocity_ned_m_s
        rested_s = self._rest.update(velocity, now_s, floats=self._device.behaviour.floats)
        answer = self._device.answer(machine.ticket) if machine.ticket else None
        for command in machine.advance(now_s, state, answer, rested_s):
            machine.ticket = self._command(command)
        self._was_reached |= state.mode in COMES_DOWN

    def _command(self, command: AutopilotCommand) -> int:
        match command:
            case SetMode(mode=mode):
                return self._device.command_mode(mode)
            case Disarm():
                return self._device.command_disarm()
            case Arm() | Climb() | StartMission():
                raise AssertionError("a landing neither arms nor climbs")

    def _away_m(self, pose: Stamped | None) -> float | None:
        if pose is None or self._home_ned_m is None:
            return None
        return dist(pose.pose.position_ned_m[:2], self._home_ned_m[:2])


class LandingWatchdog:
    """Runs the watch in the process of the autopilot's link.

    Args:
        exchange: the platform's middleware.
        platform: the platform file.
        device: the autopilot.
        loop: the process's loop.
        report: receives events.
    """

    def __init__(
        self,
        exchange: Exchange,
        platform: Platform,
        device: LandingDevice,
        loop: asyncio.AbstractEventLoop,
        report: Callable[[Severity, str], None],
    ) -> None:
        row = next((row for row in platform.components if row.name == DRIVER), None)
        settings = DriverSettings() if row is None else load_settings(DriverSettings, row.settings, DRIVER)
        reserve = 0.0 if platform.power is None else platform.power.reserve
        self._loop = loop
        self._watch = LandingWatch(device, settings, reserve, report, loop.time())
        name = platform.platform
        self._unsubscribes = [
            exchange.subscribe(f"{name}/ci/summary", self._receive_summary),
            exchange.subscribe(f"{name}/driver", self._receive_driver),
            exchange.subscribe(f"{name}/direct_landing", self._receive_request),
        ]
        self._timer = loop.call_later(PERIOD_S, self._tick)

    def close(self) -> None:
        """Stops watching."""
        self._timer.cancel()
        for unsubscribe in self._unsubscribes:
            unsubscribe()

    def _receive_summary(self, envelope: Envelope[Summary]) -> None:
        self._watch.led(envelope.t_s)

    def _receive_driver(self, envelope: Envelope[DriverState]) -> None:
        self._watch.driven(envelope.payload, envelope.t_s)

    def _receive_request(self, envelope: Envelope[Manoeuvre]) -> None:
        self._watch.requested(envelope.payload.kind, envelope.t_s)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(PERIOD_S, self._tick)
        self._watch.tick(self._loop.time())
