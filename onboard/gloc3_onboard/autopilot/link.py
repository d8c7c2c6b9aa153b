"""The autopilot behind a MAVLink link: telemetry in, commands and setpoints out.

It lives in the loop's thread. Samplers and the driver call it from theirs: what they read is immutable, what they
command is handed over to the loop.
"""

import asyncio
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, Protocol

from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.mavlink import codec
from gloc3.mavlink.codec import Address, Encoder, Frame
from gloc3.mavlink.node import Node
from gloc3.mavlink.service import Service
from gloc3.mavlink.services.command_client import CommandClient
from gloc3.mavlink.services.heartbeat import PeerChange, Peers
from gloc3.mavlink.services.mission_client import MissionClient, Transfer
from gloc3.mavlink.services.statustext import StatusTextReceiver
from gloc3.mavlink.signed_only import SignedOnly
from gloc3.mavlink.signing import Signing, timestamp
from gloc3.messages.envelope import Severity
from gloc3.messages.vehicle import FlightMode, Pose, Style
from gloc3.mission.formats.items import FenceArea
from gloc3_onboard.autopilot.arm_leave import ArmLeave
from gloc3_onboard.autopilot.clockwork import Clockwork
from gloc3_onboard.autopilot.commands import NOBODY, CommandDesk
from gloc3_onboard.autopilot.families import NOT_SUPPORTED, style_of
from gloc3_onboard.autopilot.fence_upload import FenceUpload
from gloc3_onboard.autopilot.inspection import Inspection
from gloc3_onboard.autopilot.lead import Lead
from gloc3_onboard.autopilot.plan_upload import PlanUpload
from gloc3_onboard.autopilot.prearm import PrearmQuestions
from gloc3_onboard.autopilot.px4 import Px4
from gloc3_onboard.autopilot.sensors import AutopilotSensors
from gloc3_onboard.autopilot.streams import StreamRequests
from gloc3_onboard.autopilot.style import ARM_DISARM, DO_SET_HOME, PROGRESS, SET_EKF_SOURCE_SET, AutopilotStyle, Command
from gloc3_onboard.autopilot.telemetry import Telemetry
from gloc3_onboard.autopilot.told import ToldByAutopilot
from gloc3_onboard.autopilot.vision import Spread, odometry_message, origin_message
from gloc3_onboard.checks.tables import table_of
from gloc3_onboard.sensors.devices import Answer, AutopilotSetpoint, Manners, Way

FORCE: Final = 21196.0
"""What COMPONENT_ARM_DISARM takes for disarming in flight (MAVLink, MAV_CMD_COMPONENT_ARM_DISARM)."""
COMPANION: Final = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""
BEHIND_S: Final = 0.3
"""So long after somebody else's request for rates it is made sure that ours hold."""
TICK_S: Final = 0.1
ONE_RESTART_S: Final = 3.0
"""Signs of a restart that come within this are of the same one."""


class FrameLink(Protocol):
    """A link that sends frames, as a routed link does."""

    def send(self, frame: Frame) -> None:
        """Sends one frame of our own."""


def _say_nothing(_severity: Severity, _text: str) -> None:
    """For links whose events nobody wants."""


class AutopilotLink(ToldByAutopilot):
    """One autopilot: implements the telemetry, height and control devices.

    Args:
        loop: the process's loop.
        clock: its time.
        system_id: of the vehicle; an autopilot of another system is taken after it has been alone for some seconds.
        say: told what is worth an event.
        signing: signs all that is sent, and judges all that is heard; None on a link without a key.
        why_not_arm: asked when the autopilot asks for leave to arm; gives why it must not, or an empty text.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        clock: Clock,
        system_id: int = 1,
        say: Callable[[Severity, str], None] = _say_nothing,
        signing: Signing | None = None,
        why_not_arm: Callable[[], str] = lambda: "nobody here gives leave to arm",
    ) -> None:
        self.own = Address(system_id, COMPANION)
        self.style: AutopilotStyle = Px4()
        self.frames_received = 0
        self._loop, self._clock, self._say = loop, clock, say
        self._link: FrameLink | None = None
        self._signing = signing
        self._encoder = Encoder(*self.own, signing)
        self.signed_only: Final = None if signing is None else SignedOnly(signing, partial(say, Severity.WARNING))
        """Judges what is heard, for whoever passes it to `take`; None on a link without a key."""
        self._commands = CommandClient(self.own)
        self._peers = Peers(self.own, gone_after_s=2.5)
        self._plans = MissionClient(self.own)
        self._fence = FenceUpload(self._plans)
        self._plan = PlanUpload(self._plans)
        self._texts = StatusTextReceiver(self.own)
        super().__init__(
            Telemetry(),
            AutopilotSensors(lambda: self._post(self._ask_for_sensors)),
            Inspection(self.own, self._commands),
        )
        self._clockwork = Clockwork(self.own, self._telemetry)
        self._lead = Lead(self._telemetry)
        self._leave = ArmLeave(self.own, why_not_arm)
        services: list[Service[Any]] = [
            self._commands,
            self._peers,
            self._plans,
            self._texts,
            self._inspection,
            self._clockwork.service,
            self._leave,
        ]
        self._node = Node(self.own, services)
        self._wanted = {codec.shape(name).id for name in (*Telemetry.HANDLES, *AutopilotSensors.HANDLES)}
        self._target: Address | None = None
        self._kind = (-1, -1)
        """MAV_AUTOPILOT and MAV_TYPE by which its style was chosen."""
        self._strangers: set[Address] = set()
        self._desk = CommandDesk(self._commands, self._telemetry.texts_since)
        self._streams = StreamRequests(self._commands)
        self._requests_at_once = 0
        self._prearm = PrearmQuestions(self._commands)
        self._restarts = 0
        self._restarted_s = -math.inf
        self._timer: asyncio.TimerHandle | None = None

    # --- life ---

    def open(self, link: FrameLink) -> None:
        """Begins to send by a link, whose owner passes the frames that it receives to `take`."""
        self._link = link
        self._tick()

    def close(self) -> None:
        """Says nothing any more."""
        if self._timer is not None:
            self._timer.cancel()
        self._link = None

    def take(self, frames: Sequence[Frame]) -> None:
        """Handles frames of the link."""
        now_s, is_settled = self._loop.time(), True
        for frame in frames:
            self.frames_received += 1
            if self._node.receive(frame, now_s):
                is_settled = False
            if frame.message_id in self._wanted and frame.sender == self._target:
                self._streams.heard(frame.message_id, now_s)
                message = frame.decode()
                if message is not None:
                    self._telemetry.receive(message, now_s)
                    self.sensors.receive(message, now_s, self._telemetry)
        if not is_settled:
            self._settle(now_s)
        self.ring_for_news()

    def send_message(self, message: codec.MavlinkMessage) -> None:
        """Sends one message as the companion."""
        if self._link is not None:
            if self._signing is not None:
                self._signing.advance(timestamp(self._clock.utc_s()))
            self._link.send(self._encoder.frame(message))

    def _tick(self) -> None:
        now_s = self._loop.time()
        self._node.tick(now_s)
        self._settle(now_s)
        self.ring_for_news()
        self._timer = self._loop.call_later(TICK_S, self._tick)

    def _settle(self, now_s: float) -> None:
        """Acts on what the services have found out, and sends what they have to say."""
        for change in self._peers.events():
            if change.peer.address == self._target:
                if change.change is PeerChange.RESTARTED:
                    self._restarted(now_s)
                    continue
                self._say(Severity.WARNING, f"the autopilot has {change.change}")
                if change.change is PeerChange.RETURNED:
                    self._ask_all(now_s)
        self._clockwork.look(now_s)
        if self._telemetry.restarts != self._restarts:
            self._restarts = self._telemetry.restarts
            self._restarted(now_s)
        self._reconsider(now_s)
        if self._target is None:
            self._adopt(now_s)
        for call in self._commands.events():
            self._desk.ended(call, now_s)
            self._streams.ended(call, now_s)
            self._prearm.ended(call)
            self._inspection.ended(call, now_s)
        for said in self._texts.events():
            if said.sender == self._target:
                self._telemetry.hear(said.severity, said.text, now_s)
        for event in self._plans.events():
            if isinstance(event, Transfer):
                ended = self._fence.heard(event, now_s) or self._plan.heard(event, now_s)
                if ended is not None:
                    self._desk.put(*ended)
            elif event.sender == self._target:
                self._plan.follow(event)
        self._desk.tick(now_s)
        is_alive = self._target is not None and self._target in self._peers and self._peers[self._target].is_alive
        self._telemetry.connected(is_alive)
        if self._target is not None and is_alive:
            self._streams.tick(self._target, now_s)
            self._prearm.tick(self._target, self._telemetry.state, now_s)
        for text in self._streams.refused:
            self._say(Severity.NOTICE, f"the autopilot refuses {text}")
        self._streams.refused.clear()
        for message in self._node.outgoing():
            self.send_message(message)

    def _restarted(self, now_s: float) -> None:
        """Begins anew with an autopilot that has; several signs of it are one restart."""
        if now_s - self._restarted_s < ONE_RESTART_S:
            return
        self._restarted_s = now_s
        self._say(Severity.WARNING, "the autopilot has restarted")
        self._ask_all(now_s)

    def _adopt(self, now_s: float) -> None:
        """Takes the one autopilot of our own system, or one that has been alone for some seconds."""
        own_system = [peer for peer in self._peers.autopilots if peer.address.system == self.own.system]
        known = [peer for peer in own_system if style_of(peer.heartbeat) is not None]
        peer = known[0] if len(known) == 1 else self._peers.autopilot(now_s)
        if peer is None or peer.address in self._strangers:
            return
        style, name = style_of(peer.heartbeat), f"{peer.address.system}/{peer.address.component}"
        if style is None:
            self._strangers.add(peer.address)
            number = f"MAV_AUTOPILOT {peer.heartbeat.autopilot}, MAV_TYPE {peer.heartbeat.type}"
            self._say(Severity.ERROR, f"{name} is {NOT_SUPPORTED} ({number}): it is left alone")
            return
        self._target = peer.address
        self._say(Severity.INFO, f"{style.style} autopilot found as {name}, of a {style.facts.vehicle}")
        self._take_for(style, peer.heartbeat, now_s)

    def _reconsider(self, now_s: float) -> None:
        """Looks whether the autopilot is still what it was: another firmware may have been loaded into it."""
        if self._target is None or self._target not in self._peers:
            return
        heartbeat = self._peers[self._target].heartbeat
        if heartbeat.autopilot == self._kind[0] and heartbeat.type == self._kind[1]:
            return
        self._kind = (heartbeat.autopilot, heartbeat.type)
        style = style_of(heartbeat)
        if style is None:
            self._say(Severity.ERROR, f"the autopilot has become {NOT_SUPPORTED}: it is left alone")
            self._desk.abandon(NOBODY)
            self._target = None
            self._telemetry.connected(False)
        elif (style.style, style.facts.vehicle) != (self.style.style, self.style.facts.vehicle):
            self._say(Severity.WARNING, f"the autopilot is a {style.style} of a {style.facts.vehicle} now")
            self._desk.abandon("the autopilot has become another one")
            self._take_for(style, heartbeat, now_s)

    def _take_for(self, style: AutopilotStyle, heartbeat: codec.MavlinkMessage, now_s: float) -> None:
        """Speaks to it as to one of this family and class from now on."""
        self.style, self._kind = style, (heartbeat.autopilot, heartbeat.type)
        self._telemetry.adopt(style)
        self._telemetry.receive(heartbeat, now_s)
        self._ask_all(now_s)

    def _ask_all(self, now_s: float) -> None:
        """Asks for everything that we need of the autopilot."""
        self._leave.autopilot = self._target
        self._clockwork.service.ask(self._target)
        self._prearm.restart()
        self._streams.ask_all([*self.style.streams, *self.sensors.streams(self.style.style)])
        if self._target is not None:
            self._inspection.adopt(
                self._target,
                self.style.style,
                self.style.facts.vehicle,
                table_of(self.style.style, self.style.facts.vehicle).names(),
                now_s,
            )

    def ask_streams_again(self) -> None:
        """Somebody has changed what the autopilot sends on our link: what we need follows right behind his request.

        All of it at once, since until then it comes too seldom; then one after the other, with the answers.
        """
        if self._target is None:
            return
        streams = [*self.style.streams, *self.sensors.streams(self.style.style)]
        self._requests_at_once += 1
        for stream in streams:
            self.send_message(stream.request(self._target, self._requests_at_once % 10))
        self._loop.call_later(BEHIND_S, self._streams.ask_all, streams)

    def _ask_for_sensors(self) -> None:
        """Asks for what sensors are used, once there is an autopilot."""
        if self._target is not None:
            for stream in self.sensors.streams(self.style.style):
                self._streams.ask(stream)

    # --- commands ---

    def _command(self, make: Callable[[], Command | Answer]) -> int:
        """Sends what `make` gives in the loop's thread, or keeps its answer where that is one."""
        ticket = self._desk.ticket()

        def send() -> None:
            now_s, made = self._loop.time(), make()
            if isinstance(made, Answer):
                self._desk.put(ticket, made)
            else:
                self._desk.send(ticket, made, self._target, now_s)
            self._settle(now_s)

        self._post(send)
        return ticket

    def _post(self, call: Callable[[], None]) -> None:
        if self._clock.is_virtual:
            call()
        else:
            self._loop.call_soon_threadsafe(call)

    # --- the control device ---

    @property
    def manners(self) -> Manners:
        """How the autopilot that is there now wants to be commanded."""
        return self.style.facts.manners

    def send_setpoint(self, setpoint: AutopilotSetpoint) -> None:
        """Streams one setpoint."""

        def send() -> None:
            if self._target is None:
                return
            message = self._lead.message(setpoint, self.style.facts, self._target, self._loop.time())
            if message is not None:
                self.send_message(message)
            if self._lead.gap:
                self._say(Severity.WARNING, self._lead.gap)
                self._lead.gap = ""

        self._post(send)

    def send_pose(self, pose: Pose, t_s: float, attitude_std_rad: float, velocity_std_m_s: float) -> None:
        """Tells the autopilot where it is, by a pose of the time `t_s`."""
        spread = Spread(attitude_std_rad, velocity_std_m_s)

        def send() -> None:
            if self._target is not None:
                boot_s = self._clockwork.boot_s(min(t_s, self._loop.time()))
                self.send_message(odometry_message(pose, max(0, round(boot_s * 1e6)), spread))

        self._post(send)

    def command_source_set(self, number: int) -> int:
        """Asks ArduPilot's estimator to fly by the set of sources 1, 2 or 3."""

        def make() -> Command | Answer:
            if self.style.style is not Style.ARDUPILOT:
                return Answer(False, "PX4 has no sets of sources: EKF2_EV_CTRL and EKF2_GPS_CTRL choose them")
            return Command(SET_EKF_SOURCE_SET, (float(number), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))

        return self._command(make)

    def command_home(self, place_geo: tuple[float, float, float]) -> int:
        """Tells the autopilot where home is, which it has from nobody without satellites."""
        latitude, longitude, altitude = place_geo
        return self._command(lambda: Command(DO_SET_HOME, (0.0, 0.0, 0.0, 0.0, latitude, longitude, altitude)))

    def send_origin(self, origin_geo: tuple[float, float, float]) -> None:
        """Tells the autopilot where the frame of the poses begins."""

        def send() -> None:
            if self._target is not None:
                self.send_message(origin_message(origin_geo, self._target))

        self._post(send)

    def command_mode(self, mode: FlightMode) -> int:
        """Asks for a mode."""
        return self._command(lambda: self.style.mode_command(mode))

    def command_arm(self) -> int:
        """Asks to arm."""
        return self._command(lambda: Command(ARM_DISARM, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))

    def command_disarm(self, *, is_forced: bool = False) -> int:
        """Asks to disarm; the autopilot refuses it in flight, unless it is forced."""
        force = FORCE if is_forced else 0.0
        return self._command(lambda: Command(ARM_DISARM, (0.0, force, 0.0, 0.0, 0.0, 0.0, 0.0)))

    def command_take_off(self, height_m: float) -> int:
        """Asks to climb to a height above the present place."""

        def make() -> Command | Answer:
            ground_m = self._telemetry.altitude_m
            if ground_m is None:
                return Answer(False, "the autopilot has not told its altitude yet")
            return self.style.take_off_command(height_m, ground_m)

        return self._command(make)

    def command_fence(self, areas: Sequence[FenceArea]) -> int:
        """Uploads a fence and reads it back; without areas the autopilot's fence is cleared."""
        ticket = self._desk.ticket()

        def begin() -> None:
            now_s = self._loop.time()
            if self._target is None:
                self._desk.put(ticket, Answer(False, "the autopilot has not been heard"))
            else:
                self._fence.begin(ticket, areas, self._target, now_s)
                self._settle(now_s)

        self._post(begin)
        return ticket

    def command_plan(self, way: Way) -> int:
        """Uploads the plan of a way and reads it back."""
        ticket = self._desk.ticket()

        def begin() -> None:
            now_s = self._loop.time()
            if self._target is None:
                self._desk.put(ticket, Answer(False, NOBODY))
                return
            try:
                self._plan.begin(ticket, way, self.style.style, self._target, now_s)
            except Refused as refusal:
                self._desk.put(ticket, Answer(False, str(refusal)))
            else:
                self._streams.ask(PROGRESS)
                self._settle(now_s)

        self._post(begin)
        return ticket

    @property
    def places_reached(self) -> int:
        """Places that the autopilot has passed of the way that it was given last."""
        return self._plan.reached

    def answer(self, ticket: int) -> Answer | None:
        """The answer to a command; None while there is none."""
        return self._desk.answer(ticket)

    def abandon_commands(self) -> None:
        """Sends nothing again that was commanded so far."""
        self._post(lambda: self._desk.abandon("somebody else has control"))

    def read_setup(self, number: int) -> None:
        """Reads these anew; the end is told with this number."""
        self._post(lambda: self._inspection.read(number, self._loop.time()))
