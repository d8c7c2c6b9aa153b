"""An autopilot at the other end of a MAVLink link: as little of one as the autopilot link can be tried on."""

from typing import Any

from gloc3.clock import VirtualLoop
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest, MavCommandServer
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.interval import STREAM_COMMANDS, StreamScheduler
from gloc3.mavlink.services.statustext import StatusTextSender
from gloc3.mavlink.services.timesync import TimeSync
from gloc3.mavlink.transport.memory import MemoryEnd

TICK_S = 0.02
VEHICLE = Address(1, 1)
FAMILIES = {"px4": 12, "ardupilot": 3}
HOLD = {"px4": 4 << 16 | 3 << 24, "ardupilot": 17}
USUAL_HZ = {"LOCAL_POSITION_NED": 1.0, "GPS_GLOBAL_ORIGIN": 0.0, "SYS_STATUS": 1.0, "EXTENDED_SYS_STATE": 0.0}
USUAL_HZ |= {"ATTITUDE_QUATERNION": 1.0, "DISTANCE_SENSOR": 0.0, "GLOBAL_POSITION_INT": 0.0, "HEARTBEAT": 0.0}
USUAL_HZ |= {"HIGHRES_IMU": 0.0, "SCALED_IMU": 0.0, "OBSTACLE_DISTANCE": 0.0}
USUAL_HZ |= {"HOME_POSITION": 0.0, "EKF_STATUS_REPORT": 0.0, "ESTIMATOR_STATUS": 0.0}


class FakeAutopilot:
    """Answers commands as `refuses` and `is_deaf` say, and sends what it was asked to send."""

    def __init__(
        self, loop: VirtualLoop, end: MemoryEnd, style: str = "px4", own: Address = VEHICLE, vehicle_type: int = 2
    ) -> None:
        self.own = own
        self.vehicle_type = vehicle_type
        self.style = style
        self.ran: list[MavCommandRequest] = []
        self.received: list[MavlinkMessage] = []
        self.refuses: dict[int, tuple[CommandResult, str]] = {}
        """Command to the result and the text that says why."""
        self.silent_on: set[int] = set()
        """Commands that are heard and not answered."""
        self.north_m = 0.0
        self.estimator_flags = 0x3F
        self.prearm_health = 1 << 28
        self.is_off = False
        self._loop, self._end = loop, end
        self._encoder = codec.Encoder(*own)
        self._parser = codec.Parser(is_datagram=True)
        end.on_data = self._receive
        self.clock_rate = 1.0
        """Its seconds in one of the loop's, as a simulation that runs faster."""
        self.has_clock = True
        """Answers TIMESYNC."""
        self.boot()
        loop.call_soon(self._tick)

    def boot(self) -> None:
        """Begins anew, with the usual streams and its clock at zero."""
        own = self.own
        self._booted_s = self._loop.time()
        self._commands = MavCommandServer(own, is_autopilot=True)
        self._texts = StatusTextSender(own)
        self.heartbeat = Heartbeat(own, vehicle_type=self.vehicle_type, autopilot=FAMILIES.get(self.style, 4))
        self.heartbeat.custom_mode, self.heartbeat.base_mode = HOLD.get(self.style, 0), 1
        self._streams = StreamScheduler(own, USUAL_HZ)
        self._node = MavlinkComponent(own, [self._commands, self._texts, self.heartbeat])
        if self.has_clock:
            self._node.add(TimeSync(own, send_s=lambda _: self.boot_s))

    def add(self, service: Microservice[Any]) -> None:
        """Speaks one more microservice, until it boots anew."""
        self._node.add(service)

    def report(self, text: str, severity: int = 4) -> None:
        self._texts.send(severity, text)

    @property
    def boot_s(self) -> float:
        """Its own time."""
        return (self._loop.time() - self._booted_s) * self.clock_rate

    def stall(self, seconds: float) -> None:
        """Its clock has not gone on for a while, as that of a simulation that is starved of its computer."""
        self._booted_s += seconds

    def set_rate(self, name: str, rate_hz: float) -> None:
        """Sends a message at another rate from now on."""
        self._streams.set_rate(name, rate_hz, self._loop.time())

    def rate_hz(self, name: str) -> float:
        return self._streams.rate_hz(name)

    def send(self, name: str, **fields: Any) -> None:
        self._end.send(self._encoder.encode(codec.message(name, **fields)))

    def _receive(self, data: bytes) -> None:
        now_s = self._loop.time()
        for frame in self._parser.receive(data):
            if not self.is_off and (message := frame.decode()) is not None:
                self.received.append(message)
                self._node.receive(frame, now_s)
        for request in self._commands.events():
            self.ran.append(request)
            result, why = self.refuses.get(request.command, (CommandResult.ACCEPTED, ""))
            if request.command in STREAM_COMMANDS and not why:
                answer = self._streams.command(request, now_s)
                result = CommandResult.UNSUPPORTED if answer is None else answer
            if request.command not in self.silent_on:
                self._commands.answer(request, result, now_s=now_s)
            if why:
                self.report(why)

    def _tick(self) -> None:
        now_s = self._loop.time()
        if not self.is_off:
            self._node.tick(now_s)
            for message in self._node.outgoing():
                self._end.send(self._encoder.encode(message))
            for number in self._streams.due(now_s):
                self._produce(codec.name_of(number) or "", int(self.boot_s * 1e3))
        self._loop.call_later(TICK_S, self._tick)

    def _produce(self, name: str, boot_ms: int) -> None:
        match name:
            case "LOCAL_POSITION_NED":
                self.send(name, time_boot_ms=boot_ms, x=self.north_m, z=-2.0, vx=0.5)
            case "ATTITUDE_QUATERNION":
                self.send(name, time_boot_ms=boot_ms, q1=1.0, yawspeed=0.1)
            case "DISTANCE_SENSOR":
                limits = {"min_distance": 10, "max_distance": 4000}
                self.send(name, time_boot_ms=boot_ms, current_distance=210, orientation=25, **limits)
            case "GPS_GLOBAL_ORIGIN":
                self.send(name, latitude=395_000_000, longitude=26_000_000, altitude=5_000)
            case "GLOBAL_POSITION_INT":
                self.send(name, time_boot_ms=boot_ms, alt=7_500)
            case "EXTENDED_SYS_STATE":
                self.send(name, landed_state=1)
            case "SYS_STATUS":
                health = self.prearm_health
                self.send(
                    name,
                    onboard_control_sensors_health=health,
                    voltage_battery=11_500,
                    current_battery=150,
                    battery_remaining=80,
                )
            case "HOME_POSITION":
                self.send(name, latitude=395_000_000, longitude=26_000_000, altitude=5_000)
            case "EKF_STATUS_REPORT" | "ESTIMATOR_STATUS":
                self.send(name, flags=self.estimator_flags)
            case "HEARTBEAT":
                self.heartbeat.send_now()
