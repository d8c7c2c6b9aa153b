"""The MAVLink front end: turns received messages into requests, and sends telemetry and texts."""

from functools import partial
from typing import Any, Final

from gloc3.errors import Refused
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3.mavlink.services.command_server import MavCommandRequest, MavCommandServer
from gloc3.mavlink.services.files.ftp_server import FtpServer
from gloc3.mavlink.services.files.log_server import LogServer
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.statustext import StatusTextSender
from gloc3.mavlink.services.timesync import TimeSync
from gloc3.mavlink.shell import ShellServer
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import TangentPlane
from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.craft import HomePosition
from gloc3_sitl.autopilot.mavlink import commands
from gloc3_sitl.autopilot.mavlink.context import FrontContext
from gloc3_sitl.autopilot.mavlink.events import EVENTS, EventSender, HealthReporter
from gloc3_sitl.autopilot.mavlink.links import UARTS_BYTES, UARTS_FILE, LinkKind, Receive, Send, uarts
from gloc3_sitl.autopilot.mavlink.listeners import LISTENERS
from gloc3_sitl.autopilot.mavlink.metadata import (
    GENERAL,
    PARAMETERS,
    general_file,
    metadata_message,
    parameters_file,
)
from gloc3_sitl.autopilot.mavlink.parameter_sync import (
    PACKED_BYTES_EACH,
    PACKED_FILE,
    ParameterSync,
    packed_parameters,
    queried_parameters,
)
from gloc3_sitl.autopilot.mavlink.plan_sync import PlanSync
from gloc3_sitl.autopilot.mavlink.shell import Shell
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.autopilot.onboard_files import OnboardFiles
from gloc3_sitl.autopilot.verdict import RequestVerdict

_STANDBY, _ACTIVE, _CRITICAL, _EMERGENCY, _BOOT, _TERMINATED = 3, 4, 5, 6, 1, 8
_ARMED, _CUSTOM = 128, 1
ARM_AUTHORIZATION_REQUEST: Final = 3001
_CALIBRATION_S: Final = 1.0
_BUSY_S: Final = 1.0
"""Time after the last message to or from a service in which it is polled every outer period, s; rarely otherwise."""
_RARELY_S: Final = 0.1
_IMU: Final = {codec.shape(name).id: name for name in ("HIGHRES_IMU", "SCALED_IMU")}
"""Messages sent faster than the outer loop."""


class Front:
    """MAVLink interface of an autopilot on any number of links.

    Args:
        autopilot: the autopilot that it serves; its outer loop also drives this.
        before: the instance before a reboot, whose plans and files are kept.
    """

    def __init__(self, autopilot: Autopilot, before: "Front | None" = None) -> None:
        self.autopilot: Final = autopilot
        self.craft: Final = autopilot.craft
        self.commander: Final = autopilot.commander
        self.context: Final[FrontContext] = FrontContext(
            autopilot, self._handle_frame, None if before is None else before.context
        )
        context = self.context
        own = context.own
        self._commands = MavCommandServer(own, is_autopilot=True)
        self._arming: MavCommandRequest | None = None
        """An attempt to arm that waits for leave."""
        self._requested: CommandCall | None = None
        self._authorizer = MavCommandClient(own)
        self.commander.authorization.send = self._request_permission
        self.commander.on_arming_settled = self._arming_settled
        self._texts = StatusTextSender(own)
        self._heartbeat = Heartbeat(own, vehicle_type=autopilot.vehicle.mav_type, autopilot=autopilot.style.autopilot)
        context.offer("HEARTBEAT", lambda _: self._heartbeat.message())
        self.plans: Final = PlanSync(context)
        self.files: Final = OnboardFiles(autopilot.logger, autopilot.style.log_folder)
        self._events = EventSender(own)
        self._typed = ShellServer(own)
        self._shell = Shell(autopilot)
        self._serve_files()
        if before is not None:
            self.plans.load(before.plans)
            self.files.load(before.files)
        self._parameters = ParameterSync(autopilot.parameters, own, is_bytewise=context.is_px4)
        self._node = MavlinkComponent(own, self._services())
        self._listeners = {codec.shape(name).id: listen for name, listen in LISTENERS.items()}
        self._calibration: tuple[MavCommandRequest, float] | None = None
        self._busy_until_s = self._serve_s = 0.0
        self._reported = (-1, -1)
        self._reported_home: HomePosition | None = None
        self._reported_origin: TangentPlane | None = None
        self.refused_setpoints = 0
        """Setpoints that the style does not take."""
        self.refusal = ""
        """Why the last of them was refused."""
        autopilot.on_outer.append(self.tick)

    def _serve_files(self) -> None:
        """Serves the style's generated files: PX4's metadata, ArduPilot's virtual files."""
        context, autopilot = self.context, self.autopilot
        if autopilot.style.reports_by_event:
            context.health = HealthReporter(autopilot, self._events)
            files = {EVENTS: context.health.metadata, PARAMETERS: parameters_file(autopilot.parameters)}
            files[GENERAL] = general_file(EVENTS, files)
            for path, content in files.items():
                self.files.serve(path, partial(bytes, content))
            context.offer("COMPONENT_METADATA", partial(metadata_message, general=files[GENERAL]))
            return
        parameters, links = autopilot.parameters, context.router.links
        packed = partial(packed_parameters, parameters)
        queried = partial(queried_parameters, parameters)
        self.files.serve(PACKED_FILE, packed, lambda: PACKED_BYTES_EACH * len(parameters), queried)
        self.files.serve(UARTS_FILE, partial(uarts, links), lambda: UARTS_BYTES)

    def _services(self) -> tuple[Microservice[Any], ...]:
        own = self.context.own
        of_px4 = (self._events, self._typed) if self.context.is_px4 else ()
        return (
            *of_px4,
            self._commands,
            self._authorizer,
            self._texts,
            self._heartbeat,
            self.plans.server,
            self._parameters.server,
            LogServer(own, self.autopilot.logger, may_erase=True),
            FtpServer(own, self.files),
            TimeSync(own),
        )

    def add(self, service: Microservice[Any]) -> None:
        """Adds one more microservice."""
        self._node.add(service)

    # -- links --------------------------------------------------------------------------------------------------------

    def attach(self, send: Send, kind: LinkKind, *, is_datagram: bool = True) -> Receive:
        """Adds a link; returns a callable for each piece of received data."""
        return self.context.attach(send, kind, is_datagram=is_datagram)

    def send_text(self, severity: Severity, text: str) -> None:
        """Sends a status text to all."""
        self._texts.send(int(severity), text)
        self._serve_s = 0.0

    # -- in -----------------------------------------------------------------------------------------------------------

    def _handle_frame(self, frame: Frame) -> None:
        now_s = self.craft.now_s
        is_service = self._node.receive(frame, now_s)
        listen = self._listeners.get(frame.message_id)
        if listen is not None:
            message = frame.decode()
            if message is not None:
                try:
                    listen(self.context, message, frame.sender)
                except Refused as refusal:
                    self.refused_setpoints += 1
                    self.refusal = str(refusal)
        if is_service:
            self._busy_until_s = now_s + _BUSY_S
            self._serve()

    def _serve(self) -> None:
        """Runs received commands, and sends the services' messages."""
        now_s = self.craft.now_s
        self._serve_s = now_s + _RARELY_S
        self.plans.tick()
        self._parameters.tick()
        for call in self._authorizer.events():
            if call.result is not None and call.result is not CommandResult.NO_ANSWER:
                self.commander.authorization.answered(call.result, call.result_param1, call.result_param2)
        for request in self._commands.events():
            verdict = commands.handle(self.context, request)
            if request.command == commands.ARM and verdict.result is Result.IN_PROGRESS:
                self._arming = request  # it says nothing while it waits
                continue
            if verdict.result is Result.IN_PROGRESS:
                self._calibration = (request, self.craft.now_s + _CALIBRATION_S)
            self._commands.answer(request, CommandResult(int(verdict.result)), now_s=now_s)
        for typed in self._typed.events():
            self._typed.reply(typed.sender, self._shell.type(*typed))
        send = self.context.router.send
        messages = self._node.outgoing()
        if len(messages) > 1:
            self._busy_until_s = now_s + _BUSY_S
        for message in messages:
            send(message)

    def _request_permission(self, system: int) -> None:
        """Asks the authorizer of PX4's COM_ARM_AUTH_ID."""
        if self._requested is not None:
            self._authorizer.abandon(self._requested)
        now_s = self._serve_s = self.craft.now_s
        self._requested = self._authorizer.send_long(Address(system, 0), ARM_AUTHORIZATION_REQUEST, now_s=now_s)

    def _arming_settled(self, verdict: RequestVerdict) -> None:
        if self._arming is not None:
            self._commands.answer(self._arming, CommandResult(int(verdict.result)), now_s=self.craft.now_s)
            self._arming, self._serve_s = None, self.craft.now_s

    # -- out ----------------------------------------------------------------------------------------------------------

    def tick(self, now_s: float) -> None:
        """After each outer period: heartbeat, streams, services."""
        self._report_fence()
        self._update_heartbeat()
        if self._calibration is not None and now_s >= self._calibration[1]:
            self._commands.answer(self._calibration[0], CommandResult.ACCEPTED, now_s=now_s)
            self._calibration = None
        if now_s >= self._serve_s or now_s < self._busy_until_s:
            self._node.tick(now_s)
            self._serve()
        if self.context.health is not None:
            self.context.health.tick(now_s)
        for request in self.context.accelerometer.tick(now_s):
            self.context.router.send(request)
        self._send_mission()
        self._send_positions()
        self.context.stream(now_s)

    @property
    def _is_critical(self) -> bool:
        failsafes = self.autopilot.failsafes
        return failsafes.is_acting and (self.commander.style.fence_is_critical or failsafes.cause != "fence")

    def _report_fence(self) -> None:
        """A new breach is reported before the mode that answers it."""
        fence = self.commander.fence
        if fence.is_newly_broken and not self.commander.style.fence_is_critical:
            self.context.send_now("FENCE_STATUS")
        fence.is_newly_broken = False

    def _update_heartbeat(self) -> None:
        heartbeat, commander, craft = self._heartbeat, self.commander, self.craft
        base = commander.mode.base_mode | _CUSTOM | (_ARMED if craft.is_armed else 0)
        custom = commander.mode.custom_mode
        if commander.is_terminated:
            status = _TERMINATED
        elif self._is_critical:
            status = _CRITICAL
        elif not self.autopilot.estimator.is_aligned:
            status = _BOOT
        else:
            status = _ACTIVE if craft.is_armed else _STANDBY
        heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status = base, custom, status
        if (base, custom) != self._reported:
            self._reported = (base, custom)
            heartbeat.send_now()
            self._serve_s = 0.0

    def _send_mission(self) -> None:
        """Items that were reached since the last time."""
        reached = self.craft.mission.reached
        if not reached:
            return
        for index in reached:
            self.context.router.send(codec.message("MISSION_ITEM_REACHED", seq=index))
        reached.clear()
        self.context.send_now("MISSION_CURRENT")

    def _send_positions(self) -> None:
        """Home and origin, when they have changed."""
        home, origin = self.craft.home, self.autopilot.estimator.origin
        if home is not self._reported_home:
            self._reported_home = home
            self.context.send_now("HOME_POSITION")
        if origin is not self._reported_origin:
            self._reported_origin = origin
            self.context.send_now("GPS_GLOBAL_ORIGIN")
