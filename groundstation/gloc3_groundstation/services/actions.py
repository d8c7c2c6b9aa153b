"""Commands to an autopilot itself: for vehicles without a GLOC3 companion, and for those whose companion is silent.

What brings a vehicle to rest, home or down is a mode, set by our own `DO_SET_MODE`: it leaves at once, whatever else is under
way, where MAVSDK's process has to be started first (2 to 3 s) and knows no such mode of submarines and no landing of planes.
Everything else goes by MAVSDK's plugins.
"""

from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from enum import StrEnum
from typing import Final

from gloc3.errors import Refused, nearest
from gloc3.mavlink.flight_modes import ARDUPILOT, PX4, PX4_MODE_WORDS, autopilot_name, mode_numbers, mode_words
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3.mavlink.services.statustext import StatusText
from gloc3.messages.envelope import Severity
from gloc3_groundstation.services.cameras import CameraService
from gloc3_groundstation.services.machines import Machines
from gloc3_groundstation.services.mavsdk.behind_link import MavsdkBehindLink
from gloc3_groundstation.services.mavsdk.messages import Plugin
from gloc3_groundstation.services.snapshot import Firmware, SnapshotService

DO_SET_MODE: Final = 176
CUSTOM_MODE: Final = 1.0
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""
HIGHEST_M: Final = 1000.0
"""Of a take-off, above home."""
HIGHEST_PLACE_M: Final = 10_000.0
"""Altitude of a place, up or down."""
FASTEST_M_S: Final = 100.0


class Action(StrEnum):
    """What an autopilot can be commanded to do."""

    ARM = "arm"
    DISARM = "disarm"
    TAKE_OFF = "take_off"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    GO_TO = "go_to"
    SPEED = "speed"
    MODE = "mode"
    START_PLAN = "start_plan"
    PAUSE_PLAN = "pause_plan"
    PICTURE = "picture"
    RECORD = "record"
    STOP_RECORDING = "stop_recording"
    POINT = "point"
    REBOOT = "reboot"


PLUGINS: Final[Mapping[Action, Plugin]] = {
    Action.ARM: Plugin.ARM,
    Action.DISARM: Plugin.DISARM,
    Action.GO_TO: Plugin.GO_TO,
    Action.SPEED: Plugin.SPEED,
    Action.START_PLAN: Plugin.START_PLAN,
    Action.REBOOT: Plugin.REBOOT,
}
BY_MODE: Final[Mapping[str, Mapping[Action, tuple[str, ...]]]] = {
    "PX4": {Action.HOLD: ("AUTO.LOITER",), Action.RETURN: ("AUTO.RTL",), Action.LAND: ("AUTO.LAND",)},
    "COPTER": {Action.HOLD: ("BRAKE",), Action.RETURN: ("RTL",), Action.LAND: ("LAND",)},
    "PLANE": {Action.HOLD: ("LOITER",), Action.RETURN: ("RTL",), Action.LAND: ("AUTOLAND",)},
    "VTOL": {Action.HOLD: ("LOITER",), Action.RETURN: ("RTL",), Action.LAND: ("QLAND",)},
    "ROVER": {Action.HOLD: ("HOLD",), Action.RETURN: ("RTL",)},
    "SUB": {Action.HOLD: ("POSHOLD", "ALT_HOLD"), Action.LAND: ("SURFACE",)},
}
"""By family: the modes that bring a vehicle to rest, home or down, the best first: without a position a submarine keeps its
depth."""
RESTS: Final = (Action.HOLD, Action.PAUSE_PLAN)
WITH_CAMERA: Final = frozenset({Action.PICTURE, Action.RECORD, Action.STOP_RECORDING, Action.POINT})
"""What cameras and gimbals do, and not the autopilot."""
QUADPLANES: Final = frozenset(range(19, 26))
"""MAV_TYPE_VTOL_…"""
HEARD_S: Final = 3.0
"""Longest time for a heartbeat to come, s."""
TEXT_WAIT_S: Final = 0.4
"""Time for the autopilot's own reason to come after a refusal, s."""
TEXT_BEFORE_S: Final = 0.2
"""Lead of the autopilot's own reason over the command's begin, as links delay it, s."""
MOST_REASONS: Final = 2


class ActionService:
    """Commands one autopilot; each command is confirmed by the vehicle, or refused with its reason.

    Args:
        machines: run the command client.
        commands: that client.
        mavsdk: MAVSDK for the same autopilot.
        snapshots: what is known of the vehicle.
        cameras: its cameras and gimbals.
    """

    def __init__(
        self,
        machines: Machines,
        commands: MavCommandClient,
        mavsdk: MavsdkBehindLink,
        snapshots: SnapshotService,
        cameras: CameraService,
    ) -> None:
        self._machines, self._commands, self._mavsdk, self._snapshots = machines, commands, mavsdk, snapshots
        self._cameras = cameras
        self._texts: deque[tuple[float, str]] = deque(maxlen=16)
        """The autopilot's last warnings, each with its time."""
        machines.on_event(self._receive_event)

    async def act(self, action: Action, *arguments: float) -> None:
        """Commands the vehicle.

        Args:
            action: anything but a mode; a take-off arms the vehicle first.
            arguments: of a take-off the height above home, m; of a go_to latitude and longitude in degrees, altitude
                above the sea in m and, unless it is NaN, the heading in degrees; of a speed that over ground, m/s; of
                pointing the camera pitch above the horizon and yaw right of the nose, degrees.

        Raises:
            Refused: an argument is out of bounds, or the vehicle refuses or does not answer.
        """
        check_values(action, arguments)
        await self._heard()
        begin_s = self._machines.now_s
        try:
            await self._act(action, *arguments)
        except Refused as refusal:
            raise Refused(await self.explained(str(refusal), begin_s)) from None

    async def _act(self, action: Action, *arguments: float) -> None:
        snapshot = self._snapshots.snapshot
        match action:
            case Action.PICTURE:
                return await self._cameras.take_picture()
            case Action.RECORD | Action.STOP_RECORDING:
                return await self._cameras.record(is_on=action is Action.RECORD)
            case Action.POINT:
                return await self._cameras.point(*arguments)
        if action in (*RESTS, Action.RETURN, Action.LAND):
            await self._rest(Action.HOLD if action in RESTS else action)
            return None
        if action is Action.REBOOT and snapshot.is_armed:
            raise Refused("the vehicle is armed; its autopilot is restarted on the ground, disarmed")
        if action is not Action.TAKE_OFF:
            await self._mavsdk.act(PLUGINS[action], *arguments)
            return None
        await self._prepare()
        try:
            await self._mavsdk.act(Plugin.TAKE_OFF, *arguments)
        except Refused as refusal:
            left = "it is armed" if snapshot.is_armed else await self._disarm_again()
            raise Refused(f"{refusal}; {left}") from None

    async def _disarm_again(self) -> str:
        """Disarms a vehicle that was armed for a take-off which it refuses; its state in words."""
        if self._snapshots.snapshot.is_in_air:
            return "it is armed, and in the air"
        try:
            await self._mavsdk.act(Plugin.DISARM)  # refused in the air, too
        except Refused as refusal:
            return f"it is armed, and not disarmed again: {refusal}"
        return "it was armed for it, and disarmed again"

    async def _prepare(self) -> None:
        """Arms for a take-off: ArduPilot takes off on command in GUIDED alone."""
        if self._snapshots.snapshot.firmware is Firmware.ARDUPILOT:
            await self._set_mode("GUIDED")
        if not self._snapshots.snapshot.is_armed:
            await self._mavsdk.act(Plugin.ARM)

    async def _heard(self) -> None:
        """Waits for a heartbeat, which tells what it is."""
        machines, snapshots = self._machines, self._snapshots
        timer = machines.loop.call_later(HEARD_S, machines.settle)
        end_s = machines.now_s + HEARD_S
        try:
            await machines.until(lambda: snapshots.snapshot.received_s is not None or machines.now_s >= end_s)
        finally:
            timer.cancel()
        if snapshots.snapshot.received_s is None:
            raise Refused("no heartbeat of its autopilot")

    async def _rest(self, action: Action) -> None:
        snapshot = self._snapshots.snapshot
        family = "PX4" if snapshot.firmware is Firmware.PX4 else mode_numbers(ARDUPILOT, snapshot.vehicle_type).family
        if family == "PLANE" and snapshot.vehicle_type in QUADPLANES:
            family = "VTOL"
        if snapshot.firmware is Firmware.OTHER or family not in BY_MODE:
            raise Refused("the modes of this vehicle are not known")
        modes = BY_MODE[family].get(action)
        if modes is None:
            raise Refused("it has no mode for that: hold stops it")
        await self._first_of(modes)

    async def _first_of(self, modes: tuple[str, ...]) -> None:
        for mode in modes[:-1]:
            with suppress(Refused):
                await self._set_mode(mode)
                return
        await self._set_mode(modes[-1])

    def _receive_event(self, event: object) -> None:
        """Keeps the autopilot's warnings: among them is the reason of a refusal."""
        if isinstance(event, StatusText) and event.severity <= Severity.WARNING:
            text = event.text.strip()
            if text and event.sender == self._snapshots.snapshot.address:
                self._texts.append((self._machines.now_s, text))

    async def explained(self, refusal: str, begin_s: float) -> str:
        """A refusal with the autopilot's own reasons, which come at about the same time."""
        machines = self._machines
        end_s = machines.now_s + TEXT_WAIT_S
        timer = machines.loop.call_later(TEXT_WAIT_S, machines.settle)
        try:
            await machines.until(lambda: machines.now_s >= end_s)
        finally:
            timer.cancel()
        said = dict.fromkeys(text for at_s, text in self._texts if at_s >= begin_s - TEXT_BEFORE_S)
        new = [text for text in said if text not in refusal]
        return f"{refusal}: {'; '.join(new[-MOST_REASONS:])}" if new else refusal

    async def set_mode(self, name: str) -> None:
        """Sets a mode by the autopilot's own name for it, or by that of PX4's documents.

        Raises:
            Refused: it has none of that name, or refuses it; with the autopilot's own reason.
        """
        await self._heard()
        begin_s = self._machines.now_s
        try:
            await self._set_mode(name)
        except Refused as refusal:
            raise Refused(await self.explained(str(refusal), begin_s)) from None

    async def _set_mode(self, name: str) -> None:
        snapshot = self._snapshots.snapshot
        autopilot = {Firmware.PX4: PX4, Firmware.ARDUPILOT: ARDUPILOT}.get(snapshot.firmware)
        if autopilot is None:
            raise Refused("the modes of this firmware are not known")
        numbers = mode_numbers(autopilot, snapshot.vehicle_type).numbers
        if autopilot == PX4:
            name = next((raw for raw, words in PX4_MODE_WORDS.items() if words.lower() == name.lower()), name)
        if name not in numbers:
            raise Refused(f"it has no mode {name!r}; {nearest(name, sorted(numbers))}")
        custom = numbers[name]
        parts = (float(custom >> 16 & 0xFF), float(custom >> 24)) if autopilot == PX4 else (float(custom),)
        machines = self._machines
        call = self._commands.send_long(snapshot.address, DO_SET_MODE, (CUSTOM_MODE, *parts), now_s=machines.now_s)
        try:
            await machines.until(lambda: call.result is not None)
        finally:
            self._commands.abandon(call)
        if call.result is not CommandResult.ACCEPTED:
            raise Refused(
                f"mode {mode_words(name, autopilot_name(autopilot))}: {call.result.words if call.result is not None else 'cancelled'}"
            )


def check_values(action: Action, arguments: tuple[float, ...]) -> None:
    """Checks the values of a command; arguments as of `ActionService.act`.

    Raises:
        Refused: a value is missing or out of its bounds.
    """
    match action, arguments:
        case Action.TAKE_OFF, (height_m,):
            if not 0.0 < height_m <= HIGHEST_M:
                raise Refused(f"a take-off goes to above 0 and up to {HIGHEST_M:g} m, not {height_m:g} m")
        case Action.GO_TO, (latitude, longitude, altitude_m, _):
            if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
                raise Refused(
                    f"{latitude:g}, {longitude:g} is no place: latitude up to 90, longitude up to 180 degrees"
                )
            if altitude_m != altitude_m:
                raise Refused("a place needs an altitude")
            if abs(altitude_m) >= HIGHEST_PLACE_M:
                raise Refused(f"{altitude_m:g} m: altitudes are less than {HIGHEST_PLACE_M:g} m from the sea's surface")
        case Action.SPEED, (speed_m_s,):
            if not 0.0 < speed_m_s <= FASTEST_M_S:
                raise Refused(f"a speed is above 0 and up to {FASTEST_M_S:g} m/s, not {speed_m_s:g} m/s")
        case Action.POINT, (pitch_deg, yaw_deg):
            if not (abs(pitch_deg) <= 180.0 and abs(yaw_deg) <= 360.0):
                raise Refused(f"{pitch_deg:g}, {yaw_deg:g}: pitch is up to 180, yaw up to 360 degrees")
        case Action.TAKE_OFF | Action.GO_TO | Action.SPEED | Action.MODE | Action.POINT, _:
            raise Refused(f"{action} takes other values than {arguments}")
        case _, (_, *_):
            raise Refused(f"{action} takes no values")
