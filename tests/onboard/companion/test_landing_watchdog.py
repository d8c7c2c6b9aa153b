"""The last way down: when it lands the vehicle, and when it leaves it alone."""

from collections.abc import Sequence

import pytest
from msgspec.structs import replace

from gloc3.messages.envelope import Severity
from gloc3.messages.vehicle import AutopilotPose, AutopilotState, DriverState, FlightMode, LandedState, ManoeuvreKind
from gloc3_onboard.companion.landing_watchdog import (
    DRIVER_SILENT_S,
    LEADERLESS_S,
    LOW_BATTERY_S,
    LandingWatch,
)
from gloc3_onboard.components.drivers.manoeuvres import COPTER, DriverSettings
from gloc3_onboard.sensors.devices import AutopilotBehaviour, CommandAnswer, Stamped

BOAT = AutopilotBehaviour(land_mode=FlightMode.HOLD, disarms_itself=False, at_rest_s=2.0, climbs=False)
PLANE = AutopilotBehaviour(returns_to_land=True)
FLYING = AutopilotState(is_connected=True, is_armed=True, mode=FlightMode.GUIDED, landed=LandedState.IN_AIR)


class Autopilot:
    """An autopilot that takes every mode at once."""

    def __init__(self, behaviour: AutopilotBehaviour) -> None:
        self.behaviour = behaviour
        self.now = FLYING
        self.place = (0.0, 0.0, -10.0)
        self.now_s = 0.0
        self.commands: list[str] = []
        self.is_obeying = True

    def state(self) -> AutopilotState:
        return self.now

    def pose(self) -> Stamped:
        still = AutopilotPose(
            position_ned_m=self.place,
            velocity_ned_m_s=(0.0, 0.0, 0.0),
            ned_from_frd=(1.0, 0.0, 0.0, 0.0),
            rate_frd_rad_s=(0.0, 0.0, 0.0),
        )
        return Stamped(self.now_s, still)

    def command_mode(self, mode: FlightMode) -> int:
        self.commands.append(str(mode))
        if self.is_obeying:
            self.now = replace(self.now, mode=mode)
        return len(self.commands)

    def command_disarm(self) -> int:
        self.commands.append("disarm")
        self.now = replace(self.now, is_armed=False, landed=LandedState.ON_GROUND)
        return len(self.commands)

    def answer(self, ticket: int) -> CommandAnswer | None:
        return CommandAnswer(True, "") if self.is_obeying else None


class Rig:
    """The watch, ticked twice a second."""

    def __init__(self, behaviour: AutopilotBehaviour = COPTER) -> None:
        self.autopilot = Autopilot(behaviour)
        self.told: list[str] = []
        self.watch = LandingWatch(
            self.autopilot, DriverSettings(), 0.2, lambda _severity, text: self.told.append(text), 0.0
        )
        self.now_s = 0.0
        self.driver: DriverState | None = DriverState()
        self.is_led = True
        self.is_requested = False

    def pass_s(self, seconds: float) -> Sequence[str]:
        """Lets time pass; what was commanded meanwhile."""
        before = len(self.autopilot.commands)
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            self.now_s += 0.5
            self.autopilot.now_s = self.now_s
            if self.is_led:
                self.watch.led(self.now_s)
            if self.driver is not None:
                self.watch.driven(self.driver, self.now_s)
            if self.is_requested:
                self.watch.requested(ManoeuvreKind.LAND, self.now_s)
            self.watch.tick(self.now_s)
        return self.autopilot.commands[before:]


@pytest.fixture
def rig() -> Rig:
    """A copter in the air that everything is well with."""
    rig = Rig()
    assert not rig.pass_s(100.0)
    return rig


def test_a_vehicle_without_a_command_interface_lands_after_its_time(rig: Rig) -> None:
    rig.is_led = False
    assert not rig.pass_s(LEADERLESS_S - 1.0)
    assert rig.pass_s(2.0) == ["land"]
    assert rig.told == ["no command interface for 60 s: the autopilot is commanded to land"]


def test_with_a_low_battery_it_lands_at_once(rig: Rig) -> None:
    rig.is_led = False
    rig.autopilot.now = replace(rig.autopilot.now, battery_remaining=0.19)
    assert not rig.pass_s(LOW_BATTERY_S - 1.0)
    assert rig.pass_s(2.0) == ["land"]


def test_a_requested_landing_is_left_to_a_driver_that_works(rig: Rig) -> None:
    rig.is_requested = True
    assert not rig.pass_s(20.0)
    rig.driver = None
    assert not rig.pass_s(DRIVER_SILENT_S - 1.0), "it is being started again"
    assert rig.pass_s(2.0) == ["land"]


def test_a_landing_that_is_not_taken_is_commanded_again(rig: Rig) -> None:
    rig.autopilot.is_obeying, rig.is_led = False, False
    assert rig.pass_s(LEADERLESS_S + 20.0) == ["land"] * 3
    assert len(rig.told) == 1


def test_a_driver_that_comes_back_carries_on(rig: Rig) -> None:
    rig.autopilot.is_obeying, rig.is_requested, rig.driver = False, True, None
    assert rig.pass_s(DRIVER_SILENT_S + 2.0) == ["land"]
    rig.driver = DriverState()
    assert not rig.pass_s(30.0)


@pytest.mark.parametrize(
    ("driver", "mode", "commanded"),
    [
        (None, FlightMode.LAND, ["hold"]),
        (DriverState(), FlightMode.LAND, []),
        (None, FlightMode.MANUAL, []),
    ],
)
def test_a_hold_breaks_a_requested_landing_off_where_no_driver_does_and_no_pilot_flies(
    rig: Rig, driver: DriverState | None, mode: FlightMode, commanded: list[str]
) -> None:
    rig.is_requested, rig.driver = True, None
    assert rig.pass_s(DRIVER_SILENT_S + 2.0) == ["land"]
    rig.is_requested, rig.driver = False, driver
    rig.autopilot.now = replace(rig.autopilot.now, mode=mode, has_transmitter=True)
    rig.pass_s(0.5)
    before = len(rig.autopilot.commands)
    rig.watch.requested(ManoeuvreKind.HOLD, rig.now_s)
    assert rig.autopilot.commands[before:] == commanded
    assert not rig.pass_s(30.0), "it does not land again"


def test_a_pilot_with_a_transmitter_keeps_the_vehicle(rig: Rig) -> None:
    rig.is_led = False
    rig.autopilot.now = replace(rig.autopilot.now, has_transmitter=True, mode=FlightMode.HOLD)
    rig.driver = DriverState(has_pilot_control=True)
    assert not rig.pass_s(2.0 * LEADERLESS_S)
    rig.driver = None
    rig.autopilot.now = replace(rig.autopilot.now, mode=FlightMode.MANUAL)
    assert not rig.pass_s(2.0 * LEADERLESS_S)
    rig.autopilot.now = replace(rig.autopilot.now, has_transmitter=False)
    assert rig.pass_s(1.0) == ["land"]


def test_who_ends_our_landing_is_not_overruled(rig: Rig) -> None:
    rig.is_led = False
    assert rig.pass_s(LEADERLESS_S + 2.0) == ["land"]
    rig.autopilot.now = replace(rig.autopilot.now, mode=FlightMode.HOLD)
    assert not rig.pass_s(2.0 * LEADERLESS_S)


@pytest.mark.parametrize("mode", [FlightMode.LAND, FlightMode.RETURN])
def test_what_comes_down_by_itself_is_left_alone(rig: Rig, mode: FlightMode) -> None:
    rig.is_led = False
    rig.autopilot.now = replace(rig.autopilot.now, mode=mode)
    assert not rig.pass_s(2.0 * LEADERLESS_S)


def test_on_the_ground_there_is_nothing_to_do(rig: Rig) -> None:
    rig.is_led = False
    rig.autopilot.now = replace(rig.autopilot.now, landed=LandedState.ON_GROUND)
    assert not rig.pass_s(2.0 * LEADERLESS_S)


def test_what_does_not_disarm_itself_is_disarmed_at_rest() -> None:
    rig = Rig(BOAT)
    rig.is_led = False
    assert rig.pass_s(LEADERLESS_S + 10.0) == ["hold", "disarm"]


def test_a_plane_comes_home_before_it_lands() -> None:
    rig = Rig(PLANE)
    rig.autopilot.now = replace(FLYING, is_armed=False, landed=LandedState.ON_GROUND)
    rig.pass_s(2.0)
    rig.autopilot.now, rig.autopilot.place, rig.is_led = FLYING, (900.0, 0.0, -60.0), False
    assert rig.pass_s(LEADERLESS_S + 10.0) == ["return"]
    rig.autopilot.place = (100.0, 0.0, -60.0)
    assert rig.pass_s(2.0) == ["land"]


def test_it_tells_that_as_critical() -> None:
    told: list[Severity] = []
    autopilot = Autopilot(COPTER)
    watch = LandingWatch(autopilot, DriverSettings(), 0.2, lambda severity, _text: told.append(severity), 0.0)
    watch.tick(LEADERLESS_S)
    assert told == [Severity.CRITICAL]
