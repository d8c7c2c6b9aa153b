"""Planes as their public interface shows them: ArduPilot's and PX4's, which cannot stop, turn in wide circles and loiter.

Sources: the documentation of Plane ("TAKEOFF mode", "GUIDED mode", "AUTOLAND mode") and the PX4 guide ("Takeoff mode",
"Offboard mode", fixed wing).
"""

import math
from typing import Final

from gloc3.clock import VirtualLoop
from gloc3.mavlink import codec
from gloc3.mavlink.message import MavlinkMessage
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.mavlink.transport.memory import MemoryEnd
from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3, wrap_pi

from .vehicle_peer import IGNORES_POSITION, STEP_S, VehiclePeer

SPEED_M_S: Final = 15.0
RADIUS_M: Final = 45.0
CLIMB_M_S: Final = 3.0
REPOSITION, TAKE_OFF, LAND = 192, 22, 21
ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4


class PlanePeer(VehiclePeer):
    """Flies to its place at a constant speed and goes round it; each family below says in which modes."""

    vehicle_type = 1
    take_off, loiter, back, land = 13, 12, 11, 26

    def __init__(
        self, loop: VirtualLoop, end: MemoryEnd, origin: tuple[float, float, float], parameters: dict[str, int]
    ) -> None:
        super().__init__(loop, end, origin, parameters)
        self.mode = self.loiter
        self.place: Vector3 = (0.0, 0.0, -50.0)
        """Where it flies to, or goes round."""
        self.requested_s: list[float] = []
        """When it was sent to a place."""

    def _enter(self, mode: int) -> None:
        super()._enter(mode)
        north, east, down = self.position
        if mode == self.take_off:
            ahead = 2.0 * RADIUS_M
            self.place = (north + ahead * math.cos(self.yaw_rad), east + ahead * math.sin(self.yaw_rad), -50.0)
        elif mode in (self.back, self.land):
            self.place = (0.0, 0.0, down)
        else:
            self.place = (north, east, down)

    def send_to(self, place: Vector3) -> None:
        """Sent to a place."""
        self.place, self.last_s = place, self._loop.time()
        self.requested_s.append(self.last_s)

    def move(self, now_s: float) -> None:
        """Turns towards its place, or onto a circle around it; climbs and sinks on the way."""
        if not self.is_armed or (self.mode not in (self.take_off, self.land) and self.position[2] > -1.0):
            self.velocity = [0.0, 0.0, 0.0]
            return
        north, east = self.place[0] - self.position[0], self.place[1] - self.position[1]
        distance_m = math.hypot(north, east)
        wanted_rad = math.atan2(east, north) if distance_m > 1.0 else self.yaw_rad
        if distance_m < 1.5 * RADIUS_M and self.mode != self.take_off:
            lean = math.pi / 2.0 * (1.0 if distance_m < RADIUS_M else (1.5 * RADIUS_M - distance_m) / (0.5 * RADIUS_M))
            wanted_rad += lean
        most = SPEED_M_S / RADIUS_M * 1.3 * STEP_S
        self.yaw_rad = wrap_pi(self.yaw_rad + max(-most, min(most, wrap_pi(wanted_rad - self.yaw_rad))))
        down = 0.0 if self.mode == self.land and distance_m < 3.0 * RADIUS_M else self.place[2]
        sink = max(-CLIMB_M_S, min(CLIMB_M_S, down - self.position[2]))
        self.velocity = [SPEED_M_S * math.cos(self.yaw_rad), SPEED_M_S * math.sin(self.yaw_rad), sink]
        if self.mode == self.land and self.position[2] > -0.3:
            self.position[2], self.is_armed = 0.0, False

    def _report(self, name: str, boot_ms: int) -> MavlinkMessage | None:
        if name == "EXTENDED_SYS_STATE":
            is_down = not self.is_armed or self.position[2] > -1.0
            landed = ON_GROUND if is_down else TAKING_OFF if self.mode == self.take_off else IN_AIR
            return codec.message(name, landed_state=LANDING if not is_down and self.mode == self.land else landed)
        return super()._report(name, boot_ms)


class ArduPlane(PlanePeer):
    """Takes off in TAKEOFF, is sent about by DO_REPOSITION in GUIDED, and lands in AUTOLAND."""

    guided = 15
    names = {0: "MANUAL", 10: "AUTO", 11: "RTL", 12: "LOITER", 13: "TAKEOFF", 15: "GUIDED", 26: "AUTOLAND"}

    def lead(self, message: MavlinkMessage) -> None:
        """A plane of ArduPilot takes no local setpoints."""
        self.refused.append(message.name)

    def _run(self, request: MavCommandRequest, now_s: float) -> CommandResult:
        if request.command != REPOSITION:
            return super()._run(request, now_s)
        if self.mode != self.guided or not request.is_int:
            self.refused.append(f"DO_REPOSITION in {self.names[self.mode]}")
            return CommandResult.DENIED
        self.send_to(TangentPlane(GeoPoint(*self._origin)).ned_from_geo(*request.params[4:]))
        return CommandResult.ACCEPTED


class Px4Plane(PlanePeer):
    """Takes off and lands by command, and flies to the positions that are streamed in offboard mode."""

    autopilot = 12
    take_off, loiter, back, land = (4 << 16 | sub << 24 for sub in (2, 3, 5, 6))
    guided = 6 << 16
    names = dict.fromkeys((take_off, loiter, back, land, guided), "")
    _streamed_s = -math.inf

    def lead(self, message: MavlinkMessage) -> None:
        """Takes positions."""
        if message.type_mask & IGNORES_POSITION:
            self.refused.append(f"type_mask {message.type_mask}")
        else:
            self.send_to((message.x, message.y, message.z))

    def _receive(self, data: bytes) -> None:
        frames = codec.Parser(is_datagram=True).receive(data)
        if any(frame.shape is not None and frame.shape.name == "SET_POSITION_TARGET_LOCAL_NED" for frame in frames):
            self._streamed_s = self._loop.time()
        super()._receive(data)

    def _run(self, request: MavCommandRequest, now_s: float) -> CommandResult:
        match request.command:
            case 176:
                mode = int(request.params[1]) << 16 | int(request.params[2]) << 24
                if mode == self.guided and now_s - self._streamed_s > 0.5:
                    self.refused.append("offboard mode without a stream")
                    return CommandResult.TEMPORARILY_REJECTED
                self._enter(mode)
                return CommandResult.ACCEPTED
            case 22:
                self._enter(self.take_off)
                self.place = (*self.place[:2], self._origin[2] - request.params[6])
                return CommandResult.ACCEPTED
            case 21:
                self._enter(self.land)
                return CommandResult.ACCEPTED
        return super()._run(request, now_s)

    def move(self, now_s: float) -> None:
        """After its climb it loiters."""
        super().move(now_s)
        if self.mode == self.take_off and self.position[2] < self.place[2] + 0.5:
            self._enter(self.loiter)
