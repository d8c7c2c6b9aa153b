"""The autopilot behind a MAVLink link: telemetry in, commands and setpoints out.

It lives in the loop's thread. Samplers and the driver call it from theirs: what they read is immutable, what they
command is handed over to the loop.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.frames import Vector3
from gloc3.link import codec
from gloc3.link.codec import Address, Encoder, Parser
from gloc3.link.command import CommandCall, CommandClient, CommandResult
from gloc3.link.heartbeat import PeerChange, Peers
from gloc3.link.mission_client import MissionClient, Transfer
from gloc3.link.node import Node
from gloc3.messages import Severity
from gloc3.mission.formats.items import FenceArea
from gloc3.vehicle import AutopilotState, FlightMode
from gloc3_onboard.autopilot.ardupilot import ArduPilot
from gloc3_onboard.autopilot.fence_upload import FenceUpload
from gloc3_onboard.autopilot.px4 import Px4
from gloc3_onboard.autopilot.style import AutopilotStyle, Command
from gloc3_onboard.autopilot.telemetry import Telemetry
from gloc3_onboard.devices import Answer, Stamped, StampedHeight

COMPANION: Final = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""
TICK_S: Final = 0.1
ARDUPILOTMEGA: Final = 3
SET_MESSAGE_INTERVAL: Final = 511

IGNORE_VELOCITY: Final = 0b0000_0000_0011_1000
IGNORE_POSITION: Final = 0b0000_0000_0000_0111
IGNORE_YAW: Final = 0b0000_0100_0000_0000


class ByteLink(Protocol):
    """The part of an endpoint that is needed here."""

    @property
    def is_datagram(self) -> bool:
        """Whether each piece that is heard holds whole frames only."""

    def send(self, data: bytes) -> None:
        """Sends whole frames."""


def _say_nothing(_severity: Severity, _text: str) -> None:
    """For links whose events nobody wants."""


class AutopilotLink:
    """One autopilot: implements the telemetry, height and control devices.

    Args:
        loop: the process's loop.
        clock: its time.
        system_id: of the vehicle; an autopilot of another system is taken after it has been alone for some seconds.
        say: told what is worth an event.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        clock: Clock,
        system_id: int = 1,
        say: Callable[[Severity, str], None] = _say_nothing,
    ) -> None:
        self.own = Address(system_id, COMPANION)
        self.style: AutopilotStyle = Px4()
        self.frames_received = 0
        self._loop, self._clock, self._say = loop, clock, say
        self._endpoint: ByteLink | None = None
        self._parser = Parser()
        self._encoder = Encoder(*self.own)
        self._commands = CommandClient(self.own)
        self._peers = Peers(self.own, gone_after_s=2.5)
        self._plans = MissionClient(self.own)
        self._fence = FenceUpload(self._plans)
        self._node = Node(self.own, [self._commands, self._peers, self._plans])
        self._telemetry = Telemetry()
        self._wanted = {codec.shape(name).id for name in Telemetry.HANDLES}
        self._target: Address | None = None
        self._waiting: deque[tuple[int, Command]] = deque()
        self._calls: dict[int, CommandCall] = {}
        self._answers: dict[int, Answer] = {}
        self._tickets = 0
        self._streams: deque[tuple[int, float]] = deque()
        self._timer: asyncio.TimerHandle | None = None

    # --- life ---

    def open(self, endpoint: ByteLink) -> None:
        """Begins to talk over an endpoint, whose owner passes what it hears to `receive`."""
        self._endpoint = endpoint
        self._parser = Parser(is_datagram=endpoint.is_datagram)
        self._tick()

    def close(self) -> None:
        """Says nothing any more."""
        if self._timer is not None:
            self._timer.cancel()
        self._endpoint = None

    def receive(self, data: bytes) -> None:
        """Takes in what the endpoint has heard."""
        now_s = self._loop.time()
        for frame in self._parser.receive(data):
            self.frames_received += 1
            self._node.receive(frame, now_s)
            if frame.message_id in self._wanted and frame.sender == self._target:
                message = frame.decode()
                if message is not None:
                    self._telemetry.receive(message, now_s)
        self._settle(now_s)

    def send_message(self, message: codec.MavlinkMessage) -> None:
        """Sends one message as the companion."""
        if self._endpoint is not None:
            self._endpoint.send(self._encoder.encode(message))

    def _tick(self) -> None:
        now_s = self._loop.time()
        self._node.tick(now_s)
        self._settle(now_s)
        self._timer = self._loop.call_later(TICK_S, self._tick)

    def _settle(self, now_s: float) -> None:
        """Acts on what the services have found out, and sends what they have to say."""
        for change in self._peers.events():
            if change.peer.is_autopilot and change.peer.address == self._target:
                self._say(Severity.WARNING, f"the autopilot has {change.change}")
                if change.change in (PeerChange.RETURNED, PeerChange.RESTARTED):
                    self._ask_for_streams()
        if self._target is None:
            self._adopt(now_s)
        for call in self._commands.events():
            self._answered(call)
        for event in self._plans.events():
            ended = self._fence.heard(event, now_s) if isinstance(event, Transfer) else None
            if ended is not None:
                self._answers[ended[0]] = ended[1]
        self._pump(now_s)
        for message in self._node.outgoing():
            self.send_message(message)

    def _adopt(self, now_s: float) -> None:
        own_system = [peer for peer in self._peers.autopilots if peer.address.system == self.own.system]
        peer = own_system[0] if len(own_system) == 1 else self._peers.autopilot(now_s)
        if peer is None:
            return
        self._target = peer.address
        self.style = ArduPilot() if peer.heartbeat.autopilot == ARDUPILOTMEGA else Px4()
        self._telemetry.adopt(self.style)
        self._telemetry.receive(peer.heartbeat, now_s)
        self._say(
            Severity.INFO, f"{self.style.style} autopilot found as {peer.address.system}/{peer.address.component}"
        )
        self._ask_for_streams()

    def _ask_for_streams(self) -> None:
        self._streams = deque((stream.message_id, stream.rate_hz) for stream in self.style.streams)

    # --- commands ---

    def _pump(self, now_s: float) -> None:
        """Sends what waits; a command of a kind that is under way waits for its end."""
        if self._target is None:
            return
        for _ in range(len(self._waiting)):
            ticket, command = self._waiting.popleft()
            try:
                self._calls[ticket] = self._commands.send_long(
                    self._target, command.number, command.parameters, now_s=now_s
                )
            except Refused:
                self._waiting.append((ticket, command))
        if self._streams and not any(call.command == SET_MESSAGE_INTERVAL for call in self._calls.values()):
            number, rate_hz = self._streams.popleft()
            self._waiting.append((0, Command(SET_MESSAGE_INTERVAL, (number, 1e6 / rate_hz, 0.0, 0.0, 0.0, 0.0, 0.0))))
            self._pump(now_s)

    def _answered(self, call: CommandCall) -> None:
        if call.result is None:
            return
        for ticket, known in list(self._calls.items()):
            if known is call:
                del self._calls[ticket]
                reason = "" if call.result is CommandResult.ACCEPTED else self._why(call)
                if ticket:
                    self._answers[ticket] = Answer(call.result is CommandResult.ACCEPTED, reason)
                elif reason:
                    self._say(Severity.DEBUG, f"message interval: {reason}")

    def _why(self, call: CommandCall) -> str:
        assert call.result is not None
        reasons = "; ".join(self._telemetry.state.reasons)
        return call.result.words + (f": {reasons}" if reasons else "")

    def _command(self, command: Callable[[], Command]) -> int:
        self._tickets += 1
        ticket = self._tickets

        def enqueue() -> None:
            made = command()
            # Only the newest command of a kind matters: an older one that still waits is overtaken.
            for old in [entry for entry in self._waiting if entry[0] and entry[1].number == made.number]:
                self._waiting.remove(old)
                self._answers[old[0]] = Answer(False, "overtaken by a later command")
            self._waiting.append((ticket, made))
            self._settle(self._loop.time())

        self._post(enqueue)
        return ticket

    def _post(self, call: Callable[[], None]) -> None:
        if self._clock.is_virtual:
            call()
        else:
            self._loop.call_soon_threadsafe(call)

    # --- the control device ---

    @property
    def arm_in_mode(self) -> FlightMode | None:
        """The mode in which this style wants to be armed."""
        return self.style.arm_in_mode

    @property
    def stream_before_guided_s(self) -> float:
        """How long setpoints must have been streamed before guided mode is accepted."""
        return self.style.stream_before_guided_s

    def send_setpoint(
        self, position_ned_m: Vector3 | None, velocity_ned_m_s: Vector3 | None, yaw_rad: float | None
    ) -> None:
        """Streams one setpoint, in the autopilot's own local NED frame."""
        mask = self.style.position_mask
        mask |= IGNORE_POSITION if position_ned_m is None else 0
        mask |= IGNORE_VELOCITY if velocity_ned_m_s is None else 0
        mask |= IGNORE_YAW if yaw_rad is None else 0
        x, y, z = position_ned_m or (0.0, 0.0, 0.0)
        vx, vy, vz = velocity_ned_m_s or (0.0, 0.0, 0.0)
        yaw = yaw_rad or 0.0

        def send() -> None:
            if self._target is None:
                return
            system, component = self._target
            self.send_message(
                codec.message(
                    "SET_POSITION_TARGET_LOCAL_NED",
                    time_boot_ms=self._telemetry.boot_ms(self._loop.time()),
                    target_system=system,
                    target_component=component,
                    coordinate_frame=1,
                    type_mask=mask,
                    x=x,
                    y=y,
                    z=z,
                    vx=vx,
                    vy=vy,
                    vz=vz,
                    yaw=yaw,
                )
            )

        self._post(send)

    def command_mode(self, mode: FlightMode) -> int:
        """Asks for a mode."""
        return self._command(lambda: self.style.mode_command(mode))

    def command_arm(self) -> int:
        """Asks to arm."""
        return self._command(lambda: Command(400, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))

    def command_disarm(self) -> int:
        """Asks to disarm; the autopilot refuses it in flight."""
        return self._command(lambda: Command(400, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))

    def command_take_off(self, height_m: float) -> int:
        """Asks to climb to a height above the present place."""
        return self._command(lambda: self.style.take_off_command(height_m, self._telemetry.altitude_m))

    def command_fence(self, areas: Sequence[FenceArea]) -> int:
        """Uploads a fence and reads it back; without areas the autopilot's fence is cleared."""
        self._tickets += 1
        ticket = self._tickets

        def begin() -> None:
            now_s = self._loop.time()
            if self._target is None:
                self._answers[ticket] = Answer(False, "the autopilot has not been heard")
            else:
                self._fence.begin(ticket, areas, self._target, now_s)
                self._settle(now_s)

        self._post(begin)
        return ticket

    def answer(self, ticket: int) -> Answer | None:
        """The answer to a command; None while there is none."""
        return self._answers.get(ticket)

    # --- the telemetry devices ---

    def t_s_of_boot(self, boot_s: float) -> float | None:
        """Our time of a moment in the autopilot's own; None while nothing has been heard of it."""
        return self._telemetry.t_s_of_boot(boot_s)

    def state(self) -> AutopilotState:
        """Mode, arming, battery, as known now."""
        is_connected = self._target is not None and self._target in self._peers and self._peers[self._target].is_alive
        return self._telemetry.state_when(is_connected)

    def pose(self) -> Stamped | None:
        """The latest estimate; None before the first."""
        return self._telemetry.pose

    def height(self) -> StampedHeight | None:
        """The latest distance to the ground; None before the first."""
        return self._telemetry.height
