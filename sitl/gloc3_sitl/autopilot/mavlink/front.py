"""The MAVLink front end: what comes in becomes requests to the autopilot, what it says and does goes out."""

from typing import Any, Final

from gloc3.errors import Refused
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.node import Node
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.service import Service
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, CommandClient
from gloc3.mavlink.services.command_server import CommandRequest, CommandServer
from gloc3.mavlink.services.ftp_server import FtpServer
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL, StreamScheduler
from gloc3.mavlink.services.log_server import LogServer
from gloc3.mavlink.services.statustext import StatusTextSender
from gloc3.mavlink.services.timesync import TimeSync
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.behaviours.mission import MissionFlight
from gloc3_sitl.autopilot.craft import Home
from gloc3_sitl.autopilot.mavlink import commands, motion_telemetry
from gloc3_sitl.autopilot.mavlink.links import Link, LinkKind, Receive, Router, Send
from gloc3_sitl.autopilot.mavlink.listeners import LISTENERS
from gloc3_sitl.autopilot.mavlink.odometry import HeadingOffset
from gloc3_sitl.autopilot.mavlink.parameter_keeper import ParameterKeeper
from gloc3_sitl.autopilot.mavlink.plan_keeper import PlanKeeper
from gloc3_sitl.autopilot.mavlink.rates import GROUP_PARAMETERS, GROUPS, starting_rates
from gloc3_sitl.autopilot.mavlink.signing_keeper import SigningKeeper
from gloc3_sitl.autopilot.mavlink.telemetry import producers
from gloc3_sitl.autopilot.mavlink.version import version_of
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.autopilot.onboard_files import OnboardFiles
from gloc3_sitl.autopilot.verdict import ACCEPTED, Verdict

_STANDBY, _ACTIVE, _CRITICAL, _EMERGENCY, _BOOT, _TERMINATED = 3, 4, 5, 6, 1, 8
_ARMED, _CUSTOM = 128, 1
ARM_AUTHORIZATION_REQUEST: Final = 3001
_CALIBRATION_S: Final = 1.0
_BUSY_S: Final = 1.0
"""So long after the last message to or from a service they are looked at in every outer period, and rarely otherwise."""
_RARELY_S: Final = 0.1
_IMU: Final = {codec.shape(name).id: name for name in ("HIGHRES_IMU", "SCALED_IMU")}
"""What is asked for at more than the rate of the outer loop."""


class Front:
    """Speaks for an autopilot on any number of links.

    Args:
        autopilot: whom it speaks for; its outer loop drives this too.
        before: itself before a reboot; uploaded plans and files outlive that.
    """

    def __init__(self, autopilot: Autopilot, before: "Front | None" = None) -> None:
        self.autopilot: Final = autopilot
        self.craft: Final = autopilot.craft
        self.commander: Final = autopilot.commander
        self.is_px4: Final = autopilot.style.name == "px4"
        names = ("MAV_SYS_ID", "MAV_SYSID")
        system = next(int(autopilot.parameters[name]) for name in names if name in autopilot.parameters)
        self.own: Final = Address(system, 1)
        self.signing: Final = SigningKeeper(self.own, autopilot.style.name)
        if before is not None:
            self.signing.take_over(before.signing)
        self.router: Final = Router(self.own, self._take, self.signing.passes)
        self._commands = CommandServer(self.own, is_autopilot=True)
        self._arming: CommandRequest | None = None
        """An attempt to arm that waits for leave."""
        self._asked: CommandCall | None = None
        self._authorizer = CommandClient(self.own)
        self.commander.authorization.send = self._ask_for_leave
        self.commander.on_arming_settled = self._arming_settled
        self._texts = StatusTextSender(self.own)
        self._heartbeat = Heartbeat(
            self.own, vehicle_type=autopilot.vehicle.mav_type, autopilot=autopilot.style.autopilot
        )
        self.plans: Final = PlanKeeper(self, self.own)
        if before is not None:
            self.plans.take_over(before.plans)
        self.files: Final = OnboardFiles(autopilot.logger, autopilot.style.log_folder)
        if before is not None:
            self.files.take_over(before.files)
        self._parameters = ParameterKeeper(autopilot.parameters, self.own, is_bytewise=self.is_px4)
        self._node = Node(
            self.own,
            (
                self._commands,
                self._authorizer,
                self._texts,
                self._heartbeat,
                self.plans.server,
                self._parameters.server,
                LogServer(self.own, autopilot.logger, may_erase=True),
                FtpServer(self.own, self.files),
                TimeSync(self.own),
            ),
        )
        self._streams: dict[Link, StreamScheduler] = {}
        self.producers: Final = producers(autopilot.style.name)
        """By name, what can be streamed or requested."""
        self._producers = {codec.shape(name).id: produce for name, produce in self.producers.items()}
        self._producers[codec.shape("HEARTBEAT").id] = lambda _: self._heartbeat.message()
        self._listeners = {codec.shape(name).id: listen for name, listen in LISTENERS.items()}
        self._calibration: tuple[CommandRequest, float] | None = None
        self._busy_until_s = self._serve_s = 0.0
        self._told = (-1, -1)
        self._home_told: Home | None = None
        self._origin_told: TangentPlane | None = None
        self.heading_offset: Final = HeadingOffset()
        """Between an odometer's frame and north."""
        self.refused_setpoints = 0
        """Setpoints that the style does not take."""
        self.refusal = ""
        """Why the last of them was refused."""
        autopilot.on_outer.append(self.tick)
        autopilot.parameters.on_change.append(self._parameter_changed)

    def add(self, service: Service[Any]) -> None:
        """Adds one more microservice."""
        self._node.add(service)

    # -- links --------------------------------------------------------------------------------------------------------

    def attach(self, send: Send, kind: LinkKind, *, is_datagram: bool = True) -> Receive:
        """Adds a link; gives what is to be called with each piece of data that comes in there."""
        link, receive = self.router.attach(send, kind, is_datagram=is_datagram)
        self.signing.equip(link)
        rates = starting_rates(self.autopilot.style.name, kind)
        for name, group in GROUP_PARAMETERS.items():
            if name in self.autopilot.parameters and kind is not LinkKind.BARE:
                rates.update(dict.fromkeys(GROUPS[group], self.autopilot.parameters[name]))
        if not self.is_px4:  # PX4's heartbeat comes once a second, whatever is asked for
            rates["HEARTBEAT"] = 0.0
        self._streams[link] = StreamScheduler(self.own, rates)
        return receive

    def link_of(self, sender: Address) -> Link | None:
        """The link on which somebody was heard."""
        return next((link for link in self.router.links if sender in link.peers), None)

    def say(self, severity: Severity, text: str) -> None:
        """Sends a sentence to everybody."""
        self._texts.say(int(severity), text)
        self._serve_s = 0.0

    # -- in -----------------------------------------------------------------------------------------------------------

    def _take(self, frame: Frame) -> None:
        now_s = self.craft.now_s
        is_service = self._node.receive(frame, now_s)
        listen = self._listeners.get(frame.message_id)
        if listen is not None:
            message = frame.decode()
            if message is not None:
                try:
                    listen(self, message, frame.sender)
                except Refused as refusal:
                    self.refused_setpoints += 1
                    self.refusal = str(refusal)
        if is_service:
            self._busy_until_s = now_s + _BUSY_S
            self._serve()

    def _serve(self) -> None:
        """Runs the commands that have come, and sends what the services have to say."""
        now_s = self.craft.now_s
        self._serve_s = now_s + _RARELY_S
        self.plans.tick()
        self._parameters.tick()
        for call in self._authorizer.events():
            if call.result is not None and call.result is not CommandResult.NO_ANSWER:
                self.commander.authorization.answered(call.result, call.result_param1, call.result_param2)
        for request in self._commands.events():
            verdict = commands.handle(self, request)
            if request.command == commands.ARM and verdict.result is Result.IN_PROGRESS:
                self._arming = request  # it says nothing while it waits
                continue
            if verdict.result is Result.IN_PROGRESS:
                self._calibration = (request, self.craft.now_s + _CALIBRATION_S)
            self._commands.answer(request, CommandResult(int(verdict.result)), now_s=now_s)
        send = self.router.send
        messages = self._node.outgoing()
        if len(messages) > 1:
            self._busy_until_s = now_s + _BUSY_S
        for message in messages:
            send(message)

    def _ask_for_leave(self, system: int) -> None:
        """Asks the authorizer of PX4's COM_ARM_AUTH_ID."""
        if self._asked is not None:
            self._authorizer.abandon(self._asked)
        now_s = self._serve_s = self.craft.now_s
        self._asked = self._authorizer.send_long(Address(system, 0), ARM_AUTHORIZATION_REQUEST, now_s=now_s)

    def _arming_settled(self, verdict: Verdict) -> None:
        if self._arming is not None:
            self._commands.answer(self._arming, CommandResult(int(verdict.result)), now_s=self.craft.now_s)
            self._arming, self._serve_s = None, self.craft.now_s

    # -- out ----------------------------------------------------------------------------------------------------------

    def tick(self, now_s: float) -> None:
        """After each outer period: heartbeat, streams, services."""
        self._update_heartbeat()
        if self._calibration is not None and now_s >= self._calibration[1]:
            self._commands.answer(self._calibration[0], CommandResult.ACCEPTED, now_s=now_s)
            self._calibration = None
        if now_s >= self._serve_s or now_s < self._busy_until_s:
            self._node.tick(now_s)
            self._serve()
        self._tell_mission()
        self._tell_places()
        made: dict[int, MavlinkMessage | None] = {}
        for link, streams in self._streams.items():
            for number in streams.due(now_s):
                if number in _IMU:
                    rate_hz = streams.rate_hz(_IMU[number])
                    for felt in motion_telemetry.imu_messages(_IMU[number], self.autopilot, rate_hz):
                        link.send(link.encoder.encode(felt))
                    continue
                if number in made:
                    message = made[number]
                else:
                    message = made[number] = self._producers[number](self.autopilot)
                if message is not None:
                    link.send(link.encoder.encode(message))

    def _update_heartbeat(self) -> None:
        heartbeat, commander, craft = self._heartbeat, self.commander, self.craft
        base = commander.mode.base_mode | _CUSTOM | (_ARMED if craft.is_armed else 0)
        custom = commander.mode.custom_mode
        if commander.is_terminated:
            status = _TERMINATED
        elif self.autopilot.failsafes.is_acting:
            status = _CRITICAL
        elif not self.autopilot.estimator.is_aligned:
            status = _BOOT
        else:
            status = _ACTIVE if craft.is_armed else _STANDBY
        heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status = base, custom, status
        if (base, custom) != self._told:
            self._told = (base, custom)
            heartbeat.send_now()
            self._serve_s = 0.0

    def _tell_mission(self) -> None:
        """Items that were reached since the last time."""
        reached = self.craft.mission.reached
        if not reached:
            return
        for index in reached:
            self.router.send(codec.message("MISSION_ITEM_REACHED", seq=index))
        reached.clear()
        self.send_now("MISSION_CURRENT")

    def _tell_places(self) -> None:
        """Home and origin, when they have changed."""
        home, origin = self.craft.home, self.autopilot.estimator.origin
        if home is not self._home_told:
            self._home_told = home
            self.send_now("HOME_POSITION")
        if origin is not self._origin_told:
            self._origin_told = origin
            self.send_now("GPS_GLOBAL_ORIGIN")

    def send_now(self, name: str) -> None:
        """Sends a message to everybody out of turn."""
        message = self.producers[name](self.autopilot)
        if message is not None:
            self.router.send(message)

    # -- what commands need -------------------------------------------------------------------------------------------

    @property
    def mission_flight(self) -> MissionFlight | None:
        """The mission under way, in mission mode."""
        activity = self.commander.activity
        return activity if isinstance(activity, MissionFlight) else None

    def set_current(self, index: int) -> bool:
        """Makes another mission item the current one; false where there is none."""
        if not self.craft.first_item <= index < len(self.autopilot.plans.mission):
            return False
        flight = self.mission_flight
        if flight is not None:
            flight.skip_to(index)
        else:
            self.craft.mission.current = index
        self.send_now("MISSION_CURRENT")
        return True

    def request_message(self, number: int, request: CommandRequest) -> Verdict:
        """Sends one message once, to whom asked."""
        if number == codec.shape("AUTOPILOT_VERSION").id:
            message: MavlinkMessage | None = version_of(self.autopilot.style).message()
        elif number in self._producers:
            message = self._producers[number](self.autopilot)
        else:
            return Verdict(Result.DENIED if self.is_px4 else Result.FAILED, "message is not produced here")
        if message is None:
            return Verdict(Result.TEMPORARILY_REJECTED, "nothing to tell yet")
        link = self.link_of(request.sender)
        if link is not None:
            link.send(link.encoder.encode(message))
        return ACCEPTED

    def stream_command(self, request: CommandRequest) -> Verdict:
        """SET_MESSAGE_INTERVAL and GET_MESSAGE_INTERVAL, for the link on which they came."""
        link = self.link_of(request.sender)
        if link is None:
            return Verdict(Result.FAILED, "unknown link")
        if self.is_px4 and request.command == SET_MESSAGE_INTERVAL and request.params[0] not in self._producers:
            return Verdict(Result.FAILED, "message is not produced here")
        streams = self._streams[link]
        result = streams.command(request, self.craft.now_s)
        for message in streams.outgoing():
            link.send(link.encoder.encode(message))
        return Verdict(Result.UNSUPPORTED if result is None else Result(int(result)))

    def set_group(self, group: int, rate_hz: float, sender: Address | None) -> None:
        """ArduPilot's groups of messages: all of one group, on the sender's link or on every link."""
        names = GROUPS.get(group, ()) if group else tuple(name for row in GROUPS.values() for name in row)
        link = None if sender is None else self.link_of(sender)
        for streams in self._streams.values() if link is None else (self._streams[link],):
            for name in names:
                streams.set_rate(name, rate_hz, self.craft.now_s)

    def use_source_set(self, number: int) -> Verdict:
        """Switches ArduPilot's estimator to another set of sources."""
        if f"EK3_SRC{number}_POSXY" not in self.autopilot.parameters:
            return Verdict(Result.DENIED, "no such source set")
        self.autopilot.source_set = number
        self.autopilot.choose_sources()
        self.craft.say(Severity.INFO, f"EKF3: using source set {number}")
        return ACCEPTED

    def begin_calibration(self) -> None:
        """A calibration of the gyro: it takes a second and changes nothing."""
        self.craft.say(Severity.INFO, "Calibrating; do not move the vehicle")

    def set_origin(self, place: GeoPoint) -> Verdict:
        """Fixes the estimator's origin, where there is none yet."""
        estimator = self.autopilot.estimator
        latitude, longitude, altitude_m = place
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and abs(altitude_m) <= commands.MOST_HEIGHT_M):
            return commands.OUT_OF_RANGE
        if estimator.origin is not None:
            return Verdict(self.commander.style.refused, "the origin is set already")
        estimator.set_origin(place)
        return ACCEPTED

    def takes_joystick(self, sender: Address) -> bool:
        """Whether sticks over MAVLink are taken: PX4 by COM_RC_IN_MODE, ArduPilot from its own station."""
        if self.is_px4:
            return self.autopilot.parameters["COM_RC_IN_MODE"] in (1.0, 2.0, 3.0)
        return sender.system == self.craft.tuning.station_system

    def station_heard(self, system: int) -> None:
        """A ground station's heartbeat came in."""
        self.autopilot.failsafes.station_heard(system)

    def _parameter_changed(self, name: str, value: float) -> None:
        group = GROUP_PARAMETERS.get(name)
        if group is not None:
            self.set_group(group, value, None)
