"""Vehicles of ArduPilot that neither fly nor are copters, as their public interface shows them: a rover and a submarine.

They know the modes, take setpoints only in guided mode and only in the form that they take, forget them after three
seconds, and move as a point does. Sources: the documentation of Rover and Sub, "Commands in guided mode".
"""

import math
from typing import Any, Final

from gloc3.clock import VirtualLoop
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest, MavCommandServer
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.interval import STREAM_COMMANDS, StreamScheduler
from gloc3.mavlink.services.parameter import Parameter, ParameterEncoding, ParameterType
from gloc3.mavlink.services.parameter_server import ParameterServer
from gloc3.mavlink.services.statustext import StatusTextSender
from gloc3.mavlink.services.timesync import TimeSync
from gloc3.mavlink.services.version import ProtocolCapability, Version, version_number
from gloc3.mavlink.transport.memory import MemoryEnd
from gloc3.messages.frames import GeoPoint, TangentPlane, from_yaw, wrap_pi

OWN: Final = Address(1, 1)
STEP_S: Final = 0.02
TIMEOUT_S: Final = 3.0
ARM, SET_MODE = 400, 176
IGNORES_POSITION, IGNORES_VELOCITY, IGNORES_YAW = 0x007, 0x038, 0x400
IGNORES_ACCELERATION: Final = 0x1C0
STREAMS: Final = (
    "HEARTBEAT", "SYS_STATUS", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "GPS_GLOBAL_ORIGIN",
    "DISTANCE_SENSOR", "EXTENDED_SYS_STATE", "HOME_POSITION", "EKF_STATUS_REPORT", "SYSTEM_TIME",
    "GPS_RAW_INT",
)  # fmt: skip


class VehiclePeer:
    """What all of them have in common.

    Args:
        loop: virtual time.
        end: of the cable.
        origin: latitude, longitude, altitude of the estimator's origin.
        parameters: whole numbers by name.
    """

    vehicle_type = 10
    autopilot = 3
    guided = 15
    hold = 4
    names: dict[int, str] = {0: "MANUAL"}

    def __init__(
        self, loop: VirtualLoop, end: MemoryEnd, origin: tuple[float, float, float], parameters: dict[str, int]
    ) -> None:
        self.position = [0.0, 0.0, 0.0]
        self.velocity = [0.0, 0.0, 0.0]
        self.yaw_rad = 0.0
        self.mode, self.is_armed = 0, False
        self.target: MavlinkMessage | None = None
        self.modes: list[int] = []
        self.refused: list[str] = []
        """Setpoints that it does not take, and why."""
        self.last_s = self._stopped_s = -math.inf
        self._loop, self._end, self._origin = loop, end, origin
        self._encoder, self._parser = codec.Encoder(*OWN), codec.Parser(is_datagram=True)
        self._commands = MavCommandServer(OWN, is_autopilot=True)
        self._heartbeat = Heartbeat(OWN, vehicle_type=self.vehicle_type, autopilot=self.autopilot)
        self._streams = StreamScheduler(OWN, dict.fromkeys(STREAMS, 0.0))
        self._texts = StatusTextSender(OWN)
        whole = [Parameter(name, float(value), ParameterType.INT16) for name, value in parameters.items()]
        services: list[Microservice[Any]] = [
            self._commands,
            self._heartbeat,
            self._texts,
            TimeSync(OWN),
            ParameterServer(OWN, whole, encoding=ParameterEncoding.CAST),
        ]
        self._node = MavlinkComponent(OWN, services)
        end.on_data = self._receive
        loop.call_soon(self._tick)

    def lead(self, message: MavlinkMessage) -> None:
        """Takes a setpoint in guided mode."""
        raise NotImplementedError

    def move(self, now_s: float) -> None:
        """Moves on by one step."""
        raise NotImplementedError

    # --- the link ---

    def _receive(self, data: bytes) -> None:
        now_s = self._loop.time()
        for frame in self._parser.receive(data):
            message = frame.decode()
            if message is None:
                continue
            self._node.receive(frame, now_s)
            if message.name == "SET_POSITION_TARGET_LOCAL_NED" and self.mode == self.guided:
                self.lead(message)
        for request in self._commands.events():
            self._commands.answer(request, self._run(request, now_s), now_s=now_s)

    def _run(self, request: MavCommandRequest, now_s: float) -> CommandResult:
        if request.command in STREAM_COMMANDS:
            reported = self._streams.command(request, now_s)
            return CommandResult.UNSUPPORTED if reported is None else reported
        if request.command == 512 and request.params[0] == 148:
            about = Version(capabilities=ProtocolCapability.COMMAND_INT, flight_software=version_number(4, 6, 0))
            self._send(about.message())
            return CommandResult.ACCEPTED
        if request.command == SET_MODE and int(request.params[1]) in self.names:
            self._enter(int(request.params[1]))
            return CommandResult.ACCEPTED
        if request.command == ARM:
            self.is_armed = request.params[0] == 1.0
            return CommandResult.ACCEPTED
        return CommandResult.UNSUPPORTED

    def _enter(self, mode: int) -> None:
        self.mode, self.target = mode, None
        self.modes.append(mode)
        self._heartbeat.send_now()

    def _send(self, message: MavlinkMessage) -> None:
        self._end.send(self._encoder.encode(message))

    def _tick(self) -> None:
        now_s = self._loop.time()
        if self.target is not None and now_s - self.last_s > TIMEOUT_S:
            self.target = None
            self._texts.send(4, "target not received last 3secs, stopping")
        self.move(now_s)
        for axis in range(3):
            self.position[axis] += self.velocity[axis] * STEP_S
        self._heartbeat.custom_mode = self.mode
        self._heartbeat.base_mode = 1 | (128 if self.is_armed else 0)
        self._node.tick(now_s)
        for message in self._node.outgoing():
            self._send(message)
        for number in self._streams.due(now_s):
            reported = self._report(codec.name_of(number) or "", int(now_s * 1e3))
            if reported is not None:
                self._send(reported)
        self._loop.call_later(STEP_S, self._tick)

    def _report(self, name: str, boot_ms: int) -> MavlinkMessage | None:
        latitude, longitude, altitude = self._origin
        place = {
            "latitude": round(latitude * 1e7),
            "longitude": round(longitude * 1e7),
            "altitude": round(altitude * 1e3),
        }
        q, (n, e, d), (vn, ve, vd) = from_yaw(self.yaw_rad), self.position, self.velocity
        match name:
            case "HEARTBEAT":
                return self._heartbeat.message()
            case "LOCAL_POSITION_NED":
                return codec.message(name, time_boot_ms=boot_ms, x=n, y=e, z=d, vx=vn, vy=ve, vz=vd)
            case "ATTITUDE_QUATERNION":
                return codec.message(name, time_boot_ms=boot_ms, q1=q[0], q2=q[1], q3=q[2], q4=q[3])
            case "SYS_STATUS":
                bits = {f"onboard_control_sensors_{what}": 1 << 28 | 0x2F for what in ("present", "enabled", "health")}
                return codec.message(name, voltage_battery=12_000, current_battery=100, battery_remaining=90, **bits)
            case "GPS_GLOBAL_ORIGIN" | "HOME_POSITION":
                return codec.message(name, **place)
            case "GLOBAL_POSITION_INT":
                return codec.message(name, time_boot_ms=boot_ms, alt=round((altitude - d) * 1e3))
            case "GPS_RAW_INT":
                at = TangentPlane(GeoPoint(*self._origin)).geo_from_ned((n, e, d))
                fix = {"lat": round(at[0] * 1e7), "lon": round(at[1] * 1e7), "alt": round(at[2] * 1e3)}
                return codec.message(name, time_usec=boot_ms * 1000, fix_type=6, h_acc=20, satellites_visible=20, **fix)
            case "EKF_STATUS_REPORT":
                return codec.message(name, flags=0x3F)
            case "EXTENDED_SYS_STATE":
                return codec.message(name, landed_state=0)
            case "SYSTEM_TIME":
                return codec.message(name, time_boot_ms=boot_ms)
        return None


class RoverPeer(VehiclePeer):
    """Steers like a car: to a heading and a speed; it cannot move sideways, and turns no tighter than a metre."""

    names = {0: "MANUAL", 4: "HOLD", 5: "LOITER", 10: "AUTO", 11: "RTL", 15: "GUIDED"}

    def lead(self, message: MavlinkMessage) -> None:
        """Takes velocities, with a yaw or without; positions it would drive to by itself are not what we send."""
        mask = message.type_mask
        if not mask & IGNORES_POSITION or mask & IGNORES_VELOCITY or not mask & IGNORES_ACCELERATION:
            self.refused.append(f"type_mask {mask}")
            return
        self.target, self.last_s = message, self._loop.time()

    def move(self, now_s: float) -> None:
        """Turns towards the wanted heading, as tightly as its speed allows."""
        speed, wanted_rad = 0.0, self.yaw_rad
        target = self.target
        if self.is_armed and target is not None:
            speed = math.hypot(target.vx, target.vy)
            is_yaw_told = not target.type_mask & IGNORES_YAW
            wanted_rad = target.yaw if is_yaw_told else math.atan2(target.vy, target.vx)
        now_m_s = math.hypot(self.velocity[0], self.velocity[1])
        now_m_s += max(-2.0 * STEP_S, min(2.0 * STEP_S, speed - now_m_s))
        most = now_m_s / 1.0 * STEP_S
        self.yaw_rad = wrap_pi(self.yaw_rad + max(-most, min(most, wrap_pi(wanted_rad - self.yaw_rad))))
        self.velocity = [now_m_s * math.cos(self.yaw_rad), now_m_s * math.sin(self.yaw_rad), 0.0]


class BoatPeer(RoverPeer):
    """Steers as a rover does; what holds it is LOITER."""

    vehicle_type = 11
    hold = 5


class SubPeer(VehiclePeer):
    """Follows positions with velocities in all directions; surfaces in SURFACE, and then holds its depth in ALT_HOLD."""

    vehicle_type = 12
    guided = 4
    hold = 16
    names = {0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 9: "SURFACE", 16: "POSHOLD", 19: "MANUAL"}

    def lead(self, message: MavlinkMessage) -> None:
        """Takes positions; one without a velocity begins its way anew each time, so that a stream of them goes nowhere."""
        if message.type_mask & IGNORES_POSITION == 0 and message.type_mask & IGNORES_VELOCITY:
            self.refused.append("a stream of positions without velocities")
            return
        self.target, self.last_s = message, self._loop.time()

    def move(self, now_s: float) -> None:
        """Goes to the place with no more than 1 m/s."""
        wanted = [0.0, 0.0, 0.0]
        target = self.target
        if self.is_armed and self.mode == 9:
            wanted[2] = -0.5
            if self.position[2] <= 0.0:
                self._enter(2)
                wanted[2] = 0.0
        elif self.is_armed and target is not None:
            reported = (target.vx, target.vy, target.vz)
            if not target.type_mask & IGNORES_POSITION:
                place = (target.x, target.y, target.z)
                wanted = [reported[axis] + 0.8 * (place[axis] - self.position[axis]) for axis in range(3)]
            else:
                wanted = list(reported)
        speed = math.hypot(*wanted)
        share = min(1.0, 1.0 / speed) if speed > 0.0 else 0.0
        for axis in range(3):
            self.velocity[axis] += max(-0.5 * STEP_S, min(0.5 * STEP_S, share * wanted[axis] - self.velocity[axis]))
