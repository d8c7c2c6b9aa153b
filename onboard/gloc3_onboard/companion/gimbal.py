"""The gimbal manager of the onboard computer, by the gimbal protocol v2: stations find the gimbal, own it and steer it."""

from collections.abc import Callable, Mapping
from math import inf, isfinite, isnan, radians
from typing import Any, Final, Never

from gloc3.errors import Refused
from gloc3.exchange.base import Exchange, Publisher
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.mavlink.services.plan import units_per_degree
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import GeoPoint, TangentPlane, to_euler
from gloc3.messages.vehicle import GimbalDemand, GimbalState, GimbalVerb, Pose
from gloc3.network.rights_file import Right
from gloc3_onboard.companion.pending_requests import PendingRequests

POINT_AT, POINT_NOWHERE = 195, 197
"""DO_SET_ROI_LOCATION and DO_SET_ROI_NONE."""
PITCH_YAW, CONFIGURE = 1000, 1001
"""DO_GIMBAL_MANAGER_PITCHYAW and DO_GIMBAL_MANAGER_CONFIGURE."""
STATUS_HZ: Final = 1.0
MANUAL_RAD_S: Final = 0.5
"""Rate of a stick that is fully deflected (GIMBAL_MANAGER_SET_MANUAL_CONTROL)."""
SILENT_S: Final = 2.0
"""Age of a state from which the driver counts as silent, s."""
_NEUTRAL, _RETRACT, _YAW_LOCK, _IN_VEHICLE, _FROM_NORTH = 2, 1, 16, 32, 64
"""GIMBAL_MANAGER_FLAGS."""
_CAN_POINT: Final = 65536 | 131072
"""GIMBAL_MANAGER_CAP_FLAGS: at points."""
_LEAVE, _OURSELVES, _RELEASE = -1.0, -2.0, -3.0
"""Values of DO_GIMBAL_MANAGER_CONFIGURE for an owner."""


class GimbalManager(Microservice[Never]):
    """Translates between stations and the driver, which decides who owns the gimbal.

    Commands are answered at once, since MAVSDK 4.1 ends its program where one is in progress first: that a station owns the
    gimbal is seen in the status.

    Args:
        own: address of the onboard computer.
        platform: the platform's name.
        exchange: the platform's middleware.
        boot: random number of this start of the process.
        requesting: control of the platform.
        changed: called when a state has come.
        report: called with the reason where the platform's control, and so the gimbal, cannot be had.
    """

    handles = frozenset(
        {"GIMBAL_MANAGER_SET_ATTITUDE", "GIMBAL_MANAGER_SET_PITCHYAW", "GIMBAL_MANAGER_SET_MANUAL_CONTROL"}
    )

    def __init__(
        self,
        own: Address,
        platform: str,
        exchange: Exchange,
        boot: int,
        requesting: PendingRequests,
        changed: Callable[[], None],
        report: Callable[[str], None],
    ) -> None:
        super().__init__(own)
        self.state = GimbalState(reason="the gimbal's driver has not reported yet")
        """Latest state."""
        self.ignored = 0
        """Messages of those who do not own the gimbal."""
        self._publisher = Publisher(exchange, platform, "companion", boot)
        self._topic = f"{platform}/gimbal_demand"
        self._requesting, self._changed, self._report = requesting, changed, report
        self._pose: Pose | None = None
        self._state_s = self._taken_s = -inf
        self._taking: Address | None = None
        """A station that is about to own the gimbal, as the driver has not reported yet."""
        self._waiting: GimbalDemand | None = None
        """Its latest demand."""
        self._unsubscribes = [
            exchange.subscribe(f"{platform}/gimbal", self._receive_state),
            exchange.subscribe(f"{platform}/pose", self._receive_pose),
        ]

    def close(self) -> None:
        """Unsubscribes."""
        for unsubscribe in self._unsubscribes:
            unsubscribe()

    @property
    def problem(self) -> str:
        """Why there is no gimbal to steer here; empty if there is one."""
        state = self.state
        if self._requesting.now_s() - self._state_s > SILENT_S:
            return "the gimbal's driver does not report"
        if state.manager:
            return f"component {state.manager} is the manager of the gimbal: ask it"
        return state.reason

    @property
    def commands(self) -> Mapping[int, Callable[[MavCommandRequest], None]]:
        """Commands by number; one that is refused raises `Refused`."""
        return {
            CONFIGURE: self._configure,
            PITCH_YAW: self._pitch_yaw,
            POINT_AT: self._point_at,
            POINT_NOWHERE: lambda request: self._demand(request.sender, GimbalVerb.NEUTRAL),
        }

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles a stream of targets; those of others than the owner are counted."""
        if not self._is_for_us(message) or message.gimbal_device_id not in (0, self.state.device):
            return
        try:
            self._demand(sender, **_streamed(message))
        except Refused:
            self.ignored += 1

    # --- commands ---

    def _configure(self, request: MavCommandRequest) -> None:
        """Primary control; secondary control is not supported, as in PX4, and its parameters are ignored."""
        owner, sender = request.params[:2], request.sender
        self._check_device(request.params[6])
        if owner == (_LEAVE, _LEAVE):
            return
        if owner[0] in (_RELEASE, _OURSELVES, 0.0):
            if self._owns(sender):
                self._taking = None
                self._publish(GimbalDemand(verb=GimbalVerb.RELEASE, system=sender.system, component=sender.component))
        elif owner == sender:
            self._take(sender)
        else:
            raise Refused("a station takes control of the gimbal for itself only")

    def _take(self, sender: Address) -> None:
        self._check_rights(sender)
        if self._claimed:
            raise Refused(self._claimed)

        def obtained(reason: str) -> None:
            waiting, self._waiting = self._waiting, None
            if reason:
                self._taking = None
                self._report(f"station {sender.system} does not get the gimbal: {reason}")
                return
            self._taken_s = self._requesting.now_s()
            self._publish(GimbalDemand(verb=GimbalVerb.TAKE, system=sender.system, component=sender.component))
            if waiting is not None:
                self._publish(waiting)

        self._taken_s, self._waiting = inf, None
        self._requesting.obtain(sender, obtained)
        self._taking = sender

    def _owns(self, sender: Address) -> bool:
        """Whether a station owns the gimbal, or is about to."""
        is_new = sender == self._taking and self._requesting.now_s() - self._taken_s < SILENT_S
        return is_new or (self.state.owner_system, self.state.owner_component) == sender

    @property
    def _claimed(self) -> str:
        """Which action points the gimbal; empty for none."""
        state = self.state
        if (state.owner_system, state.owner_component) != self.own:
            return ""
        return f"the gimbal is claimed by {state.owner.partition('#')[0]}; pause or abort it first"

    def _pitch_yaw(self, request: MavCommandRequest) -> None:
        pitch, yaw, pitch_rate, yaw_rate, flags, _, device = request.params
        if request.is_int:  # the flags are a whole number there, not degrees
            flags *= units_per_degree(request.frame)
        self._check_device(device)
        angles = tuple(radians(value) for value in (pitch, yaw, pitch_rate, yaw_rate))
        self._demand(request.sender, **_directed(*angles, flags=round(flags) if isfinite(flags) else 0))

    def _point_at(self, request: MavCommandRequest) -> None:
        latitude, longitude, altitude_m = request.params[4:7]
        origin = self._pose.origin_geo if self._pose is not None else None
        if origin is None:
            raise Refused("the vehicle does not know its place on Earth")
        if request.is_int and request.frame not in (0, 5):
            raise Refused("the altitude of the point must be above mean sea level (MAV_FRAME_GLOBAL)")
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and isfinite(altitude_m)):
            raise Refused("the point needs latitude, longitude and altitude")
        self._check_device(request.params[0])
        point = TangentPlane(GeoPoint(*origin)).ned_from_geo(latitude, longitude, altitude_m)
        self._demand(request.sender, GimbalVerb.POINT, point_ned_m=point)

    def _check_device(self, number: float) -> None:
        if self.problem:
            raise Refused(self.problem)
        if not isnan(number) and number not in (0.0, float(self.state.device)):
            raise Refused(f"gimbal {number:g} is not known; the gimbal here is {self.state.device}")

    def _demand(self, sender: Address, verb: GimbalVerb, **fields: Any) -> None:
        """Passes on a demand of the owner.

        Raises:
            Refused: there is no gimbal, or the sender does not own it.
        """
        if self.problem:
            raise Refused(self.problem)
        if self._claimed:
            raise Refused(self._claimed)
        if not self._owns(sender):
            owner = self.state.owner or "nobody"
            raise Refused(f"{owner} has control of the gimbal; take it first (DO_GIMBAL_MANAGER_CONFIGURE)")
        self._check_rights(sender)
        demand = GimbalDemand(verb=verb, system=sender.system, component=sender.component, **fields)
        if self._taken_s == inf:
            self._waiting = demand
        else:
            self._requesting.require(sender.system)
            self._publish(demand)

    def _check_rights(self, sender: Address) -> None:
        if not self._requesting.may(sender.system, Right.FLY):
            raise Refused(f"station {sender.system} may only look")

    def _publish(self, demand: GimbalDemand) -> None:
        self._publisher.publish(self._topic, demand, self._requesting.now_s())

    # --- messages ---

    def information(self, boot_ms: int) -> MavlinkMessage | None:
        """GIMBAL_MANAGER_INFORMATION; None while there is no gimbal."""
        state = self.state
        if self.problem:
            return None
        return codec.message(
            "GIMBAL_MANAGER_INFORMATION",
            time_boot_ms=boot_ms,
            cap_flags=state.capability_flags | _CAN_POINT,
            pitch_min=state.pitch_limits_rad[0],
            pitch_max=state.pitch_limits_rad[1],
            yaw_min=state.yaw_limits_rad[0],
            yaw_max=state.yaw_limits_rad[1],
            gimbal_device_id=state.device,
        )

    def status(self, boot_ms: int) -> MavlinkMessage | None:
        """GIMBAL_MANAGER_STATUS; None while there is no gimbal."""
        state = self.state
        if self.problem:
            return None
        return codec.message(
            "GIMBAL_MANAGER_STATUS",
            time_boot_ms=boot_ms,
            flags=state.device_flags,
            gimbal_device_id=state.device,
            primary_control_sysid=state.owner_system,
            primary_control_compid=state.owner_component,
        )

    def _receive_state(self, envelope: Envelope[GimbalState]) -> None:
        before, self.state = self.state, envelope.payload
        self._state_s = self._requesting.now_s()
        if (self.state.owner_system, self.state.owner_component) == self._taking:
            self._taking = None
        if (before.owner, before.device, before.reason) != (self.state.owner, self.state.device, self.state.reason):
            self._changed()

    def _receive_pose(self, envelope: Envelope[Pose]) -> None:
        if envelope.payload.is_sound():
            self._pose = envelope.payload


def _streamed(message: MavlinkMessage) -> dict[str, Any]:
    """The demand of a message.

    Raises:
        Refused: it demands nothing.
    """
    match message.name:
        case "GIMBAL_MANAGER_SET_ATTITUDE":
            pitch, yaw = to_euler(tuple(message.q))[1:] if all(map(isfinite, message.q)) else (float("nan"),) * 2
            pitch_rate, yaw_rate = message.angular_velocity_y, message.angular_velocity_z
        case "GIMBAL_MANAGER_SET_PITCHYAW":
            pitch, yaw, pitch_rate, yaw_rate = message.pitch, message.yaw, message.pitch_rate, message.yaw_rate
        case _:  # sticks, from -1 to 1
            pitch, yaw = message.pitch, message.yaw
            pitch_rate, yaw_rate = message.pitch_rate * MANUAL_RAD_S, message.yaw_rate * MANUAL_RAD_S
    return _directed(pitch, yaw, pitch_rate, yaw_rate, flags=message.flags)


def _directed(pitch: float, yaw: float, pitch_rate: float, yaw_rate: float, *, flags: int) -> dict[str, Any]:
    """The demand of angles in rad and rates in rad/s; a missing one is NaN.

    Raises:
        Refused: neither both angles nor both rates are given, or the gimbal cannot do it.
    """
    if flags & _RETRACT:
        raise Refused("the gimbal is not retracted by the onboard computer")
    if flags & _NEUTRAL:
        return {"verb": GimbalVerb.NEUTRAL}
    is_from_north = bool(flags & _FROM_NORTH) or (bool(flags & _YAW_LOCK) and not flags & _IN_VEHICLE)
    if isfinite(pitch) and isfinite(yaw):
        return {"verb": GimbalVerb.DIRECTION, "pitch_rad": pitch, "yaw_rad": yaw, "is_from_north": is_from_north}
    if isfinite(pitch_rate) and isfinite(yaw_rate):
        return {"verb": GimbalVerb.RATE, "pitch_rad": pitch_rate, "yaw_rad": yaw_rate, "is_from_north": is_from_north}
    raise Refused("both angles or both rates must be given")
