"""Sticks to the embedded autopilots, in virtual time: who may, when they count, what a released key does, and the end."""

import asyncio
from collections.abc import Awaitable, Callable
from math import hypot
from typing import Any

import pytest

from gloc3.clock import run_virtual
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.mavlink.codec import Encoder, Frame, Parser, decode
from gloc3.mavlink.flight_modes import mode_name
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.command_interface import EmergencyVerb, StationRole
from gloc3.messages.summaries import VehicleSummary
from gloc3_groundstation.desk.autopilot_desk import AutopilotDesk
from gloc3_groundstation.desk.services_desk import ServicesDesk
from gloc3_groundstation.desk.stick_flight import STICK_HZ, StickFlight
from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.station.fleet import with_platform
from gloc3_groundstation.station.snapshots import AutopilotSnapshot, PlatformSnapshot, Timed
from gloc3_groundstation.station.station import Station
from gloc3_sitl.autopilot.mavlink.links import LinkKind
from gloc3_sitl.autopilot.verdict import Author
from gloc3_sitl.vehicles.simulator import Simulator, SimulatorSettings
from gloc3_sitl.world import World

pytestmark = pytest.mark.flight

NAME = "bare"
STEP_S = 0.02


class Flight:
    """A vehicle without a companion, the station's link to it, and an operator with sticks."""

    def __init__(self, vehicle: str | None, style: str | None, **parameters: float) -> None:
        self.own = Address(255, 190)
        self.sim = Simulator(
            World.load("open"), SimulatorSettings(vehicle=vehicle or "hummingbird", style=style, seed=7)
        )
        for name, value in parameters.items():
            self.sim.autopilot.parameters.set(name, value)
        self.sent: list[MavlinkMessage] = []
        """MANUAL_CONTROL that has left."""
        self._parser, self._encoder = Parser(is_datagram=True), Encoder(*self.own)
        self._listeners: list[Callable[[Frame], None]] = []
        self._feed = self.sim.attach(self._receive, LinkKind.BARE)
        loop = asyncio.get_running_loop()
        self.station = Station(LocalExchange(), loop, "255", 11)
        services = ServicesDesk(self.station, lambda _: (self, Address(1, 1)))
        self.autopilots = AutopilotDesk(self.station, services)
        self.services = services
        self.sticks = StickFlight(self.station, self.autopilots, services, NAME, loop)

    # --- the link ---

    def send(self, message: MavlinkMessage) -> None:
        if message.name == "MANUAL_CONTROL":
            self.sent.append(message)
        self._feed(self._encoder.encode(message))

    def listen(self, listener: Callable[[Frame], None]) -> Callable[[], None]:
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def _receive(self, data: bytes) -> None:
        for frame in self._parser.receive(data):
            for listener in tuple(self._listeners):
                listener(frame)
            message = decode(frame)
            if message is not None and message.name == "HEARTBEAT":
                self._see(message)

    def _see(self, beat: MavlinkMessage) -> None:
        """What the station's watch of an autopilot makes of a heartbeat."""
        now_s = self.station.now_s()
        n, e, d = self.sim.truth().position_ned_m
        state = VehicleSummary(
            t_s=now_s,
            mode=mode_name(beat.autopilot, beat.type, beat.custom_mode),
            is_armed=bool(beat.base_mode & 128),
            landed="",
            battery_percent=-1,
            position_m=(n, e, -d),
            speed_m_s=self.speed_m_s,
            heading_deg=0,
            is_pose_valid=True,
            has_pilot_control=False,
            is_autopilot_connected=True,
        )
        platform = PlatformSnapshot(
            name=NAME,
            boot=0,
            first_received_s=0.0,
            received_s=now_s,
            has_companion=False,
            autopilot=AutopilotSnapshot(link="", system=1, component=1, firmware="PX4"),
            vehicle=Timed(state, now_s),
        )
        self.station.change(lambda fleet, _: with_platform(fleet, platform))

    # --- time ---

    async def run(self, seconds: float, *, is_held: bool = False) -> None:
        """Goes on, with the dead-man's key held or not."""
        for _ in range(round(seconds / STEP_S)):
            if is_held:
                self.sticks.hand.hold_key(0.3)
            self.sim.advance(self.sim.now_s + STEP_S)
            await asyncio.sleep(STEP_S)

    async def during(self, work: Awaitable[Any]) -> Any:
        """Goes on until something is done."""
        task = asyncio.ensure_future(work)
        while not task.done():
            await self.run(STEP_S)
        return await task

    @property
    def speed_m_s(self) -> float:
        return hypot(*self.sim.truth().velocity_ned_m_s[:2])

    @property
    def down_m(self) -> float:
        return self.sim.truth().position_ned_m[2]

    @property
    def mode(self) -> str:
        return str(self.sim.autopilot.commander.mode.name)

    @property
    def is_armed(self) -> bool:
        return bool(self.sim.autopilot.craft.is_armed)

    def set_mode(self, name: str) -> None:
        """Somebody else sets a mode."""
        commander = self.sim.autopilot.commander
        row = commander.style.mode_named(name)
        assert row is not None
        assert commander.set_mode(row.custom_mode, Author.PILOT).is_accepted

    async def in_the_air(self) -> None:
        await self.run(8.0)
        commander = self.sim.autopilot.commander
        if commander.style.name == "ardupilot":
            self.set_mode("GUIDED")
        assert commander.arm(Author.COMMAND).is_accepted
        assert commander.take_off(-3.0).is_accepted
        await self.run(8.0)


def flown(check: Callable[[Flight], Awaitable[None]], vehicle: str | None, style: str | None, **values: float) -> None:
    async def main() -> None:
        flight = Flight(vehicle, style, **values)
        try:
            await check(flight)
        finally:
            flight.sticks.close()
            await flight.services.close()
            flight.station.close()

    run_virtual(main())


@pytest.mark.parametrize(("style", "mode"), [("px4", "Position"), ("ardupilot", "LOITER")])
def test_a_multirotor_is_flown_and_stops_when_the_key_is_released(style: str, mode: str) -> None:
    async def check(at: Flight) -> None:
        await at.in_the_air()
        assert at.sent == [], "nothing is sent before it has begun"
        await at.during(at.sticks.begin())
        await at.run(1.2)
        assert at.mode == mode
        at.sticks.hand.move(StickDemand(surge=0.7))
        await at.run(1.0)
        assert at.speed_m_s < 0.2, "nothing moves without the key"
        before = len(at.sent)
        await at.run(3.0, is_held=True)
        assert len(at.sent) - before == pytest.approx(3.0 * STICK_HZ, abs=4)
        assert at.speed_m_s > 1.0
        at.sticks.hand.release()
        assert (at.sent[-1].x, at.sent[-1].z) == (0, 500), "the release leaves at once"
        await at.run(6.0)
        assert at.speed_m_s < 0.15
        assert at.mode == mode, "centred sticks go on, so that it does not count as without a pilot"
        await at.during(at.sticks.end())
        await at.run(0.3)
        assert at.mode in ("Hold", "BRAKE")
        count = len(at.sent)
        await at.run(1.0)
        assert len(at.sent) == count, "then nothing is sent any more"

    flown(check, None, style)


def test_an_rov_keeps_its_depth_armed_when_the_key_is_released_and_its_failsafe_is_told() -> None:
    async def check(at: Flight) -> None:
        await at.run(12.0)
        await at.during(at.sticks.begin())
        await at.run(1.2)
        assert at.mode in ("POSHOLD", "ALT_HOLD")
        assert at.sim.autopilot.commander.arm(Author.COMMAND).is_accepted
        await at.run(1.2)
        at.sticks.hand.move(StickDemand(heave=-1.0))
        await at.run(5.0, is_held=True)
        assert at.down_m > 0.5
        at.sticks.hand.release()
        await at.run(2.0)
        depth_m = at.down_m
        await at.run(5.0)
        assert at.down_m == pytest.approx(depth_m, abs=0.2)
        assert at.is_armed
        await at.run(10.0)
        assert any("FS_PILOT_INPUT is 2" in text and "DISARMED" in text for text in at.sticks.warnings)

    flown(check, "rov", None)


def test_somebody_elses_mode_ends_it_a_hold_keeps_it_and_sticks_do_not_leave_the_hold() -> None:
    async def check(at: Flight) -> None:
        await at.in_the_air()
        await at.during(at.sticks.begin())
        await at.run(4.0)
        await at.during(at.autopilots.emergency(at.station.fleet.platforms[NAME], EmergencyVerb.HOLD))
        at.sticks.hand.move(StickDemand(surge=1.0))
        await at.run(2.0, is_held=True)
        assert (at.mode, at.sent[-1].x) == ("Hold", 0)
        assert at.sticks.is_open
        at.set_mode("Return")
        await at.run(1.5, is_held=True)
        assert not at.sticks.is_open
        assert "has chosen Return" in at.sticks.problem
        count = len(at.sent)
        await at.run(1.0)
        assert len(at.sent) == count

    flown(check, None, "px4")


def test_an_observer_a_plane_and_a_parameter_that_forbids_joysticks_are_told() -> None:
    async def observer(at: Flight) -> None:
        await at.run(2.0)
        at.station.client.role = StationRole.OBSERVER
        with pytest.raises(Refused, match="it is an observer"):
            await at.during(at.sticks.begin())
        assert at.sent == []

    async def plane(at: Flight) -> None:
        await at.run(2.0)
        with pytest.raises(Refused, match="no other vehicle"):
            await at.during(at.sticks.begin())
        assert at.sent == []

    async def forbidden(at: Flight) -> None:
        await at.in_the_air()
        await at.during(at.sticks.begin())
        await at.run(2.0)
        assert any("IGNORES joysticks: COM_RC_IN_MODE is 4" in text for text in at.sticks.warnings)

    flown(observer, None, "px4")
    flown(plane, "plane", None)
    flown(forbidden, None, "px4", COM_RC_IN_MODE=4.0)
