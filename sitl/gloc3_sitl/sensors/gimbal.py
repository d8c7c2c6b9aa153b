"""A simulated gimbal with a camera: motion with limits of angle and rate, and its end of the gimbal protocol v2.

It hangs in the vehicle's centre, keeps roll and pitch to the horizon, and turns in yaw with the vehicle or stays towards
a direction from north. It is a MAVLink component of its own, on a link of its own to the autopilot.
"""

from collections.abc import Callable
from math import isfinite, nan, radians
from typing import Any, Final, Protocol

from msgspec.structs import replace

from gloc3.mavlink import codec
from gloc3.mavlink.codec import Encoder, MavlinkMessage, Parser
from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest, MavCommandServer
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.interval import REQUEST_MESSAGE, StreamScheduler
from gloc3.messages.frames import Vector3, from_euler, to_euler, wrap_pi, yaw_of
from gloc3_sitl.physics.truth import Truth

COMPONENT: Final = 154
"""MAV_COMP_ID_GIMBAL."""
PERIOD_S: Final = 0.02
PITCH_LIMITS_DEG: Final = (-90.0, 30.0)
YAW_LIMITS_DEG: Final = (-160.0, 160.0)
RATE_DEG_S: Final = 60.0
ATTITUDE_HZ: Final = 10.0
_TYPE: Final = 26
"""MAV_TYPE_GIMBAL."""
_HAS: Final = 2 | 4 | 8 | 16 | 32 | 64 | 128 | 256 | 512 | 1024
"""GIMBAL_DEVICE_CAP_FLAGS: neutral position, all axes; locked or, but for roll and pitch, following the vehicle."""
_NEUTRAL, _LEVEL, _YAW_LOCK, _IN_VEHICLE, _FROM_NORTH = 2, 4 | 8, 16, 32, 64
"""GIMBAL_DEVICE_FLAGS."""
_MOTOR_ERROR: Final = 16
"""GIMBAL_DEVICE_ERROR_FLAGS."""


Send = Callable[[bytes], None]
Connect = Callable[[Send], Send]
"""Connects a link to the autopilot: given what receives, it returns what sends."""


class CarryingVehicle(Protocol):
    """A vehicle that the gimbal hangs on."""

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""

    def truth(self) -> Truth:
        """What the vehicle really does now."""


class WakeUps(Protocol):
    """An event loop, as far as it wakes something later."""

    def call_later(self, delay: float, callback: Callable[[], object], /) -> Any:
        """Calls after so many seconds; the result has a method `cancel`."""


class GimbalMotion:
    """Motion of the axes: pitch from the horizon, yaw from the nose, in radians."""

    def __init__(self) -> None:
        self.pitch_rad = self.yaw_rad = 0.0
        self.pitch_rate_rad_s = self.yaw_rate_rad_s = 0.0
        self.is_from_north = False
        """Whether the yaw is kept towards a direction from north."""
        self.is_stuck = False
        """Whether its motors are off."""
        self._pitch_goal = self._yaw_goal = 0.0
        self._goal_rates: tuple[float, float] | None = None

    def point(self, pitch_rad: float, yaw_rad: float, *, is_from_north: bool) -> None:
        """Goes there; beyond its limits it goes as far as it can."""
        self._pitch_goal, self._yaw_goal, self.is_from_north = pitch_rad, yaw_rad, is_from_north
        self._goal_rates = None

    def turn(self, pitch_rad_s: float, yaw_rad_s: float) -> None:
        """Turns at rates until told otherwise."""
        self._goal_rates = (pitch_rad_s, yaw_rad_s)
        self.is_from_north = False

    def advance(self, duration_s: float, vehicle_yaw_rad: float) -> None:
        """Lets time pass."""
        if self.is_stuck or duration_s <= 0.0:
            self.pitch_rate_rad_s = self.yaw_rate_rad_s = 0.0
            return
        before = self.pitch_rad, self.yaw_rad
        if self._goal_rates is not None:
            goals = [angle + rate * duration_s for angle, rate in zip(before, self._goal_rates, strict=True)]
        else:
            yaw = wrap_pi(self._yaw_goal - vehicle_yaw_rad) if self.is_from_north else self._yaw_goal
            goals = [self._pitch_goal, yaw]
        self.pitch_rad = _towards(self.pitch_rad, goals[0], duration_s, PITCH_LIMITS_DEG)
        self.yaw_rad = _towards(self.yaw_rad, goals[1], duration_s, YAW_LIMITS_DEG)
        if self._goal_rates is not None:
            self._pitch_goal, self._yaw_goal = self.pitch_rad, self.yaw_rad
        self.pitch_rate_rad_s = (self.pitch_rad - before[0]) / duration_s
        self.yaw_rate_rad_s = (self.yaw_rad - before[1]) / duration_s


class SimulatedGimbal:
    """The gimbal of a simulated vehicle.

    Args:
        vehicle: the vehicle that it hangs on.
        connect: connects it to the autopilot.
        loop: event loop whose clock wakes it; its own time is the vehicle's.
        system: MAVLink system of the vehicle.
    """

    def __init__(self, vehicle: CarryingVehicle, connect: Connect, loop: WakeUps, system: int = 1) -> None:
        self.motion: Final = GimbalMotion()
        self._vehicle, self._connect, self._loop = vehicle, connect, loop
        self._moved_s = vehicle.now_s
        self._timer: Any = None
        own = Address(system, COMPONENT)
        self._commands = MavCommandServer(own, serves=_serves)
        self._streams = StreamScheduler(
            own, {"GIMBAL_DEVICE_ATTITUDE_STATUS": ATTITUDE_HZ, "GIMBAL_DEVICE_INFORMATION": 0.0}
        )
        targets = _Targets(own, self.motion)
        self._node = MavlinkComponent(own, (self._commands, Heartbeat(own, vehicle_type=_TYPE), self._streams, targets))
        self._encoder, self._parser = Encoder(*own), Parser(is_datagram=True)
        self._send: Send | None = None

    def start(self) -> None:
        """Connects it, and has it move."""
        self._send = self._connect(self._receive)
        self._tick()

    def stop(self) -> None:
        """It stands still and is silent."""
        if self._timer is not None:
            self._timer.cancel()

    def carrying(self, truth: Truth) -> Truth:
        """The truth of a vehicle in place of the gimbal, with its attitude: what the camera on it sees."""
        yaw_rad = wrap_pi(yaw_of(truth.attitude_wxyz) + self.motion.yaw_rad)
        attitude = from_euler(0.0, self.motion.pitch_rad, yaw_rad)
        rates: Vector3 = (0.0, self.motion.pitch_rate_rad_s, 0.0)
        return replace(truth, attitude_wxyz=attitude, rate_frd_rad_s=rates)

    def _receive(self, data: bytes) -> None:
        for frame in self._parser.receive(data):
            self._node.receive(frame, self._vehicle.now_s)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(PERIOD_S, self._tick)
        now_s, truth = self._vehicle.now_s, self._vehicle.truth()
        self.motion.advance(now_s - self._moved_s, yaw_of(truth.attitude_wxyz))
        self._moved_s = now_s
        self._node.tick(now_s)
        for request in self._commands.events():
            self._answer(request, now_s)
        messages = self._node.outgoing()
        for number in self._streams.due(now_s):
            is_attitude = number == codec.shape("GIMBAL_DEVICE_ATTITUDE_STATUS").id
            messages.append(self._attitude(now_s, truth) if is_attitude else self._information(now_s))
        assert self._send is not None
        for message in messages:
            self._send(self._encoder.encode(message))

    def _answer(self, request: MavCommandRequest, now_s: float) -> None:
        result = self._streams.command(request, now_s)
        self._commands.answer(request, CommandResult.UNSUPPORTED if result is None else result, now_s=now_s)

    def _attitude(self, now_s: float, truth: Truth) -> MavlinkMessage:
        motion, vehicle_yaw = self.motion, yaw_of(truth.attitude_wxyz)
        yaw = wrap_pi(motion.yaw_rad + vehicle_yaw) if motion.is_from_north else motion.yaw_rad
        return codec.message(
            "GIMBAL_DEVICE_ATTITUDE_STATUS",
            time_boot_ms=round(now_s * 1e3),
            q=from_euler(0.0, motion.pitch_rad, yaw),
            angular_velocity_x=0.0,
            angular_velocity_y=motion.pitch_rate_rad_s,
            angular_velocity_z=motion.yaw_rate_rad_s,
            flags=_LEVEL | (_YAW_LOCK | _FROM_NORTH if motion.is_from_north else _IN_VEHICLE),
            failure_flags=_MOTOR_ERROR if motion.is_stuck else 0,
            delta_yaw=vehicle_yaw,
            delta_yaw_velocity=nan,
        )

    def _information(self, now_s: float) -> MavlinkMessage:
        (pitch_min, pitch_max), (yaw_min, yaw_max) = PITCH_LIMITS_DEG, YAW_LIMITS_DEG
        return codec.message(
            "GIMBAL_DEVICE_INFORMATION",
            time_boot_ms=round(now_s * 1e3),
            vendor_name="GLOC3",
            model_name="simulated gimbal",
            custom_name="",
            cap_flags=_HAS,
            pitch_min=radians(pitch_min),
            pitch_max=radians(pitch_max),
            yaw_min=radians(yaw_min),
            yaw_max=radians(yaw_max),
        )


class _Targets(Microservice[None]):
    """Receives targets of the gimbal manager."""

    handles = frozenset({"GIMBAL_DEVICE_SET_ATTITUDE"})

    def __init__(self, own: Address, motion: GimbalMotion) -> None:
        super().__init__(own)
        self._motion = motion

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Goes to neutral, to angles, or turns at rates."""
        if not self._is_for_us(message):
            return
        flags = message.flags
        is_from_north = bool(flags & _FROM_NORTH) or (bool(flags & _YAW_LOCK) and not flags & _IN_VEHICLE)
        if flags & _NEUTRAL:
            self._motion.point(0.0, 0.0, is_from_north=False)
        elif all(map(isfinite, message.q)):
            _, pitch, yaw = to_euler(tuple(message.q))
            self._motion.point(pitch, yaw, is_from_north=is_from_north)
        elif isfinite(message.angular_velocity_y) and isfinite(message.angular_velocity_z):
            self._motion.turn(message.angular_velocity_y, message.angular_velocity_z)


def _serves(request: MavCommandRequest) -> bool:
    """Commands to the gimbal; of those to everybody the request for its information, by which PX4 looks for gimbals."""
    is_search = request.command == REQUEST_MESSAGE and request.params[0] == codec.shape("GIMBAL_DEVICE_INFORMATION").id
    return request.target.component == COMPONENT or is_search


def _towards(angle: float, goal: float, duration_s: float, limits_deg: tuple[float, float]) -> float:
    """The angle after a time, on the way to the goal within limits and rate."""
    least, most = (radians(limit) for limit in limits_deg)
    step = radians(RATE_DEG_S) * duration_s
    return angle + min(max(min(max(goal, least), most) - angle, -step), step)
