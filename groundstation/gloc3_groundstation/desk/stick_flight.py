"""Manual flight of a vehicle without a companion: sticks to its autopilot, 20 times a second, and the mode for them.

Nothing is sent before it begins. Then centred sticks are sent, and an autopilot takes them for a pilot who touches
nothing; the operator's count only while the dead-man's key is held, in a mode that takes sticks, on a vehicle that is
heard. Centred sticks are sent on until the end, because both firmwares take silence for a lost pilot, and return, land
or disarm.
"""

import asyncio
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Final

from gloc3.clock import passed
from gloc3.errors import Refused
from gloc3.mavlink.flight_modes import mode_words
from gloc3.messages.envelope import Severity
from gloc3_groundstation.desk.autopilot_desk import BY_ITSELF, AutopilotDesk
from gloc3_groundstation.desk.services_desk import ServicesDesk
from gloc3_groundstation.desk.teleoperation import Hand
from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.joysticks.mapping import JoystickButton
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.services.snapshot import Firmware
from gloc3_groundstation.services.sticks import StickFamily, manual_control, stick_family
from gloc3_groundstation.services.vehicle import VehicleServices
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station

STICK_HZ: Final = 20.0
SETTLE_S: Final = 0.5
"""Time for which centred sticks are sent before a mode is set: PX4 refuses modes for a pilot who is not there."""
CHANGED_S: Final = 3.0
"""Time within which the heartbeat names a mode that was set, s."""
HEARD_S: Final = 3.0
"""Age of the vehicle's state from which sticks do not count, s."""
IGNORED: Final = {0: "a transmitter alone counts", 4: "no sticks count"}
"""Values of PX4's COM_RC_IN_MODE with which it ignores a joystick."""


class StickFlight:
    """One manual flight of one vehicle.

    Args:
        station: knows the vehicle, and is told what was commanded.
        autopilots: know who may command it, and hold it.
        services: reach its autopilot.
        name: the vehicle.
        loop: the event loop.
    """

    def __init__(
        self,
        station: Station,
        autopilots: AutopilotDesk,
        services: ServicesDesk,
        name: str,
        loop: asyncio.AbstractEventLoop,
    ) -> None:
        self.problem = ""
        """Why it has ended; empty before."""
        self.warnings: tuple[str, ...] = ()
        """What the vehicle's parameters say of sticks: what follows when they end, or why it ignores them."""
        self.hand: Final[Hand] = _StickHand(loop, self._send)
        self.held_buttons: Callable[[], Iterable[JoystickButton]] = tuple
        """Gives the held buttons of the joystick."""
        self._station, self._autopilots, self._services, self._name = station, autopilots, services, name
        self._loop = loop
        self._reached: tuple[VehicleServices, StickFamily] | None = None
        self._is_open = False
        self._changed_s = float("-inf")
        self._changes = 0
        """Commands of this station that change the mode, when the sticks were taken."""
        self._reading: asyncio.Task[None] | None = None

    @property
    def is_open(self) -> bool:
        """Whether sticks are sent."""
        return self._is_open

    @property
    def mode(self) -> str:
        """The vehicle's mode; empty where it is not known."""
        platform = self._station.fleet.get(self._name)
        return platform.vehicle.value.mode if platform is not None and platform.vehicle is not None else ""

    @property
    def takes_sticks(self) -> bool:
        """Whether the vehicle's mode takes sticks now."""
        is_unchanged = self._autopilots.mode_changes(self._name) == self._changes
        return self._is_open and is_unchanged and self._reached is not None and self.mode in self._reached[1].modes

    @property
    def note(self) -> str:
        """What is not kept in this mode with released sticks; empty where the place is."""
        return self._reached[1].modes.get(self.mode, "") if self._reached is not None else ""

    async def begin(self) -> None:
        """Sends centred sticks, and sets a mode in which they are rest; one that takes sticks is kept where that is refused.

        Raises:
            Refused: this station may not, the vehicle is not flown by sticks, or its autopilot refuses the mode.
        """
        platform = self._checked()
        services = self._services.vehicle(self._name).services
        family = stick_family(await services.learn())
        if family is None:
            raise Refused(
                "this station flies multirotors, rovers, boats and submarines by sticks, and no other vehicle"
            )
        if platform.has_companion:
            self._station.note(self._name, Severity.WARNING, BY_ITSELF)
        self.problem, self._changes = "", self._autopilots.mode_changes(self._name)
        self._reached, self._is_open, self._changed_s = (services, family), True, self._loop.time()
        self.hand.rest()
        if self._reading is None:
            self._reading = self._loop.create_task(self._read_parameters(services, family))
        if family.modes.get(self.mode) != "":
            await passed(SETTLE_S)
            try:
                await self._first_of(family.begins)
            except Refused:
                if self.mode not in family.modes:
                    raise

    async def next_mode(self) -> None:
        """Sets the next mode that takes sticks.

        Raises:
            Refused: the autopilot refuses it, or it has not begun.
        """
        if self._reached is None or not self._is_open:
            raise Refused("nothing is flown by sticks yet")
        self._changes = self._autopilots.mode_changes(self._name)
        modes = tuple(self._reached[1].modes)
        place = modes.index(self.mode) + 1 if self.mode in modes else 0
        await self._set_mode(modes[place % len(modes)])

    async def end(self) -> None:
        """Lets go, has a vehicle that is under way hold, and then sends nothing any more."""
        self.hand.release()
        platform = self._station.fleet.get(self._name)
        try:
            if self.takes_sticks and platform is not None and platform.is_armed:
                self._changed_s = self._loop.time()
                await self._autopilots.act(self._name, Action.HOLD)
        finally:
            self.close()

    def close(self) -> None:
        """Sends centred sticks once more, and then nothing."""
        self.hand.close()
        self._is_open = False
        if self._reading is not None:
            self._reading.cancel()
            self._reading = None

    async def _first_of(self, modes: tuple[str, ...]) -> None:
        for mode in modes[:-1]:
            with suppress(Refused):
                await self._set_mode(mode)
                return
        await self._set_mode(modes[-1])

    async def _set_mode(self, mode: str) -> None:
        self._checked()
        assert self._reached is not None
        self._changed_s = self._loop.time()
        await self._reached[0].actions.set_mode(mode)
        self._changed_s = self._loop.time()
        self._station.note(self._name, Severity.NOTICE, f"mode {mode_words(mode)}: accepted by the autopilot")

    def _checked(self) -> PlatformSnapshot:
        """The vehicle, if this station may fly it by sticks.

        Raises:
            Refused: it may not; with the reason.
        """
        platform = self._station.fleet.get(self._name)
        if platform is None or not self._autopilots.is_its_own(platform):
            raise Refused("its companion commands it: sticks are not sent past it")
        self._autopilots.require_control(platform, Action.MODE)
        return platform

    def _send(self, sticks: StickDemand) -> None:
        if self._reached is None or not self._is_open or not self._is_ours():
            return
        services, family = self._reached
        is_live = self.hand.is_kept and self.takes_sticks and self._is_heard
        demand, buttons = (sticks, self.held_buttons()) if is_live else (StickDemand(), ())
        services.send(manual_control(demand, family, services.target.system, buttons))

    @property
    def _is_heard(self) -> bool:
        platform = self._station.fleet.get(self._name)
        now_s = self._station.now_s()
        return platform is not None and platform.vehicle is not None and platform.vehicle.age_s(now_s) < HEARD_S

    def _is_ours(self) -> bool:
        """Ends it where somebody else commands the vehicle now: a pilot, its failsafe, another station, its companion."""
        assert self._reached is not None
        family, mode = self._reached[1], self.mode
        try:
            self._checked()
        except Refused as refusal:
            self.problem = str(refusal)
        else:
            if mode in ("", *family.modes, *family.rests) or self._loop.time() - self._changed_s < CHANGED_S:
                return True
            self.problem = f"ended: a pilot, another station or its failsafe has chosen {mode_words(mode)}"
        self._is_open = False
        self.hand.silence()
        return False

    async def _read_parameters(self, services: VehicleServices, family: StickFamily) -> None:
        """Reads what the vehicle's parameters say of sticks; what is not answered is not told."""
        firmware = services.snapshots.firmware
        found: list[str] = []
        if firmware is Firmware.PX4:
            value = await _value(services, "COM_RC_IN_MODE")
            if value in IGNORED:
                found.append(f"it IGNORES joysticks: COM_RC_IN_MODE is {value} ({IGNORED[value]}); set it to 1 or 3")
        else:
            station = await _value(services, "MAV_GCS_SYSID", "SYSID_MYGCS")
            if station is not None and str(station) != self._station.id:
                found.append(f"it IGNORES this station {self._station.id}: MAV_GCS_SYSID is {station}")
        name, words = family.lost
        value = await _value(services, name)
        if value is not None:
            found.append(f"when sticks end (esc): {words.get(value, 'see its manual')} ({name} is {value})")
        self.warnings = tuple(found)


async def _value(services: VehicleServices, *names: str) -> int | None:
    """The first of several parameters that the vehicle has."""
    for name in names:
        with suppress(Refused):
            return round((await services.parameters.read(name)).value)
    return None


class _StickHand(Hand):
    """Sends what a hand demands by a function."""

    def __init__(self, loop: asyncio.AbstractEventLoop, send: Callable[[StickDemand], None]) -> None:
        super().__init__(loop, STICK_HZ, rests=True)
        self._give = send

    def _send(self, sticks: StickDemand) -> None:
        self._give(sticks)
