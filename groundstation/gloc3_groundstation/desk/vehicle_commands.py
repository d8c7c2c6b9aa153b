"""Commands of a script to a vehicle, one after the other, each awaited until telemetry shows it done.

A vehicle without a companion is commanded through its autopilot; with one, the same words are single actions.
"""

import asyncio
from collections.abc import Callable, Mapping
from math import hypot
from typing import Any, Final

import msgspec

from gloc3.clock import passed
from gloc3.errors import Gloc3Error, NoContact, Refused, nearest
from gloc3.mavlink.flight_modes import mode_words
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.messages.summaries import VehicleSummary
from gloc3.messages.vehicle import LandedState
from gloc3.mission.model.model import GEO
from gloc3.mission.model.states import ENDED, ActionState
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.autopilot_desk import OFFERS, AutopilotDesk, in_words, numbers_of, values_of
from gloc3_groundstation.desk.mission_desk import MissionDesk
from gloc3_groundstation.services.actions import BY_MODE, RESTS, Action, check_values
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station

HEIGHT_SHARE: Final = 0.9
"""Part of a take-off's height, or 0.5 m less than it, from which the take-off is done."""
NEAR_M: Final = 3.0
"""Distance at which a vehicle has arrived."""
NEAR_WINGS_M: Final = 200.0
"""The same for one that circles on wings."""
AT_REST_M_S: Final = 0.5
AGAIN_S: Final = 2.0
"""A command that the vehicle is not ready for is repeated after this time."""
HELD_S: Final = 1.0
"""Duration of a hold as a single action: after it the vehicle keeps its position, too."""
WINGS: Final = ("fixed wing", "vtol")
"""Beginnings of the types of vehicles that circle."""
SUBMARINE: Final = "submarine"
SURFACED_M: Final = 0.5
"""Depth below home from which a submarine counts as surfaced."""
SURFACED: Final = "ALT_HOLD"
"""ArduSub's mode after SURFACE, at the surface."""
ARMED_AT_HOME: Final = (*WINGS, "ground rover", "surface boat", SUBMARINE)
"""Those that stay armed at the end of a return."""
PLANS: Final = ("AUTO.MISSION", "AUTO")
READIED: Final = (Action.ARM, Action.TAKE_OFF, Action.START_PLAN)
"""Refused while the autopilot is not ready, which often passes."""
SINGLE: Final[Mapping[Action, str]] = {
    Action.TAKE_OFF: "take_off",
    Action.HOLD: "hold",
    Action.LAND: "land",
    Action.RETURN: "return_home",
    Action.GO_TO: "go_to",
}
"""The capability that does the same with a companion."""


class NotDone(Gloc3Error):
    """A vehicle has accepted a command, and does not show within its time that it is done."""


class VehicleCommand(msgspec.Struct, frozen=True, kw_only=True):
    """A command to a vehicle."""

    action: Action
    typed: str = ""
    """Its values, as `OFFERS` names them."""

    def __str__(self) -> str:
        return in_words(self.action, self.typed)


def parse_vehicle_command(text: str) -> VehicleCommand:
    """Reads a command such as `take_off 5`.

    Raises:
        Refused: it is none, or its values are wrong.
    """
    word, _, typed = text.strip().partition(" ")
    if word not in list(Action):
        raise Refused(f"{text.strip()!r} is no command; {nearest(word, [action.value for action in Action])}")
    command = VehicleCommand(action=Action(word), typed=typed.strip())
    values = OFFERS[command.action].values
    if bool(values) != bool(command.typed):
        raise Refused(f"{word}: {values} is expected" if values else f"{word} takes no values")
    if command.action is Action.GO_TO:  # in the vehicle's frame, which is not known here
        numbers_of(command.action, command.typed)
    elif command.action is not Action.MODE:
        check_values(command.action, values_of(command.action, command.typed, None))
    return command


class VehicleCommands:
    """Carries out commands to vehicles.

    Args:
        station: the station.
        autopilots: commands autopilots.
        missions: requests single actions.
    """

    def __init__(self, station: Station, autopilots: AutopilotDesk, missions: MissionDesk) -> None:
        self._station, self._autopilots, self._missions = station, autopilots, missions

    async def carry_out(self, name: str, command: VehicleCommand, *, ready_s: float, within_s: float) -> str:
        """Commands a vehicle, and waits until telemetry shows it done.

        Args:
            name: of the vehicle.
            command: the command.
            ready_s: for how long a command is repeated that the vehicle is not ready for, s.
            within_s: longest time from its acceptance until it is done, s.

        Returns:
            What telemetry shows: `armed, in air, mode HOLD, h 5.0 m`.

        Raises:
            Refused: the vehicle refuses it, or it does not exist for this vehicle.
            NoContact: nothing was received from the vehicle at the end of its time.
            NotDone: it is not done within its time.
        """
        platform = self._known(name)
        if self._autopilots.is_its_own(platform):
            await self._when_ready(name, command, ready_s)
            is_done = self._shown_by(name, command, platform)
        else:
            task = await self._request(platform, command)
            is_done = self._ended(name, command, task)
        try:
            async with asyncio.timeout(within_s):
                await flights.until(self._station, is_done)
        except TimeoutError:
            known, now_s = self._known(name), self._station.now_s()
            if known.is_quiet_link(now_s):
                raise NoContact(
                    f"{command}: nothing heard of {name} for {wording.duration(known.age_s(now_s))}"
                ) from None
            shown = self._shown(name)
            raise NotDone(f"{command}: accepted, but not done within {wording.duration(within_s)}: {shown}") from None
        return self._shown(name)

    # --- without a companion ---

    async def _when_ready(self, name: str, command: VehicleCommand, ready_s: float) -> None:
        """Commands the autopilot; again while it is not ready."""
        until_s, reported = self._station.now_s() + ready_s, ""
        while True:
            try:
                await self._autopilots.command(name, command.action, command.typed)
                return
            except Refused as refusal:
                if command.action not in READIED or self._station.now_s() + AGAIN_S >= until_s:
                    raise
                if str(refusal) != reported:
                    reported = str(refusal)
                    self._station.note(name, Severity.INFO, f"{command}: waiting, since {reported}")
            await passed(AGAIN_S)

    def _shown_by(self, name: str, command: VehicleCommand, before: PlatformSnapshot) -> Callable[[], bool]:
        """Whether an autopilot's telemetry shows a command done."""
        values = values_of(command.action, command.typed, before)
        vehicle_type = before.autopilot.vehicle_type if before.autopilot is not None else ""
        accepted_s = self._station.now_s()

        def is_done() -> bool:
            platform = self._station.fleet.get(name)
            if platform is None or platform.vehicle is None or platform.vehicle.received_s <= accepted_s:
                return False
            return shows(platform.vehicle.value, command, values, vehicle_type)

        return is_done

    # --- with a companion ---

    async def _request(self, platform: PlatformSnapshot, command: VehicleCommand) -> str:
        """Requests a single action; the name of its task."""
        capability = SINGLE.get(command.action, "")
        known = self._missions.capabilities(platform.name)
        if capability not in known:
            words = ", ".join(word for word, single in SINGLE.items() if single in known)
            raise Refused(f"{platform.name} has a companion, without an action {command.action}; it has {words}")
        return await self._missions.request(platform.name, capability, _arguments(platform, command))

    def _ended(self, name: str, command: VehicleCommand, task: str) -> Callable[[], bool]:
        """Whether a single action has ended well.

        Raises:
            NotDone: it ends otherwise.
        """

        def is_done() -> bool:
            platform = self._known(name)
            mission = platform.mission.value if platform.mission is not None else None
            state = mission.tasks.get(task, "") if mission is not None else ""
            if mission is None or state not in ENDED:
                return False
            if state != ActionState.DONE:
                reason = mission.reasons.get(task, "")
                raise NotDone(f"{command}: {state}{f' ({reason})' if reason else ''}")
            return command.action is not Action.LAND or not platform.is_armed

        return is_done

    def _known(self, name: str) -> PlatformSnapshot:
        platform = self._station.fleet.get(name)
        if platform is None:
            raise NoContact(f"{name} is no longer heard")
        return platform

    def _shown(self, name: str) -> str:
        vehicle = self._known(name).vehicle
        if vehicle is None:
            return "its state is unknown"
        one = vehicle.value
        mode = wording.mode_detail(self._known(name)) or "unknown"
        return f"{wording.arming(one)}, mode {mode}, {wording.position(one)}"


def shows(vehicle: VehicleSummary, command: VehicleCommand, values: tuple[float, ...], vehicle_type: str) -> bool:
    """Whether a vehicle's state shows that a command to its autopilot is done.

    Args:
        vehicle: its state.
        command: the command.
        values: the command's, as `values_of` gives them.
        vehicle_type: its type, as `quadrotor`.
    """
    has_wings = vehicle_type.startswith(WINGS)
    match command.action:
        case Action.ARM:
            return vehicle.is_armed
        case Action.DISARM:
            return not vehicle.is_armed
        case Action.LAND:
            is_up = _mode(vehicle) == SURFACED and vehicle.position_m[2] >= -SURFACED_M
            return not vehicle.is_armed or (vehicle_type.startswith(SUBMARINE) and is_up)
        case Action.RETURN:
            return not vehicle.is_armed or (vehicle_type.startswith(ARMED_AT_HOME) and _is_in(vehicle, Action.RETURN))
        case Action.TAKE_OFF:
            height_m = vehicle.position_m[2]
            least_m = min(HEIGHT_SHARE * values[0], values[0] - 0.5) if values[0] > 1.0 else 0.5 * values[0]
            is_up = vehicle.landed in ("", LandedState.IN_AIR)
            return vehicle.is_armed and is_up and height_m >= least_m
        case Action.HOLD | Action.PAUSE_PLAN:
            return _is_in(vehicle, Action.HOLD) and (has_wings or vehicle.speed_m_s < AT_REST_M_S)
        case Action.GO_TO:
            return _is_at(vehicle, values, NEAR_WINGS_M if has_wings else NEAR_M)
        case Action.MODE:
            return command.typed.lower() in (_mode(vehicle).lower(), mode_words(_mode(vehicle), "PX4").lower())
        case Action.START_PLAN:
            return _mode(vehicle) in PLANS
        case _:  # a speed, a restart and what cameras do: no telemetry of the vehicle shows them
            return True


def _is_in(vehicle: VehicleSummary, action: Action) -> bool:
    """Whether a vehicle is in a mode that an action leads to, in any family."""
    wanted = Action.HOLD if action in RESTS else action
    modes = {mode for family in BY_MODE.values() for mode in family.get(wanted, ())}
    return _mode(vehicle) in modes


def _mode(vehicle: VehicleSummary) -> str:
    """The autopilot's name of the mode, without what carries a VTOL."""
    return vehicle.mode.partition(",")[0]


def _is_at(vehicle: VehicleSummary, place: tuple[float, ...], near_m: float) -> bool:
    """Whether a vehicle is near a place: latitude, longitude in degrees, altitude in m."""
    if vehicle.geo is None:
        return False
    north_m, east_m, _ = TangentPlane(GeoPoint(*vehicle.geo)).ned_from_geo(*place[:3])
    return hypot(north_m, east_m) <= near_m and abs(place[2] - vehicle.geo[2]) <= max(near_m, NEAR_M)


def _arguments(platform: PlatformSnapshot, command: VehicleCommand) -> dict[str, Any]:
    """The arguments of the capability that does the same.

    Raises:
        Refused: a value is wrong.
    """
    match command.action:
        case Action.TAKE_OFF:
            return {"height_m": values_of(command.action, command.typed, platform)[0]}
        case Action.HOLD:
            return {"duration_s": HELD_S}
        case Action.GO_TO:
            position = list(numbers_of(command.action, command.typed))
            frame = platform.vehicle.value.frame if platform.vehicle is not None else ""
            return {"position" if frame in ("", GEO) else "position_m": position}
        case _:
            return {}
