"""The MAVLink conversation with one autopilot: telemetry, requests, and the replies to commands.

It lives in the loop's thread; `gloc3_onboard.autopilot.device` is its face to samplers and drivers.
"""

import asyncio
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, Protocol

from gloc3.clock import Clock
from gloc3.mavlink import codec
from gloc3.mavlink.codec import Address, Encoder, Frame
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3.mavlink.services.mission_client import MissionClient, Transfer
from gloc3.mavlink.services.statustext import StatusTextReceiver
from gloc3.mavlink.signing import SignedOnly, Signing, timestamp
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import EventReport
from gloc3.messages.vehicle import Style, VehicleClass
from gloc3_onboard.autopilot.arm_authority import ArmPermissionRequest
from gloc3_onboard.autopilot.commands import NO_OWNER, CommandDesk
from gloc3_onboard.autopilot.events import AutopilotEvents
from gloc3_onboard.autopilot.identification import Identification, IdentityChange
from gloc3_onboard.autopilot.inspection import Inspection
from gloc3_onboard.autopilot.link_reports import AlertRelay
from gloc3_onboard.autopilot.plan_upload import FenceUpload, FileUpload, PlanUpload
from gloc3_onboard.autopilot.sensors import AutopilotSensors
from gloc3_onboard.autopilot.streams import StreamRequests, origin_request, prearm_checks
from gloc3_onboard.autopilot.style import AutopilotStyle, MessageStream
from gloc3_onboard.autopilot.telemetry import ClockOffset, Telemetry
from gloc3_onboard.checks.tables import table_of
from gloc3_onboard.payload.gimbal_link import GimbalLink
from gloc3_onboard.sensors.devices import Bell

COMPANION: Final = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""
BEHIND_S: Final = 0.3
"""Time after another station's request for rates at which ours are restored, s."""
TICK_S: Final = 0.1
STALLED_S: Final = 0.5
"""Lateness of a tick from which silence meanwhile is this process's own, s."""
FENCE_LOAD_S: Final = 3.0
"""Time within which ArduPilot loads an uploaded fence, s; until then it answers that there is none to switch on."""
ONE_RESTART_S: Final = 3.0
"""Signs of a restart that come within this are of the same one."""


class FrameLink(Protocol):
    """A link that sends frames, such as a routed link."""

    def send(self, frame: Frame) -> None:
        """Sends one frame of our own."""


def _report_nothing(_severity: Severity, _text: str, /, *, cause: str = "") -> None:
    """Discards the events of a link."""


class AutopilotLink:
    """The conversation with one autopilot.

    Args:
        loop: the process's loop.
        clock: its time.
        system_id: MAVLink system of the vehicle; an autopilot of another system is accepted after it has been alone for
            some seconds.
        report: called with events.
        signing: signs sent and verifies received frames; None without a key.
        why_not_arm: returns the reason against arming for an authorization request; empty for none.
        more_names: returns further parameters to read besides those of the pre-flight checks, by family and class.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        clock: Clock,
        system_id: int = 1,
        report: EventReport = _report_nothing,
        signing: Signing | None = None,
        why_not_arm: Callable[[], str] = lambda: "there is no arm authority here",
        more_names: Callable[[Style, VehicleClass], Sequence[str]] = lambda _style, _vehicle: (),
    ) -> None:
        own = self.own = Address(system_id, COMPANION)
        self.loop: Final = loop
        self.frames_received = 0
        self.reports: Final = Bell()
        """Rung after frames were handled, and with each tick."""
        self._clock, self._report, self._signing = clock, report, signing
        self._link: FrameLink | None = None
        self._encoder = Encoder(*own, signing)
        self.signed_only: Final = None if signing is None else SignedOnly(signing, partial(report, Severity.WARNING))
        """Accepts or rejects frames before `receive_frames`; None without a key."""
        self.telemetry: Final = Telemetry()
        self.sensors: Final = AutopilotSensors(lambda: self.post(self._request_sensors))
        self.events: Final = AutopilotEvents(own)
        self._alerts: Final = AlertRelay(report)
        handled = (*Telemetry.HANDLES, *AutopilotSensors.HANDLES, "EVENT")
        self._received_here = {codec.shape(name).id for name in handled}
        self._identification = Identification(own, report)
        self.clock_offset: Final = ClockOffset(own, self.telemetry)
        self._leave = ArmPermissionRequest(own, why_not_arm)
        self._client, self._plans, self._texts = MavCommandClient(own), MissionClient(own), StatusTextReceiver(own)
        self.commands: Final = CommandDesk(self._client, self.telemetry.texts_since)
        self.inspection: Final = Inspection(own, self._client, self._plans)
        self.gimbal: Final = GimbalLink(own, self._client, self.post, self.settle)
        self._more_names = more_names
        self.fence: Final = FenceUpload(self._plans)
        self.plan: Final = PlanUpload(self._plans)
        self.file: Final = FileUpload(self._plans)
        self._streams = StreamRequests(self._client)
        self._prearm, self._origin = prearm_checks(self._client), origin_request(self._client)
        services: list[Microservice[Any]] = [
            *(self._client, self._identification.peers, self._plans, self._texts),
            *(self.inspection, self.clock_offset.service, self._leave, self.events.ftp, self.gimbal),
        ]
        self._node = MavlinkComponent(own, services)
        self.contacts = 0
        """Times that an autopilot was found, came back or restarted."""
        self._requests_at_once = self._restarts = 0
        self._ticked_s = math.inf
        self._restarted_s = -math.inf
        self._timer: asyncio.TimerHandle | None = None

    # --- life ---

    def open(self, link: FrameLink) -> None:
        """Starts sending on a link, whose owner passes received frames to `receive_frames`."""
        self._link = link
        self._tick()

    def close(self) -> None:
        """Sends nothing any more."""
        if self._timer is not None:
            self._timer.cancel()
        self._link = None

    def post(self, call: Callable[[], None]) -> None:
        """Calls in the loop's thread, from any thread; at once in virtual time."""
        if self._clock.is_virtual:
            call()
        else:
            self.loop.call_soon_threadsafe(call)

    @property
    def target(self) -> Address | None:
        """The autopilot; None while there is none."""
        return self._identification.target

    @property
    def heartbeat(self) -> codec.MavlinkMessage | None:
        """The autopilot's last heartbeat; None while there is none."""
        return self._identification.heartbeat

    @property
    def style(self) -> AutopilotStyle:
        """How its family and class is spoken to."""
        return self._identification.style

    # --- frames ---

    def receive_frames(self, frames: Sequence[Frame]) -> None:
        """Handles frames of the link."""
        now_s, is_settled = self.loop.time(), True
        for frame in frames:
            self.frames_received += 1
            if self._node.receive(frame, now_s):
                is_settled = False
            if frame.message_id in self._received_here and frame.sender == self.target:
                self._streams.received(frame.message_id, now_s)
                message = frame.decode()
                if message is not None and message.name == "EVENT":
                    self.events.receive(message, self.telemetry.custom_mode)
                elif message is not None:
                    self.telemetry.receive(message, now_s)
                    self.sensors.receive(message, now_s, self.telemetry)
        if not is_settled:
            self.settle()
        self.reports.ring()

    def send_message(self, message: codec.MavlinkMessage) -> None:
        """Sends one message as the companion."""
        if self._link is not None:
            if self._signing is not None:
                self._signing.advance(timestamp(self._clock.utc_s()))
            self._link.send(self._encoder.frame(message))

    def _tick(self) -> None:
        now_s = self.loop.time()
        late_s = now_s - self._ticked_s - TICK_S
        if late_s >= STALLED_S:
            self._identification.peers.stalled(late_s)
        self._ticked_s = now_s
        self._node.tick(now_s)
        self.settle()
        self.reports.ring()
        self._timer = self.loop.call_later(TICK_S, self._tick)

    # --- what follows from them ---

    def settle(self) -> None:
        """Acts on the services' results and sends their messages; called after each use of a service."""
        now_s = self.loop.time()
        self._follow_identity(now_s)
        self._end_calls(now_s)
        for said in self._texts.events():
            if said.sender == self.target:
                self.telemetry.receive_text(said.severity, said.text, now_s)
                if not (self.events.is_readable and said.text.endswith("\t")):  # PX4's sign that an event says it, too
                    self._alerts.relay(said.severity, said.text, now_s)
        self._follow_events(now_s)
        self._follow_plans(now_s)
        self.commands.tick(now_s)
        is_alive = self._identification.is_alive
        self.telemetry.connected(is_alive)
        self.inspection.rated(self.telemetry.clock_rate)
        if self.target is not None and is_alive:
            self._streams.tick(self.target, now_s)
            state = self.telemetry.state
            self._prearm.tick(self.target, now_s, is_wanted=not state.is_armed and not state.is_armable)
            self._origin.tick(self.target, now_s, is_wanted=not self.telemetry.has_origin)
        for text in self._streams.refused:
            self._report(Severity.NOTICE, f"the autopilot refuses {text}")
        self._streams.refused.clear()
        for message in self._node.outgoing():
            self.send_message(message)

    def _follow_identity(self, now_s: float) -> None:
        for change in self._identification.contact():
            if change is IdentityChange.RESTARTED:
                self._restarted(now_s)
            else:
                self._request_all(now_s)
        self.clock_offset.poll(now_s)
        if self.telemetry.restarts != self._restarts:
            self._restarts = self.telemetry.restarts
            self._restarted(now_s)
        for change in self._identification.identify(now_s):
            if change is IdentityChange.UNSUPPORTED:
                self.commands.abandon(NO_OWNER)
                self.telemetry.connected(False)
                continue
            if change is IdentityChange.REPLACED:
                self.commands.abandon("the autopilot was replaced by another one")
            self.telemetry.adopt(self.style)
            if (heartbeat := self._identification.heartbeat) is not None:
                self.telemetry.receive(heartbeat, now_s)
            self._request_all(now_s)

    def _restarted(self, now_s: float) -> None:
        """Handles a restart of the autopilot; several signs of it count once."""
        if now_s - self._restarted_s < ONE_RESTART_S:
            return
        self._restarted_s = now_s
        self._report(Severity.WARNING, "the autopilot has restarted")
        self._request_all(now_s)

    def _end_calls(self, now_s: float) -> None:
        for call in self._client.events():
            self.commands.ended(call, now_s)
            self._streams.ended(call, now_s)
            self._prearm.ended(call)
            self._origin.ended(call)
            self.inspection.ended(call, now_s)

    def _follow_events(self, now_s: float) -> None:
        """Reports PX4's reasons and alerts, by the dictionary read on the ground."""
        state = self.telemetry.state
        if self.target is not None and self._identification.is_alive:
            is_wanted = self.style.style is Style.PX4 and not state.is_armed
            self.events.tick(self.target, now_s, is_wanted=is_wanted)
        if self.events.problem and not self.events.is_problem_reported:
            self.events.is_problem_reported = True
            self._report(Severity.NOTICE, f"PX4's event texts are missing: {self.events.problem}")
        for severity, text in self.events.alerts:
            self.telemetry.receive_text(severity, text, now_s)
            self._alerts.relay(severity, text, now_s)
        self.events.alerts.clear()
        if self.events.reasons is not None:
            self.telemetry.receive_reasons(self.events.reasons, now_s)
            self.events.reasons = None

    def _follow_plans(self, now_s: float) -> None:
        for event in self._plans.events():
            if isinstance(event, Transfer):
                self.inspection.transferred(event, now_s)
                fenced, switch_on = self.fence.received(event, now_s), self.style.fence_on_command
                ended = fenced or self.plan.received(event, now_s) or self.file.received(event, now_s)
                if fenced is not None and fenced[1].is_accepted and self.fence.is_set and switch_on is not None:
                    # its answer is that of the fence
                    self.commands.send(fenced[0], switch_on, self.target, now_s, patience_s=FENCE_LOAD_S)
                elif ended is not None:
                    self.commands.put(*ended)
            elif event.sender == self.target:
                self.plan.follow(event)
                self.file.follow(event)

    # --- what is requested ---

    @property
    def _needed(self) -> list[MessageStream]:
        return [*self.style.streams, *self.sensors.streams(self.style.style)]

    def _request_all(self, now_s: float) -> None:
        """Requests everything that we need of the autopilot."""
        target, style = self.target, self.style
        self.contacts += 1
        self._leave.autopilot = self.gimbal.autopilot = target
        self.clock_offset.service.request(target)
        self._prearm.restart()
        self._origin.restart()
        self.events.restart()
        self._streams.request_all(self._needed)
        if target is not None:
            vehicle = style.class_properties.vehicle
            names = (*table_of(style.style, vehicle).names(), *self._more_names(style.style, vehicle))
            self.inspection.adopt(target, style.style, vehicle, tuple(dict.fromkeys(names)), now_s)

    def request_streams_again(self) -> None:
        """Restores our message rates after another station has changed them.

        All requests are sent at once, and then again one by one with acknowledgement.
        """
        if self.target is None:
            return
        streams = self._needed
        self._requests_at_once += 1
        for stream in streams:
            self.send_message(stream.request(self.target, self._requests_at_once % 10))
        self.loop.call_later(BEHIND_S, self._streams.request_all, streams)

    def request_stream(self, stream: MessageStream) -> None:
        """Requests one more message."""
        self._streams.request(stream)

    def _request_sensors(self) -> None:
        """Requests what sensors are used, once there is an autopilot."""
        if self.target is not None:
            for stream in self.sensors.streams(self.style.style):
                self._streams.request(stream)

    def report(self, text: str) -> None:
        """Reports a warning about the autopilot."""
        self._report(Severity.WARNING, text)
