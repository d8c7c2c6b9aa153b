"""State shared by commands and messages: the autopilot, its links, and the telemetry streams of each."""

from collections.abc import Callable, Mapping
from typing import Final

from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.mavlink.services.corrections import CorrectionAssembler
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL, StreamScheduler
from gloc3.mavlink.services.version import ProtocolCapability, Version, version_number
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, wrap_pi
from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.behaviours.base import FliesMission
from gloc3_sitl.autopilot.mavlink import motion_telemetry
from gloc3_sitl.autopilot.mavlink.calibration import AccelerometerPositions
from gloc3_sitl.autopilot.mavlink.events import HealthReporter
from gloc3_sitl.autopilot.mavlink.links import AutopilotPort, AutopilotRouter, LinkKind, Receive, Send
from gloc3_sitl.autopilot.mavlink.signing_sync import SigningSync
from gloc3_sitl.autopilot.mavlink.telemetry import producers
from gloc3_sitl.autopilot.modes import Result, StyleTables
from gloc3_sitl.autopilot.verdict import ACCEPTED, OUT_OF_RANGE, RequestVerdict

_SLOW: Final = {
    "SYS_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 1.0,
    "GPS_RAW_INT": 1.0,
    "BATTERY_STATUS": 0.5,
    "HOME_POSITION": 0.5,
    "MISSION_CURRENT": 1.0,
    "SYSTEM_TIME": 1.0,
    "OPEN_DRONE_ID_ARM_STATUS": 1.0,
}

_DEFAULTS: Final[Mapping[str, Mapping[LinkKind, Mapping[str, float]]]] = {
    "px4": {
        LinkKind.GROUND: {
            **_SLOW,
            "ALTITUDE": 1.0,
            "ATTITUDE": 10.0,
            "ATTITUDE_QUATERNION": 4.0,
            "DISTANCE_SENSOR": 0.5,
            "ESTIMATOR_STATUS": 0.5,
            "GLOBAL_POSITION_INT": 5.0,
            "LOCAL_POSITION_NED": 4.0,
            "ORBIT_EXECUTION_STATUS": 2.0,
            "RC_CHANNELS": 5.0,
            "SCALED_PRESSURE": 1.0,
            "SERVO_OUTPUT_RAW": 1.0,
            "VFR_HUD": 4.0,
        },
        LinkKind.COMPANION: {
            **_SLOW,
            "ALTITUDE": 1.0,
            "ATTITUDE_QUATERNION": 25.0,
            "DISTANCE_SENSOR": 10.0,
            "ESTIMATOR_STATUS": 1.0,
            "GLOBAL_POSITION_INT": 5.0,
            "LOCAL_POSITION_NED": 25.0,
            "POSITION_TARGET_LOCAL_NED": 1.0,
        },
    },
    # ArduPilot is silent until somebody asks, by SET_MESSAGE_INTERVAL, REQUEST_DATA_STREAM or a stream parameter; what a
    # Remote ID sends it passes on.
    "ardupilot": {kind: {"OPEN_DRONE_ID_ARM_STATUS": 1.0} for kind in LinkKind},
}
_COMMON: Final = (
    ProtocolCapability.MISSION_INT
    | ProtocolCapability.COMMAND_INT
    | ProtocolCapability.FTP
    | ProtocolCapability.SET_ATTITUDE_TARGET
    | ProtocolCapability.SET_POSITION_TARGET_LOCAL_NED
    | ProtocolCapability.SET_POSITION_TARGET_GLOBAL_INT
    | ProtocolCapability.FLIGHT_TERMINATION
    | ProtocolCapability.MAVLINK2
    | ProtocolCapability.MISSION_FENCE
    | ProtocolCapability.MISSION_RALLY
)
MOST_HEIGHT_M: Final = 100_000.0
_ALIGNING_SHARE: Final = 0.01
_IMU: Final = {codec.shape(name).id: name for name in ("HIGHRES_IMU", "SCALED_IMU")}
"""Messages sent faster than the outer loop."""

_PX4_FIXED: Final = frozenset({codec.shape("MISSION_CURRENT").id})
"""Messages that PX4 sends at a fixed rate; an interval is refused."""
_PX4_ON_CHANGE: Final = frozenset({codec.shape("GPS_GLOBAL_ORIGIN").id})
"""Messages that PX4 sends when they change and on request; an interval is accepted without effect."""


def starting_rates(style: str, kind: LinkKind) -> dict[str, float]:
    """Initial rates of a link, Hz; 0 for messages sent on request only."""
    return dict.fromkeys(producers(style), 0.0) | dict(_DEFAULTS[style].get(kind, {}))


GROUPS: Final[Mapping[int, tuple[str, ...]]] = {
    1: ("RAW_IMU", "SCALED_IMU", "SCALED_PRESSURE"),
    2: ("SYS_STATUS", "MISSION_CURRENT", "GPS_RAW_INT", "FENCE_STATUS"),
    3: ("RC_CHANNELS", "SERVO_OUTPUT_RAW"),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: ("ATTITUDE",),
    11: ("VFR_HUD",),
    12: ("BATTERY_STATUS", "DISTANCE_SENSOR", "EKF_STATUS_REPORT", "EXTENDED_SYS_STATE", "SYSTEM_TIME"),
}
"""ArduPilot's groups of messages (MAV_DATA_STREAM)."""

GROUP_PARAMETERS: Final[Mapping[str, int]] = {
    "MAV1_RAW_SENS": 1,
    "MAV1_EXT_STAT": 2,
    "MAV1_RC_CHAN": 3,
    "MAV1_POSITION": 6,
    "MAV1_EXTRA1": 10,
    "MAV1_EXTRA2": 11,
    "MAV1_EXTRA3": 12,
}
"""ArduPilot's parameters of the message groups; they apply to all links here."""


def version_of(style: StyleTables) -> Version:
    """The emulated firmware's version; vendor and product ids are unassigned."""
    bytewise = style.name == "px4"
    return Version(
        capabilities=_COMMON
        | (ProtocolCapability.PARAM_ENCODE_BYTEWISE if bytewise else ProtocolCapability.PARAM_ENCODE_C_CAST),
        flight_software=version_number(*style.version),
        middleware_software=version_number(*style.version),
        os_software=version_number(1, 0, 0),
        board=1,
        uid=0x676C_6F63_33,
    )


class HeadingOffset:
    """Heading of an odometer's own frame, whose x axis is that of its start."""

    __slots__ = ("_offset_rad", "_resets")

    def __init__(self) -> None:
        self._offset_rad: float | None = None
        self._resets = -1

    def update(self, own_yaw_rad: float, odometer_yaw_rad: float, reset_counter: int) -> float:
        """Heading of the odometer's x axis, from the two headings of the vehicle; it changes slowly."""
        seen = wrap_pi(own_yaw_rad - odometer_yaw_rad)
        if self._offset_rad is None or reset_counter != self._resets:
            self._offset_rad = seen
        else:
            self._offset_rad = wrap_pi(self._offset_rad + _ALIGNING_SHARE * wrap_pi(seen - self._offset_rad))
        self._resets = reset_counter
        return self._offset_rad


class FrontContext:
    """See the module.

    Args:
        autopilot: the autopilot that it serves.
        receive: receives each frame from any link.
        before: the instance before a reboot, whose signing key is kept.
    """

    def __init__(
        self, autopilot: Autopilot, receive: Callable[[Frame], None], before: "FrontContext | None" = None
    ) -> None:
        self.autopilot: Final = autopilot
        self.craft: Final = autopilot.craft
        self.commander: Final = autopilot.commander
        self.is_px4: Final = autopilot.style.name == "px4"
        names = ("MAV_SYS_ID", "MAV_SYSID")
        system = next(int(autopilot.parameters[name]) for name in names if name in autopilot.parameters)
        self.own: Final = Address(system, 1)
        self.signing: Final = SigningSync(self.own, autopilot.style.name)
        if before is not None:
            self.signing.load(before.signing)
        self.router: Final = AutopilotRouter(self.own, receive, self.signing.passes)
        self._arriving: AutopilotPort | None = None
        """The link of the frame that is being handled: what it asks for is answered there."""
        self._streams: dict[AutopilotPort, StreamScheduler] = {}
        self.producers: Final = producers(autopilot.style.name)
        """Messages that can be streamed or requested, by name."""
        self._producers = {codec.shape(name).id: produce for name, produce in self.producers.items()}
        self.heading_offset: Final = HeadingOffset()
        """Between an odometer's frame and north."""
        self.accelerometer: Final = AccelerometerPositions(self.craft)
        self.corrections: Final = CorrectionAssembler()
        """Corrections for the satellite receiver, whose pieces are still coming."""
        self.health: HealthReporter | None = None
        """Reports the arming checks, where the style does so by events."""
        autopilot.parameters.on_change.append(self._parameter_changed)

    def offer(self, name: str, produce: Callable[[Autopilot], MavlinkMessage | None]) -> None:
        """Has one more message streamed or requested."""
        self._producers[codec.shape(name).id] = produce

    # -- links --------------------------------------------------------------------------------------------------------

    def attach(self, send: Send, kind: LinkKind, *, is_datagram: bool = True) -> Receive:
        """Adds a link; returns a callable for each piece of received data."""
        link, receive = self.router.attach(send, kind, is_datagram=is_datagram)
        self.signing.equip(link)
        rates = starting_rates(self.autopilot.style.name, kind)
        for name, group in GROUP_PARAMETERS.items():
            if name in self.autopilot.parameters and kind is not LinkKind.BARE:
                rates.update(dict.fromkeys(GROUPS[group], self.autopilot.parameters[name]))
        if not self.is_px4:  # PX4's heartbeat comes once a second, whatever is asked for
            rates["HEARTBEAT"] = 0.0
        self._streams[link] = StreamScheduler(self.own, rates)

        def arrive(data: bytes) -> None:
            self._arriving = link
            try:
                receive(data)
            finally:
                self._arriving = None

        return arrive

    def link_of(self, sender: Address) -> AutopilotPort | None:
        """The link on which an address has just been heard, or else the first on which it was; None if on none."""
        if self._arriving is not None and sender in self._arriving.peers:
            return self._arriving
        return next((link for link in self.router.links if sender in link.peers), None)

    # -- out ----------------------------------------------------------------------------------------------------------

    def stream(self, now_s: float) -> None:
        """Sends due messages on each link."""
        made: dict[int, MavlinkMessage | None] = {}
        for link, streams in self._streams.items():
            for number in streams.due(now_s):
                if number in _IMU:
                    rate_hz = streams.rate_hz(_IMU[number])
                    for measured in motion_telemetry.imu_messages(_IMU[number], self.autopilot, rate_hz):
                        link.send(link.encoder.encode(measured))
                    continue
                if number in made:
                    message = made[number]
                else:
                    message = made[number] = self._producers[number](self.autopilot)
                if message is not None:
                    link.send(link.encoder.encode(message))

    def send_now(self, name: str) -> None:
        """Sends a message to all peers immediately."""
        message = self.producers[name](self.autopilot)
        if message is not None:
            self.router.send(message)

    # -- what commands need -------------------------------------------------------------------------------------------

    @property
    def mission_flight(self) -> FliesMission | None:
        """The mission under way, in mission mode."""
        activity = self.commander.activity
        return activity if isinstance(activity, FliesMission) else None

    def set_current(self, index: int) -> bool:
        """Makes another mission item the current one; false where there is none."""
        if not self.craft.first_item <= index < len(self.autopilot.plans.mission):
            return False
        flight = self.mission_flight
        if flight is not None:
            flight.skip_to(index)
        else:
            self.craft.mission.current = index
        self.craft.mission.outdated = None
        self.send_now("MISSION_CURRENT")
        return True

    def request_message(self, number: int, request: MavCommandRequest) -> RequestVerdict:
        """Sends one message once to the requester."""
        if number == codec.shape("AUTOPILOT_VERSION").id:
            message: MavlinkMessage | None = version_of(self.autopilot.style).message()
        elif number in self._producers:
            message = self._producers[number](self.autopilot)
        else:
            return RequestVerdict(Result.DENIED if self.is_px4 else Result.FAILED, "message is not produced here")
        if message is None:
            return RequestVerdict(Result.TEMPORARILY_REJECTED, "no data yet")
        link = self.link_of(request.sender)
        if link is not None:
            link.send(link.encoder.encode(message))
        return ACCEPTED

    def stream_command(self, request: MavCommandRequest) -> RequestVerdict:
        """SET_MESSAGE_INTERVAL and GET_MESSAGE_INTERVAL, for the link of the request."""
        link = self.link_of(request.sender)
        if link is None:
            return RequestVerdict(Result.FAILED, "unknown link")
        if self.is_px4 and request.command == SET_MESSAGE_INTERVAL:
            wanted = request.params[0]
            if wanted not in self._producers or wanted in _PX4_FIXED:
                return RequestVerdict(Result.FAILED, "message is not a stream here")
            if wanted in _PX4_ON_CHANGE:
                return ACCEPTED
        streams = self._streams[link]
        result = streams.command(request, self.craft.now_s)
        for message in streams.outgoing():
            link.send(link.encoder.encode(message))
        return RequestVerdict(Result.UNSUPPORTED if result is None else Result(int(result)))

    def set_group(self, group: int, rate_hz: float, sender: Address | None) -> None:
        """Rate of one of ArduPilot's message groups, on the sender's link or on every link."""
        names = GROUPS.get(group, ()) if group else tuple(name for row in GROUPS.values() for name in row)
        link = None if sender is None else self.link_of(sender)
        for streams in self._streams.values() if link is None else (self._streams[link],):
            for name in names:
                streams.set_rate(name, rate_hz, self.craft.now_s)

    def use_source_set(self, number: int) -> RequestVerdict:
        """Switches ArduPilot's estimator to another set of sources."""
        if f"EK3_SRC{number}_POSXY" not in self.autopilot.parameters:
            return RequestVerdict(Result.DENIED, "no such source set")
        self.autopilot.source_set = number
        self.autopilot.choose_sources()
        self.craft.send_text(Severity.INFO, f"EKF3: using source set {number}")
        return ACCEPTED

    def begin_calibration(self) -> None:
        """Starts a gyro calibration: it takes a second and changes nothing."""
        self.craft.send_text(Severity.INFO, "Calibrating; do not move the vehicle")

    def set_origin(self, place: GeoPoint) -> RequestVerdict:
        """Fixes the estimator's origin, where there is none yet."""
        estimator = self.autopilot.estimator
        latitude, longitude, altitude_m = place
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and abs(altitude_m) <= MOST_HEIGHT_M):
            return OUT_OF_RANGE
        if estimator.origin is not None:
            return RequestVerdict(self.commander.style.refused, "the origin is already set")
        estimator.set_origin(place)
        return ACCEPTED

    def accepts_joystick(self, sender: Address) -> bool:
        """Whether MANUAL_CONTROL is accepted: PX4 by COM_RC_IN_MODE, ArduPilot from its own station."""
        if self.is_px4:
            return self.autopilot.parameters["COM_RC_IN_MODE"] in (1.0, 2.0, 3.0)
        return sender.system == self.craft.tuning.station_system

    def station_contact(self, system: int) -> None:
        """A ground station's heartbeat came in."""
        self.autopilot.failsafes.station_contact(system)

    def _parameter_changed(self, name: str, value: float) -> None:
        group = GROUP_PARAMETERS.get(name)
        if group is not None:
            self.set_group(group, value, None)
