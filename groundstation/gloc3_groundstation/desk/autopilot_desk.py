"""Commands to an autopilot itself, for a vehicle without a GLOC3 companion or one whose companion is silent."""

from collections.abc import Mapping
from math import isfinite
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.command_interface import EmergencyVerb
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint
from gloc3_groundstation.desk.control import holder_of, require_control, require_operator
from gloc3_groundstation.desk.services_desk import ServicesDesk
from gloc3_groundstation.services.actions import WITH_CAMERA, Action
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station

BY_ITSELF: Final = (
    "its onboard process is silent: this goes to the autopilot itself; when the process is back, the station "
    "reports whose command it was, and the mission stays paused until it is resumed"
)
THROUGH_COMPANION: Final = (
    "its commands go through its onboard process now, so this one was not sent to the autopilot: give it again"
)
EMERGENCIES: Final = {
    EmergencyVerb.HOLD: Action.HOLD,
    EmergencyVerb.LAND: Action.LAND,
    EmergencyVerb.DISARM: Action.DISARM,
}


KEEP_THE_MODE: Final = frozenset({Action.ARM, Action.DISARM, Action.SPEED, Action.REBOOT}) | WITH_CAMERA


class ActionOffer(NamedTuple):
    """A command as an operator sees it."""

    title: str
    question: str = ""
    """Asked before it is sent, with the vehicle's name in place of {}; empty where it is sent at once."""
    values: str = ""
    """What has to be typed; empty without values."""


OFFERS: Final[Mapping[Action, ActionOffer]] = {
    Action.HOLD: ActionOffer("Hold"),
    Action.RETURN: ActionOffer("Return home", "Return {} home?\nIts autopilot flies at its own return height."),
    Action.LAND: ActionOffer("Land here", "Land {} where it is?"),
    Action.ARM: ActionOffer("Arm", "Arm {}?\nIts motors may turn."),
    Action.DISARM: ActionOffer("Disarm", "Disarm {}?\nIts autopilot refuses it in flight."),
    Action.TAKE_OFF: ActionOffer("Arm and take off", "Arm {} and take off?", "height above home, m"),
    Action.GO_TO: ActionOffer("Go to a place", "Send {} there?", "LATITUDE, LONGITUDE, HEIGHT ABOVE HOME in m"),
    Action.SPEED: ActionOffer("Set the speed", values="speed over ground, m/s"),
    Action.MODE: ActionOffer("Set the mode", "Set the mode of {}?", "the autopilot's own name of the mode"),
    Action.START_PLAN: ActionOffer("Start the autopilot's plan", "Start the plan of {}?\nIt may arm and set off."),
    Action.PAUSE_PLAN: ActionOffer("Pause the autopilot's plan"),
    Action.PICTURE: ActionOffer("Take a picture"),
    Action.RECORD: ActionOffer("Begin to record video"),
    Action.STOP_RECORDING: ActionOffer("Stop recording video"),
    Action.POINT: ActionOffer("Point the camera", values="PITCH above the horizon, YAW right of the nose, degrees"),
    Action.REBOOT: ActionOffer("Restart the autopilot", "Restart the autopilot of {}?"),
}


class AutopilotDesk:
    """Sends commands to autopilots; refusals become events, never exceptions.

    Args:
        station: is told what was sent and what became of it.
        services: reach the autopilots.
    """

    def __init__(self, station: Station, services: ServicesDesk) -> None:
        self._station, self._services = station, services
        self._mode_changes: dict[str, int] = {}

    def is_its_own(self, platform: PlatformSnapshot) -> bool:
        """Whether the vehicle is commanded through its autopilot: it has no companion, or that is silent, and it is heard."""
        is_heard = platform.autopilot is not None and platform.autopilot.is_alive
        return not platform.has_companion or (is_heard and platform.is_quiet_link(self._station.now_s()))

    def offers(self, platform: PlatformSnapshot) -> tuple[Action, ...]:
        """The commands that make sense now; none where a companion commands the vehicle."""
        if not self.is_its_own(platform):
            return ()
        on_the_ground = (Action.ARM, Action.TAKE_OFF, Action.REBOOT)
        under_way = (Action.RETURN, Action.LAND, Action.GO_TO, Action.SPEED, Action.PAUSE_PLAN, Action.DISARM)
        left_out = on_the_ground if platform.is_armed else under_way
        return tuple(action for action in OFFERS if action not in left_out)

    async def emergency(self, platform: PlatformSnapshot, verb: EmergencyVerb) -> bool:
        """The emergency key."""
        return await self.act(platform.name, EMERGENCIES[verb])

    async def act(self, name: str, action: Action, typed: str = "") -> bool:
        """Commands a vehicle; arguments as of `command`. Returns whether the autopilot has accepted it."""
        try:
            await self.command(name, action, typed)
        except Gloc3Error as error:
            self._station.note(name, Severity.ERROR, f"{in_words(action, typed)}: {error}")
            return False
        return True

    def mode_changes(self, name: str) -> int:
        """How many commands that change its mode this station has sent to a vehicle: its heartbeat tells it later."""
        return self._mode_changes.get(name, 0)

    async def command(self, name: str, action: Action, typed: str = "") -> None:
        """Commands a vehicle, whose autopilot has accepted it at the end.

        Args:
            name: of the vehicle.
            action: the command.
            typed: its values, as `OFFERS` names them.

        Raises:
            Refused: this station may not, its companion commands it, a value is wrong, or the autopilot refuses.
        """
        platform = self._station.fleet.get(name)
        self.require_control(platform, action)
        if platform is not None and not self.is_its_own(platform):
            raise Refused(THROUGH_COMPANION)
        if action not in KEEP_THE_MODE:
            self._mode_changes[name] = self.mode_changes(name) + 1
        if platform is not None and platform.has_companion:
            self._station.note(name, Severity.WARNING, BY_ITSELF)
        services = self._services.vehicle(name).services
        if action is Action.MODE:
            await services.actions.set_mode(typed)
        else:
            await services.actions.act(action, *values_of(action, typed, platform))
        whose = "the vehicle" if action in WITH_CAMERA else "the autopilot"
        self._station.note(name, Severity.NOTICE, f"{in_words(action, typed)}: accepted by {whose}")
        if platform is not None and platform.has_companion and action not in KEEP_THE_MODE:
            self._station.notify_when_back(name, in_words(action, typed))

    async def set_home(self, name: str, place: GeoPoint) -> None:
        """Moves the home of a vehicle's autopilot, also of one with a companion; read back at the end.

        Raises:
            Refused: this station may not, or the autopilot refuses; that is an event, too.
        """
        what = f"home to {place.latitude_deg:.7f}, {place.longitude_deg:.7f}, {place.altitude_m:.1f} m"
        try:
            require_control(self._station, name)
            await self._services.vehicle(name).services.home.set(place)
        except Refused as refusal:
            self._station.note(name, Severity.ERROR, f"{what}: {refusal}")
            raise
        self._station.note(name, Severity.NOTICE, f"{what}: accepted by the autopilot, and read back")

    def require_control(self, platform: PlatformSnapshot | None, action: Action) -> None:
        """Checks who asks: in place of a silent companion the station that was in control, and every operator for hold.

        Raises:
            Refused: it is an observer, or another station was in control.
        """
        station = self._station
        require_operator(station)
        if platform is None or not platform.has_companion or action is Action.HOLD:
            return
        holder = holder_of(platform)
        if holder != station.id:
            whose = f"station {holder} was" if holder else "nobody was"
            raise Refused(f"{whose} in control when its onboard process fell silent: this station may send hold alone")


def in_words(action: Action, typed: str) -> str:
    """`take off 5`."""
    return f"{action.replace('_', ' ')}{f' {typed}' if typed else ''}"


def numbers_of(action: Action, typed: str) -> tuple[float, ...]:
    """The numbers that were typed for a command.

    Raises:
        Refused: they are none, or too few.
    """
    try:
        numbers = tuple(map(float, typed.replace(",", " ").split()))
    except ValueError:
        numbers = ()
    if len(numbers) != {Action.GO_TO: 3, Action.POINT: 2}.get(action, 1) or not all(map(isfinite, numbers)):
        raise Refused(f"{typed!r}: {OFFERS[action].values} is expected")
    return numbers


def values_of(action: Action, typed: str, platform: PlatformSnapshot | None) -> tuple[float, ...]:
    """The numbers of a command as they were typed, as the service takes them; none for a mode, which is a name.

    Raises:
        Refused: they are no numbers, or too few, or home's height is not known.
    """
    if action is Action.MODE or not OFFERS[action].values:
        return ()
    numbers = numbers_of(action, typed)
    if action is not Action.GO_TO:
        return numbers
    vehicle = platform.vehicle.value if platform is not None and platform.vehicle is not None else None
    if vehicle is None or vehicle.geo is None:
        raise Refused("where the vehicle is, is not known, so heights above home are not either")
    home_m = vehicle.geo[2] - vehicle.position_m[2]
    return numbers[0], numbers[1], home_m + numbers[2], float("nan")
