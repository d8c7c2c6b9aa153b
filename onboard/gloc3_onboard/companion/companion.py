"""Component 191: the MAVLink services for other software, on every link of the onboard process."""

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from gloc3 import __version__
from gloc3.component.context import HostContext
from gloc3.exchange import Publisher
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
from gloc3.platform.platform import Platform
from gloc3_onboard.companion.autopilot_reporter import computer_status
from gloc3_onboard.companion.commands import Commands
from gloc3_onboard.companion.metadata import Metadata
from gloc3_onboard.companion.operator_control import OperatorControl
from gloc3_onboard.companion.parameter_table import OwnParameter
from gloc3_onboard.companion.parameters import CompanionParameters
from gloc3_onboard.companion.pending_requests import PendingRequests
from gloc3_onboard.companion.plans import PlanServer
from gloc3_onboard.process.vitals import Vitals

MOST_PEERS: Final = 64
"""Of so many it is remembered on which link they are; who was not heard for longest is forgotten."""
CONTACT_PERIOD_S: Final = 0.5
RATES_HZ: Final = {
    "CONTROL_STATUS": 1.0,
    "ONBOARD_COMPUTER_STATUS": 0.2,
    "MISSION_CURRENT": 0.0,
    "COMPONENT_METADATA": 0.0,
}
"""What can be asked for. The last two are told on request only: stations would take a MISSION_CURRENT of ours for the
autopilot's."""
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

Send = Callable[[MavlinkMessage], None]
FrameHandler = Callable[[Iterable[Frame]], None]


class _Link(NamedTuple):
    send: Send
    is_to_stations: bool


class Companion:
    """Speaks for the onboard computer on any number of links.

    Args:
        own: as whom.
        platform: the platform file.
        context: what the parts of the process share.
        look: looks at the computer.
        parameters: of the onboard computer itself.
        accepts_plans: plans that stations send to the autopilot are ours, and do not reach it.
    """

    def __init__(
        self,
        own: Address,
        platform: Platform,
        context: HostContext,
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
        self._requesting = PendingRequests(exchange, platform.platform, boot, self._loop.time, self._wake)
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
        self._producers: Mapping[int, Callable[[], MavlinkMessage]] = {
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

    def attach(self, send: Send, *, is_to_stations: bool = True) -> FrameHandler:
        """Adds a link; gives what is to be called with the frames that are heard there."""
        link = _Link(send, is_to_stations)
        self._links.append(link)
        return lambda frames: self._receive_frames(link, frames)

    def share(self, files: Files, may_write: Callable[[], bool] = lambda: True) -> None:
        """Shares files over MAVLink FTP from now on."""

        def admits(sender: Address) -> bool:
            return may_write() and self._requesting.control.holder in ("", str(sender.system))

        server = FtpServer(self.own, files, admits=admits)
        self._node.add(server)
        self._wanted |= {codec.shape(name).id for name in server.handles}

    def close(self) -> None:
        """Says nothing any more."""
        self._is_closed = True
        self._requesting.close()
        self.parameters.close()
        if self._timer is not None:
            self._timer.cancel()

    # --- what is heard ---

    def keeps(self, frame: Frame) -> bool:
        """Whether a frame of a station is not to be passed on: it belongs to a plan for the autopilot that is ours."""
        return (
            self._accepts_plans
            and frame.message_id in self._plan_ids
            and Address(frame.target_system, frame.target_component) in self._autopilots
        )

    def _receive_frames(self, link: _Link, frames: Iterable[Frame]) -> None:
        is_new = False
        for frame in frames:
            if frame.message_id == self._heartbeat_id:
                self._add_sender(frame)
            elif frame.message_id in self._wanted:
                is_new |= self._handle_frame(link, frame)
        if is_new:
            self._settle()

    def _add_sender(self, frame: Frame) -> None:
        """Notices the autopilot, and that whoever holds control by MAVLink is there."""
        if frame.system == self.own.system:
            message = frame.decode()
            if message is not None and message.autopilot != AUTOPILOT_INVALID:
                self._autopilots.add(frame.sender)
        if self.control.is_holder(frame.sender):
            self._note_contact(frame.system)

    def _handle_frame(self, link: _Link, frame: Frame) -> bool:
        """Whether a frame was for one of the services."""
        now_s = self._loop.time()
        if link.is_to_stations and self.keeps(frame):
            message = frame.decode()
            if message is None or frame.sender == self.own:
                return False
            self.plans.server.receive(_to(message, self.own), frame.sender, now_s)
        elif (
            frame.target_system not in (0, self.own.system)
            or frame.target_component not in (0, self.own.component)
            or not self._node.receive(frame, now_s)
        ):
            return False
        self._remember(frame.sender, link)
        if self.control.is_holder(frame.sender):
            self._note_contact(frame.system)
        return True

    def _remember(self, peer: Address, link: _Link) -> None:
        self._peers[peer] = link
        self._peers.move_to_end(peer)
        if len(self._peers) > MOST_PEERS:
            self._peers.popitem(last=False)

    def _note_contact(self, system: int) -> None:
        now_s = self._loop.time()
        if now_s - self._reported_contact_s >= CONTACT_PERIOD_S:
            self._reported_contact_s = now_s
            self._publisher.publish(self._contact_topic, StationHeard(station=str(system)), now_s)

    def _serves(self, sender: Address) -> bool:
        """Not the autopilot: with that, this component is the one that asks."""
        return sender not in self._autopilots

    # --- what is said ---

    def _wake(self) -> None:
        """Settles soon: something has changed that was not heard on a link."""
        if not self._is_waking and not self._is_closed:
            self._is_waking = True
            self._loop.call_soon(self._settle)

    def _settle(self) -> None:
        """Lets every service do what is due, sends what they say, and sets the alarm."""
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
        services = (self._requesting, self._node, self.commands, self.plans, self.reasons)
        next_s = earliest(*(service.next_tick_s() for service in services))
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None if next_s is None else self._loop.call_at(max(next_s, now_s), self._settle)

    def _send(self, message: MavlinkMessage) -> None:
        """To whom it is addressed, where that was heard; to all stations what is for everybody, or for who is forgotten."""
        target_system = getattr(message, "target_system", 0)
        found = self._peers.get(Address(target_system, message.target_component)) if target_system else None
        for link in self._links if found is None else (found,):
            if found is not None or link.is_to_stations:
                link.send(message)

    def _publish(self, text: str) -> None:
        event = Event(severity=Severity.WARNING, text=text)
        self._publisher.publish(self._event_topic, event, self._loop.time())

    def _boot_ms(self) -> int:
        return round((self._loop.time() - self._began_s) * 1e3) & 0xFFFF_FFFF


def _to(message: MavlinkMessage, target: Address) -> MavlinkMessage:
    """The same message, to somebody else."""
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
"""In a period; what is more is counted and told at its end."""
PERIOD_S: Final = 5.0


class Reasons:
    """Sends the reasons of refusals, limited in number.

    Args:
        tell: takes one.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self.reported = 0
        """Reasons so far, told or not."""
        self._report = report
        self._now_s = 0.0
        self._in_period = self._untold = 0
        self._ends_s: float | None = None

    def report(self, text: str) -> None:
        """Tells a reason, unless too many were told just before."""
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
