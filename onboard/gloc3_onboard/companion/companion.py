"""Component 191: the MAVLink services for other software, on every link of the onboard process."""

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple, Protocol

from gloc3 import __version__
from gloc3.component.context import HostContext
from gloc3.exchange import Publisher
from gloc3.exchange.base import Exchange
from gloc3.mavlink import codec
from gloc3.mavlink.codec import Frame
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.service import earliest
from gloc3.mavlink.services.files.ftp_files import Files
from gloc3.mavlink.services.files.ftp_server import FtpServer
from gloc3.mavlink.services.heartbeat import AUTOPILOT_INVALID
from gloc3.mavlink.services.interval import StreamScheduler
from gloc3.mavlink.services.version import ProtocolCapability, Version, VersionServer, version_number
from gloc3.messages.envelope import Event, Severity
from gloc3.messages.summaries import StationHeard
from gloc3.network.rights import Rights
from gloc3.network.rights_file import Right
from gloc3.platform.platform import Platform
from gloc3_onboard.companion.autopilot_reporter import computer_status
from gloc3_onboard.companion.cameras import CameraContext, CameraEntry, Cameras
from gloc3_onboard.companion.commands import Commands
from gloc3_onboard.companion.gimbal import STATUS_HZ, GimbalManager
from gloc3_onboard.companion.metadata import Metadata
from gloc3_onboard.companion.operator_control import OperatorControl
from gloc3_onboard.companion.parameter_table import OwnParameter
from gloc3_onboard.companion.parameters import CompanionParameters
from gloc3_onboard.companion.pending_requests import PendingRequests
from gloc3_onboard.companion.plans import PlanServer
from gloc3_onboard.process.vitals import Vitals

MOST_PEERS: Final = 64
"""Number of peers whose link is remembered; the least recently heard is dropped."""
CONTACT_PERIOD_S: Final = 0.5
RATES_HZ: Final = {
    "CONTROL_STATUS": 1.0,
    "ONBOARD_COMPUTER_STATUS": 0.2,
    "MISSION_CURRENT": 0.0,
    "COMPONENT_METADATA": 0.0,
}
"""Messages available on request, with their default rates. The last two are sent on request only: stations would
mistake our MISSION_CURRENT for the autopilot's."""
CAPABILITIES: Final = (
    ProtocolCapability.MISSION_FLOAT
    | ProtocolCapability.MISSION_INT
    | ProtocolCapability.MISSION_FENCE
    | ProtocolCapability.COMMAND_INT
    | ProtocolCapability.FTP
    | ProtocolCapability.MAVLINK2
    | ProtocolCapability.PARAM_ENCODE_C_CAST
    | ProtocolCapability.COMPONENT_ACCEPTS_GCS_CONTROL
)

Send = Callable[[MavlinkMessage, int], None]
"""Sends a message as a component of the vehicle."""
FrameHandler = Callable[[Iterable[Frame]], None]


class Scheduled(Protocol):
    """A part that has something to do at a time."""

    def next_tick_s(self) -> float | None:
        """That time; None for never."""


class _Link(NamedTuple):
    send: Send
    is_to_stations: bool
    member: str


class Companion:
    """MAVLink component 191, the onboard computer, on any number of links.

    Args:
        own: its MAVLink address.
        platform: the platform file.
        context: shared context of the process.
        rights: of the network's members.
        poll: reads the computer's vital signs.
        parameters: parameters of the onboard computer itself.
        accepts_plans: whether it takes over plans that stations send to the autopilot.
    """

    _cameras: Cameras | None = None
    _gimbal: GimbalManager | None = None
    _has_gimbal = False
    """Whether stations have been offered a gimbal."""

    def __init__(
        self,
        own: Address,
        platform: Platform,
        context: HostContext,
        rights: Rights,
        poll: Callable[[], Vitals] = Vitals,
        parameters: Sequence[OwnParameter] = (),
        *,
        accepts_plans: bool = False,
    ) -> None:
        self.own: Final = own
        self._clock, self._loop, self._inspect, self._accepts_plans = context.clock, context.loop, poll, accepts_plans
        exchange, boot = context.exchange, context.random.getrandbits(32)
        self._timer: asyncio.TimerHandle | None = None
        self._is_closed = self._is_waking = False
        self._began_s = self._loop.time()
        self._publisher = Publisher(exchange, platform.platform, "companion", boot)
        self._contact_topic = f"{platform.platform}/ci/heard"
        self._event_topic = f"{platform.platform}/components/companion/event"
        self.reasons: Final = Reasons(self._publish)
        self._requesting = PendingRequests(exchange, platform.platform, boot, self._loop.time, rights, self._wake)
        self.control: Final = OperatorControl(self._requesting, self._send)
        self._requesting.acted = self.control.holds
        self.parameters: Final = CompanionParameters(
            own, self._requesting, exchange, platform, parameters, self.reasons.report, self._wake
        )
        self.metadata: Final = Metadata(own, platform.platform, self.parameters.rows)
        self.plans: Final = PlanServer(own, self._requesting, platform, self._serves, self.reasons.report)
        self._streams = StreamScheduler(own, RATES_HZ)
        version = Version(capabilities=CAPABILITIES, flight_software=version_number(*_version()))
        about = VersionServer(own, version)
        self.commands: Final = Commands(
            own, self._requesting, self.control, self._streams, about, self._serves, self.reasons.report
        )
        services = (self.commands.server, self.commands.cancels, self.plans.server, self.parameters.server, about)
        self._node = MavlinkComponent(own, (*services, self._streams))
        self._wanted = {codec.shape(name).id for service in services for name in service.handles}
        self._plan_ids = {codec.shape(name).id for name in sorted(self.plans.server.handles)}
        self._heartbeat_id = codec.shape("HEARTBEAT").id
        self._producers: dict[int, Callable[[], MavlinkMessage | None]] = {
            codec.shape("CONTROL_STATUS").id: self.control.status,
            codec.shape("MISSION_CURRENT").id: self.plans.server.current_message,
            codec.shape("COMPONENT_METADATA").id: lambda: self.metadata.message(self._boot_ms()),
            codec.shape("ONBOARD_COMPUTER_STATUS").id: lambda: computer_status(self._inspect(), self._clock.utc_s()),
        }
        self._links: list[_Link] = []
        self._peers: OrderedDict[Address, _Link] = OrderedDict()
        self._autopilots: set[Address] = set()
        self._reported_contact_s = float("-inf")
        self._wake()

    def attach(self, send: Send, *, is_to_stations: bool = True, member: str = "") -> FrameHandler:
        """Adds a link; returns a callable for frames received there.

        Args:
            send: sends a message on the link, as a component.
            is_to_stations: False for the autopilot's.
            member: of the network, for whom the link's key stands.
        """
        link = _Link(send, is_to_stations, member)
        self._links.append(link)
        return lambda frames: self._receive_frames(link, frames)

    def share(self, files: Files, may_write: Callable[[], bool] = lambda: True) -> None:
        """Serves files over MAVLink FTP from now on."""

        def admits(sender: Address) -> bool:
            is_free = self._requesting.control.holder in ("", str(sender.system))
            return may_write() and is_free and self._requesting.may(sender.system, Right.FLY)

        server = FtpServer(self.own, files, admits=admits)
        self._node.add(server)
        self._wanted |= {codec.shape(name).id for name in server.handles}

    def add_cameras(self, entries: Sequence[CameraEntry], platform: str, exchange: Exchange) -> list[Address]:
        """Offers cameras as components of their own; returns their addresses."""
        context = CameraContext(
            self._inspect, self._boot_ms_at, self._clock.utc_offset, self._serves, self.reasons.report, self._wake
        )
        self._cameras = Cameras(self.own.system, entries, platform, exchange, self._requesting, context)
        self._wake()
        return [camera.own for camera in self._cameras.components]

    def add_gimbal(self, platform: str, exchange: Exchange, boot: int) -> None:
        """Offers the gimbal manager; stations find it once there is a gimbal."""
        gimbal = self._gimbal = GimbalManager(
            self.own, platform, exchange, boot, self._requesting, self._gimbal_changed, self.reasons.report
        )
        self._node.add(gimbal)
        self._wanted |= {codec.shape(name).id for name in gimbal.handles}
        self.commands.add(gimbal.commands)
        self._producers |= {
            codec.shape("GIMBAL_MANAGER_INFORMATION").id: lambda: gimbal.information(self._boot_ms()),
            codec.shape("GIMBAL_MANAGER_STATUS").id: lambda: gimbal.status(self._boot_ms()),
        }

    def _gimbal_changed(self) -> None:
        """Offers the manager's messages from the first gimbal on, and sends its status when it has changed."""
        gimbal = self._gimbal
        if gimbal is None or gimbal.problem:
            return
        now_s = self._loop.time()
        if not self._has_gimbal:
            self._has_gimbal = True
            self._streams.offer("GIMBAL_MANAGER_INFORMATION", 0.0, now_s)
            self._send(gimbal.information(self._boot_ms()))
        self._streams.offer("GIMBAL_MANAGER_STATUS", STATUS_HZ, now_s)
        self._wake()

    def close(self) -> None:
        """Stops sending."""
        self._is_closed = True
        if self._gimbal is not None:
            self._gimbal.close()
        if self._cameras is not None:
            self._cameras.close()
        self._requesting.close()
        self.parameters.close()
        if self._timer is not None:
            self._timer.cancel()

    # --- what is heard ---

    def keeps(self, frame: Frame) -> bool:
        """Whether a station's frame is withheld from the autopilot, as part of a plan taken over here."""
        return (
            self._accepts_plans
            and frame.message_id in self._plan_ids
            and Address(frame.target_system, frame.target_component) in self._autopilots
        )

    def _receive_frames(self, link: _Link, frames: Iterable[Frame]) -> None:
        is_new = False
        for frame in frames:
            if frame.message_id == self._heartbeat_id:
                self._add_sender(link, frame)
            elif frame.message_id in self._wanted:
                is_new |= self._handle_frame(link, frame)
        if is_new:
            self._settle()

    def _add_sender(self, link: _Link, frame: Frame) -> None:
        """Registers the autopilot, and activity of the holder of control on MAVLink."""
        if frame.system == self.own.system:
            message = frame.decode()
            if message is not None and message.autopilot != AUTOPILOT_INVALID:
                self._autopilots.add(frame.sender)
        if self.control.is_holder(frame.sender):
            self._note_contact(frame.system, link.member)

    def _handle_frame(self, link: _Link, frame: Frame) -> bool:
        """Whether a frame was for one of the services."""
        now_s = self._loop.time()
        self._requesting.members[str(frame.system)] = link.member
        if link.is_to_stations and self.keeps(frame):
            message = frame.decode()
            if message is None or frame.sender == self.own:
                return False
            self.plans.server.receive(_to(message, self.own), frame.sender, now_s)
        elif frame.target_system not in (0, self.own.system) or not self._deliver(frame, now_s):
            return False
        self._remember(frame.sender, link)
        if self.control.is_holder(frame.sender):
            self._note_contact(frame.system, link.member)
        return True

    def _deliver(self, frame: Frame, now_s: float) -> bool:
        """Passes a frame to the components that it is for; returns whether one of their services handles it."""
        target = frame.target_component
        cameras = self._cameras.addressed(target) if self._cameras is not None else []
        handled = [camera.receive(frame, now_s) for camera in cameras]
        if target in (0, self.own.component):
            handled.append(self._node.receive(frame, now_s))
        return any(handled)

    def _remember(self, peer: Address, link: _Link) -> None:
        self._peers[peer] = link
        self._peers.move_to_end(peer)
        if len(self._peers) > MOST_PEERS:
            self._peers.popitem(last=False)

    def _note_contact(self, system: int, member: str) -> None:
        now_s = self._loop.time()
        if now_s - self._reported_contact_s >= CONTACT_PERIOD_S:
            self._reported_contact_s = now_s
            self._publisher.publish(self._contact_topic, StationHeard(station=str(system), member=member), now_s)

    def _serves(self, sender: Address) -> bool:
        """Whether a sender is served; the autopilot is not, since the companion is its client."""
        return sender not in self._autopilots

    # --- what is said ---

    def _wake(self) -> None:
        """Schedules a pass soon, after a change that was not received on a link."""
        if not self._is_waking and not self._is_closed:
            self._is_waking = True
            self._loop.call_soon(self._settle)

    def _settle(self) -> None:
        """Runs all due services, sends their messages, and sets the next alarm."""
        self._is_waking = False
        if self._is_closed:
            return
        now_s = self._loop.time()
        self._requesting.tick(now_s)
        self._node.tick(now_s)
        self.commands.tick(now_s)
        self.plans.tick(now_s)
        self.parameters.tick()
        self.control.tick()
        self.reasons.tick(now_s)
        for number in self._streams.due(now_s):
            self._send(self._producers[number]())
        for message in self._node.outgoing():
            self._send(message)
        services: list[Scheduled] = [self._requesting, self._node, self.commands, self.plans, self.reasons]
        if self._cameras is not None:
            services.append(self._cameras)
            self._cameras.tick(now_s)
            for component, message in self._cameras.outgoing():
                self._send(message, component)
        next_s = earliest(*(service.next_tick_s() for service in services))
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None if next_s is None else self._loop.call_at(max(next_s, now_s), self._settle)

    def _send(self, message: MavlinkMessage | None, component: int | None = None) -> None:
        """Sends to the target's link, if known; broadcasts, and messages for dropped peers, to all stations."""
        if message is None:
            return
        target_system = getattr(message, "target_system", 0)
        found = self._peers.get(Address(target_system, message.target_component)) if target_system else None
        for link in self._links if found is None else (found,):
            if found is not None or link.is_to_stations:
                link.send(message, self.own.component if component is None else component)

    def _publish(self, text: str) -> None:
        event = Event(severity=Severity.WARNING, text=text)
        self._publisher.publish(self._event_topic, event, self._loop.time())

    def _boot_ms(self) -> int:
        return self._boot_ms_at(self._loop.time())

    def _boot_ms_at(self, t_s: float) -> int:
        return round((t_s - self._began_s) * 1e3) & 0xFFFF_FFFF


def _to(message: MavlinkMessage, target: Address) -> MavlinkMessage:
    """The same message for another target."""
    fields = {field.attribute: getattr(message, field.attribute) for field in message.shape.fields}
    return codec.message(
        message.name, **{**fields, "target_system": target.system, "target_component": target.component}
    )


def _version() -> tuple[int, int, int]:
    """Our version in three numbers."""
    numbers = [int(part) for part in __version__.split(".")[:3] if part.isdecimal()]
    major, minor, patch = (*numbers, 0, 0, 0)[:3]
    return major, minor, patch


MOST: Final = 8
"""Greatest number in a period; the rest is counted and reported at its end."""
PERIOD_S: Final = 5.0


class Reasons:
    """Sends the reasons of refusals, rate-limited.

    Args:
        report: called with each reason.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self.reported = 0
        """Number of reasons so far, sent or not."""
        self._report = report
        self._now_s = 0.0
        self._in_period = self._untold = 0
        self._ends_s: float | None = None

    def report(self, text: str) -> None:
        """Sends a reason, unless the limit is reached."""
        self.reported += 1
        if self._in_period >= MOST:
            self._untold += 1
            return
        self._in_period += 1
        if self._ends_s is None:
            self._ends_s = self._now_s + PERIOD_S
        self._report(text)

    def tick(self, now_s: float) -> None:
        """Begins a new period when it is time."""
        self._now_s = now_s
        if self._ends_s is None or now_s < self._ends_s:
            return
        untold, self._untold, self._in_period, self._ends_s = self._untold, 0, 0, None
        if untold:
            self._report(f"and {untold} more refusals")

    def next_tick_s(self) -> float | None:
        """When the period ends."""
        return self._ends_s
