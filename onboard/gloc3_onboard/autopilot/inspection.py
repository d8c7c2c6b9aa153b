"""Reads an autopilot's setup: its version, time of day, rally points, and the parameters that matter to us."""

from collections import deque
from collections.abc import Sequence
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.codec import shape
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice, earliest
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3.mavlink.services.interval import REQUEST_MESSAGE
from gloc3.mavlink.services.mission_client import MissionClient, Transfer
from gloc3.mavlink.services.parameter import Parameter, ParameterEncoding
from gloc3.mavlink.services.parameter_client import ParameterCall, ParameterClient, ParameterResult
from gloc3.mavlink.services.plan import PlanResult, PlanType
from gloc3.mavlink.services.version import ProtocolCapability, read_version
from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import Style, VehicleClass

AT_ONCE: Final = 6
"""Number of concurrent parameter reads, so that a slow line is not filled."""
OFFICIAL: Final = 255
"""The last byte of a release's version number."""
REPORTED_SEVERITY: Final = ("AUTOPILOT_VERSION", "SYSTEM_TIME")
"""Messages requested once per reading."""

REMOTE_ID_SILENT_S: Final = 10.0
"""Silence of a Remote ID that has reported, after which it counts as failed, s."""
REMOTE_ID_SILENT: Final = f"it has not reported for {REMOTE_ID_SILENT_S:.0f} s"
RALLY_S: Final = 3.0
"""Longest wait for the rally points, s: fences and plans wait behind them."""


class Inspection(Microservice[AutopilotSetup]):
    """Reads the autopilot's setup; a request during a reading follows it.

    Parameter changes reported between two readings are applied, too. Unknown parameters are not requested again until
    the autopilot restarts.

    Args:
        own: our MAVLink address.
        commands: the command protocol; driven by its owner, who passes its results to `ended`.
        plans: the mission protocol; likewise, with `transferred`.
    """

    handles = ParameterClient.handles | {*REPORTED_SEVERITY, "SYS_STATUS", "OPEN_DRONE_ID_ARM_STATUS"}

    def __init__(self, own: Address, commands: MavCommandClient, plans: MissionClient) -> None:
        super().__init__(own)
        self.setup = AutopilotSetup()
        """What is known."""
        self._commands, self._plans = commands, plans
        self._rally: Transfer | None = None
        self._rally_s = 0.0
        """When the rally points were requested."""
        self._parameters = ParameterClient(own)
        self._target: Address | None = None
        self._names: Sequence[str] = ()
        self._absent: set[str] = set()
        self._waiting: deque[str] = deque()
        self._reading: dict[str, ParameterCall] = {}
        self._silent: list[str] = []
        self._messages: deque[str] = deque()
        self._requested: CommandCall | None = None
        self._is_reading = False
        self._number = 0
        self._next_number: int | None = None
        self._remote_id_s = 0.0
        """When the Remote ID reported last."""

    def adopt(self, target: Address, style: Style, vehicle: VehicleClass, names: Sequence[str], now_s: float) -> None:
        """Handles a new or restarted autopilot: reads everything, the given parameters by name."""
        self._drop(now_s)
        self._target, self._names = target, names
        self._absent.clear()
        self._parameters.encoding = ParameterEncoding.BYTEWISE if style is Style.PX4 else ParameterEncoding.CAST
        self.setup = AutopilotSetup(style=style, vehicle=vehicle, number=self.setup.number)
        self._begin(self._number, now_s)

    def read(self, number: int, now_s: float) -> None:
        """Starts reading everything; its end is reported with this number."""
        if self._target is None:
            return
        if self._is_reading:
            self._next_number = number
        else:
            self._begin(number, now_s)

    def _begin(self, number: int, now_s: float) -> None:
        self._is_reading, self._number, self._next_number = True, number, None
        self._silent.clear()
        self._waiting = deque(name for name in self._names if name not in self._absent)
        self._messages = deque(REPORTED_SEVERITY)
        self.tick(now_s)

    def _drop(self, now_s: float) -> None:
        for call in list(self._reading.values()):
            self._parameters.cancel(call)
        self._parameters.events()
        self._reading.clear()
        if self._requested is not None:
            self._commands.abandon(self._requested)
            self._requested = None
        self._leave_rally(now_s)
        self._is_reading = False

    def _leave_rally(self, now_s: float) -> None:
        transfer, self._rally = self._rally, None
        if transfer is not None:
            self._plans.cancel(transfer, now_s)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles the autopilot's messages."""
        if message.name == "OPEN_DRONE_ID_ARM_STATUS":  # the transmitter is a component of its own
            if self._target is not None and sender.system == self._target.system:
                self._remote_id_s = now_s
                self._set(remote_id=_remote_id(message))
            return
        if sender != self._target:
            return
        match message.name:
            case "AUTOPILOT_VERSION":
                version = read_version(message)
                number = version.flight_software
                if version.capabilities & ProtocolCapability.MISSION_RALLY:
                    self._request_rally(sender, now_s)
                if number:
                    firmware = (number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF)
                    self._set(firmware=firmware, is_official=number & 0xFF == OFFICIAL)
            case "SYSTEM_TIME":
                utc_s = message.time_unix_usec * 1e-6
                self._set(utc_minus_t_s=round(utc_s - now_s, 1) if utc_s else None)
            case "SYS_STATUS":
                self._set(
                    sensors_present=message.onboard_control_sensors_present,
                    sensors_enabled=message.onboard_control_sensors_enabled,
                    sensors_health=message.onboard_control_sensors_health,
                )
            case _:
                self._parameters.receive(message, sender, now_s)
                self._follow(now_s)

    def _request_rally(self, target: Address, now_s: float) -> None:
        """ArduPilot counts its rally points in a parameter."""
        if self._is_reading and self._rally is None and self.setup.style is Style.PX4:
            self._rally = self._plans.download(target, now_s=now_s, kind=PlanType.RALLY)
            self._rally_s = now_s

    def transferred(self, transfer: Transfer, now_s: float) -> None:
        """A transfer has ended; those that are not from here are ignored."""
        if transfer is self._rally:
            self._rally = None
            if transfer.result is PlanResult.ACCEPTED:
                self._set(rally_points=len(transfer.items))
            self._follow(now_s)

    def rated(self, clock_rate: float) -> None:
        """Takes the rate of the autopilot's clock in."""
        self._set(clock_rate=round(clock_rate, 1))

    def ended(self, call: CommandCall, now_s: float) -> None:
        """A command has come back from the client; those that are not from here are ignored."""
        if call is self._requested and call.result is not None:
            self._requested = None
            self.tick(now_s)

    def tick(self, now_s: float) -> None:
        """Sends the next requests."""
        self._parameters.tick(now_s)
        if self.setup.remote_id is not None and now_s - self._remote_id_s >= REMOTE_ID_SILENT_S:
            self._set(remote_id=REMOTE_ID_SILENT)
        self._follow(now_s)

    def _follow(self, now_s: float) -> None:
        for event in self._parameters.events():
            if isinstance(event, ParameterCall):
                self._ended_reading(event)
            elif isinstance(event, Parameter) and event.name in self._names:
                self._set(parameters={**self.setup.parameters, event.name: event.value})
        if not self._is_reading or self._target is None:
            return
        while self._waiting and len(self._reading) < AT_ONCE:
            name = self._waiting.popleft()
            self._reading[name] = self._parameters.read(self._target, name, now_s=now_s)
        if self._messages and self._requested is None:
            number = float(shape(self._messages[0]).id)
            try:
                self._requested = self._commands.send_long(self._target, REQUEST_MESSAGE, (number,), now_s=now_s)
                self._messages.popleft()
            except Refused:  # somebody else asks for one
                return
        if self._rally is not None and now_s - self._rally_s >= RALLY_S:
            self._leave_rally(now_s)
        if not (self._waiting or self._reading or self._messages or self._requested or self._rally):
            self._end(now_s)

    def _ended_reading(self, call: ParameterCall) -> None:
        if self._reading.get(call.name) is not call:
            return
        del self._reading[call.name]
        if call.result is ParameterResult.DONE and call.value is not None:
            self._set(parameters={**self.setup.parameters, call.name: call.value.value})
        elif call.result is ParameterResult.NO_SUCH:
            self._absent.add(call.name)
        else:
            self._silent.append(call.name)

    def _end(self, now_s: float) -> None:
        self._is_reading = False
        if self.setup.parameters and len(self._silent) < len(self._names) - len(self._absent):
            self._absent.update(self._silent)  # older autopilots do not answer for what they do not know
        is_read = bool(self.setup.parameters) and not set(self._silent) & set(self.setup.parameters)
        number = self._number if is_read else self.setup.number
        self._set(unread=sorted(self._absent | set(self._silent)), number=number, is_complete=is_read)
        if self._next_number is not None:
            self._begin(self._next_number, now_s)

    def _set(self, **fields: object) -> None:
        if any(getattr(self.setup, name) != value for name, value in fields.items()):
            self.setup = msgspec.structs.replace(self.setup, **fields)
            self._events = [self.setup]

    def next_tick_s(self) -> float | None:
        """When one of its questions is due."""
        is_reporting = self.setup.remote_id not in (None, REMOTE_ID_SILENT)
        silent_s = self._remote_id_s + REMOTE_ID_SILENT_S if is_reporting else None
        return earliest(self._parameters.next_tick_s(), silent_s)

    def outgoing(self) -> list[MavlinkMessage]:
        """What the parameter protocol wants to send; commands go by their own client."""
        return self._parameters.outgoing()


def _remote_id(message: MavlinkMessage) -> str:
    """Why a Remote ID is not good to arm; empty where it is."""
    if message.status == 0:
        return ""
    error = "".join(one for one in message.error if one.isprintable()).strip()
    return error or f"it gives no reason (status {message.status})"
