"""AD: points the gimbal, for an action or for a station that steers it by hand; it has one owner at a time."""

from collections.abc import Sequence
from math import atan2, cos, degrees, hypot, pi
from typing import Annotated, ClassVar, Final, NamedTuple

from gloc3.component.action import ActionPerformer
from gloc3.component.component import ActuatorDriver
from gloc3.component.ports import Actuation, Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.messages.frames import Quaternion, Vector3, from_euler, wrap_pi, yaw_of
from gloc3.messages.standard_topics import POSE_LATE_S
from gloc3.messages.vehicle import GimbalDemand, GimbalState, GimbalVerb, Pose
from gloc3.mission.model.pointing import PointCameraOrder
from gloc3.mission.model.states import ActionState
from gloc3_onboard.payload.pointing import GimbalAttitude, GimbalDevice, GimbalProperties, GimbalTarget

SILENT_S: Final = 2.0
"""Age of an attitude from which the gimbal counts as silent, s."""
REPEAT_S: Final = 0.5
"""An unchanged target is sent again so often: a frame may be lost."""
REPORT_S: Final = 0.2
RATE_EXPIRES_S: Final = 2.0
"""A demanded rate that is older has ended, and the gimbal rests."""
NOBODY: Final = (0, 0)
_ROUNDING_RAD: Final = 1e-6


class GimbalSettings(Settings, frozen=True):
    """Settings of the driver."""

    tolerance_deg: Annotated[float, Bounds(0.1, 20.0)] = 2.0
    """Difference between target and reported direction within which the gimbal has arrived."""
    within_s: Annotated[float, Bounds(0.5, 300.0)] = 15.0
    """Time within which it must arrive; then the action fails."""


class _Look(NamedTuple):
    """Direction of a gimbal or a target."""

    pitch_rad: float
    yaw_rad: float
    """From the nose."""


class GimbalDriver(ActionPerformer, ActuatorDriver[GimbalSettings]):
    """Performs `point_camera`, and obeys the station that steers by hand.

    One owner: the action under way; without one the station that took the gimbal last. An action takes the gimbal from
    a station, whose demands are ignored from then on until it takes it again after the action. What has been reached is
    kept: nothing moves the gimbal when an action ends, or a station releases it.
    """

    performs: ClassVar = {"point_camera": PointCameraOrder}
    loggable = ("ignored", "sent", "owner")

    pose = Input(Pose, is_optional=True)
    gimbal_demand = Input(GimbalDemand, Keep.ALL, is_optional=True)
    gimbal = Output(GimbalState)

    def __init__(self, device: GimbalDevice) -> None:
        self.ignored = self.sent = 0
        """Demands of those who do not own the gimbal, and targets sent."""
        self._device = device
        self._order: PointCameraOrder | None = None
        self._station = NOBODY
        self._pose: Pose | None = None
        self._pose_s = self._began_s = self._sent_s = self._stated_s = self._demand_s = float("-inf")
        self._target: GimbalTarget | None = None
        self._last: GimbalTarget | None = None
        """The target sent last."""
        self._point_ned_m: Vector3 | None = None
        """A point that a station has the gimbal look at."""
        self._begun: _Look | None = None
        """Direction at the begin of the action."""
        self._state = GimbalState()

    @property
    def owner(self) -> str:
        """What points the gimbal; empty for nobody."""
        if self.action_id:
            return self.action_id
        return "" if self._station == NOBODY else f"station {self._station[0]}/{self._station[1]}"

    def start(self) -> None:
        """Begins to look for a gimbal."""
        self._device.open()

    def stop(self) -> None:
        """Forgets action, owner and target."""
        self.drop_action()
        self._order, self._station, self._target, self._point_ned_m = None, NOBODY, None, None

    # --- actions ---

    def begin_action(self, capability: str, arguments: PointCameraOrder, now_s: float) -> None:
        """Takes the gimbal.

        Raises:
            Refused: there is no gimbal, its direction is unknown, or the direction is outside its limits.
        """
        reason = self._problem(now_s)
        if reason:
            raise Refused(reason)
        target = self._wanted(arguments, now_s)
        properties = self._device.properties()
        assert properties is not None
        look = self._from_nose(target, now_s)
        if look is None:
            raise Refused("the vehicle's heading is not known, which a direction from north needs")
        _check(look, properties)
        self._order, self._station, self._point_ned_m = arguments, NOBODY, None
        self._begun = self._looks(self._device.attitude(), now_s)
        self._target, self._began_s = target, now_s

    def resume_action(self, now_s: float) -> None:
        """Points again; the time to arrive begins anew."""
        self._began_s = now_s

    def end_action(self, now_s: float) -> None:
        """Leaves the gimbal where it looks."""
        self._order = None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Follows the owner, and reports the gimbal's state."""
        pose = inbox.latest(self.pose)
        if pose is not None and pose.payload.is_valid:
            self._pose, self._pose_s = pose.payload, pose.t_s
        for envelope in inbox.new(self.gimbal_demand):
            self._obey(envelope.payload, now_s)
        if self._order is not None and self.is_running:
            self._follow(self._order, now_s)
        elif not self.action_id:
            self._steer(now_s)
        return [*self._writes(now_s), *self._report(now_s), *self.action_reports(now_s)]

    def _follow(self, order: PointCameraOrder, now_s: float) -> None:
        """Moves on with the action."""
        reason = self._problem(now_s)
        properties = self._device.properties()
        if not reason and self._device.other_owner() and now_s - self._began_s > SILENT_S:
            reason = f"{self._device.other_owner()} has taken the gimbal at the autopilot's manager"
        if reason or properties is None:
            self.advance(now_s, 0.0, ActionState.FAILED, reason)
            return
        try:
            self._target = self._wanted(order, now_s)
        except Refused as late:
            self.advance(now_s, 0.0, reason=str(late))
            return
        wanted, found = self._from_nose(self._target, now_s), self._looks(self._device.attitude(), now_s)
        if wanted is None or found is None:
            self.advance(now_s, 0.0, reason="the vehicle's heading is not known")
            return
        off_rad = _between(_clipped(wanted, properties), found)
        is_there = off_rad <= self.settings.tolerance_deg * pi / 180.0
        if not order.keep:
            self._arrive(now_s, wanted, found, off_rad, is_there=is_there)
            return
        outside = _outside(wanted, properties)
        self.advance(now_s, 0.0, reason=outside or ("" if is_there else f"{degrees(off_rad):.1f} deg off"))

    def _arrive(self, now_s: float, wanted: _Look, found: _Look, off_rad: float, *, is_there: bool) -> None:
        if is_there:
            self.advance(now_s, 1.0, ActionState.DONE)
        elif now_s - self._began_s > self.settings.within_s:
            reason = f"the gimbal looks at {_words(found)} after {self.settings.within_s:g} s, not at {_words(wanted)}"
            self.advance(now_s, 0.0, ActionState.FAILED, reason)
        else:
            whole_rad = _between(self._begun, wanted) if self._begun is not None else 0.0
            self.advance(now_s, 1.0 - min(off_rad / whole_rad, 1.0) if whole_rad > 0.0 else 0.0)

    # --- by hand ---

    def _obey(self, demand: GimbalDemand, now_s: float) -> None:
        sender = (demand.system, demand.component)
        if self.action_id or (demand.verb is not GimbalVerb.TAKE and sender != self._station):
            self.ignored += 1
            return
        self._demand_s = now_s
        self._point_ned_m = demand.point_ned_m if demand.verb is GimbalVerb.POINT else None
        match demand.verb:
            case GimbalVerb.TAKE:
                self._station = sender
            case GimbalVerb.RELEASE:
                self._station = NOBODY
                self._rest()
            case GimbalVerb.DIRECTION | GimbalVerb.RATE:
                is_rate = demand.verb is GimbalVerb.RATE
                self._target = GimbalTarget(demand.pitch_rad, demand.yaw_rad, demand.is_from_north, is_rate)
            case GimbalVerb.NEUTRAL:
                self._target = GimbalTarget(is_neutral=True)

    def _steer(self, now_s: float) -> None:
        """Keeps looking at a point, and ends a rate that has expired."""
        if self._point_ned_m is not None and self._has_pose(now_s):
            self._target = self._towards(self._point_ned_m)
        if now_s - self._demand_s > RATE_EXPIRES_S:
            self._rest()

    def _rest(self) -> None:
        """Ends a rate."""
        if self._target is not None and self._target.is_rate:
            self._target = self._target._replace(pitch_rad=0.0, yaw_rad=0.0)

    # --- directions ---

    def _problem(self, now_s: float) -> str:
        """Why the gimbal cannot be pointed; empty if it can."""
        if self._device.properties() is None:
            return "no gimbal is heard on the autopilot's network (MAVLink gimbal protocol v2)"
        attitude = self._device.attitude()
        if attitude is None or now_s - attitude.t_s > SILENT_S:
            return f"the gimbal has not reported its attitude for {SILENT_S:g} s"
        return ""

    def _has_pose(self, now_s: float) -> bool:
        return self._pose is not None and now_s - self._pose_s <= POSE_LATE_S

    def _wanted(self, order: PointCameraOrder, now_s: float) -> GimbalTarget:
        """Target of an order.

        Raises:
            Refused: it needs the vehicle's position, which is not known.
        """
        if order.point_ned_m is None:
            return GimbalTarget(order.pitch_rad, wrap_pi(order.yaw_rad), order.is_from_north)
        if not self._has_pose(now_s):
            raise Refused("the vehicle's position is not known, which a point to look at needs")
        return self._towards(order.point_ned_m)

    def _towards(self, point_ned_m: Vector3) -> GimbalTarget:
        """Direction of a point from the vehicle; the distance of the gimbal from the vehicle's centre is ignored."""
        assert self._pose is not None
        north, east, down = (there - here for there, here in zip(point_ned_m, self._pose.position_ned_m, strict=True))
        return GimbalTarget(atan2(-down, hypot(north, east)), atan2(east, north), is_from_north=True)

    def _from_nose(self, target: GimbalTarget, now_s: float) -> _Look | None:
        """A target with its yaw from the nose; None while the heading is not known."""
        if not target.is_from_north:
            return _Look(target.pitch_rad, target.yaw_rad)
        if self._pose is None or not self._has_pose(now_s):
            return None
        return _Look(target.pitch_rad, wrap_pi(target.yaw_rad - yaw_of(self._pose.ned_from_frd)))

    def _looks(self, attitude: GimbalAttitude | None, now_s: float) -> _Look | None:
        """Reported direction; None while it, or the heading that it needs, is not known."""
        if attitude is None:
            return None
        return self._from_nose(GimbalTarget(attitude.pitch_rad, attitude.yaw_rad, attitude.is_from_north), now_s)

    # --- out ---

    def _writes(self, now_s: float) -> list[Result]:
        """The target, if it has changed, and again from time to time while somebody owns the gimbal."""
        target, is_owned = self._target, bool(self.owner)
        if target is None or self._device.properties() is None or self._problem(now_s):
            return []
        if target == self._last and not (is_owned and now_s - self._sent_s >= REPEAT_S - 1e-6):
            return []
        self._last, self._sent_s = target, now_s
        return [Actuation(target)]

    def actuate(self, write: GimbalTarget) -> None:
        """Sends a target."""
        self.sent += 1
        self._device.point(write)

    def make_safe(self) -> None:
        """Ends a rate; the gimbal keeps its direction."""
        if self._last is not None and self._last.is_rate and (self._last.pitch_rad or self._last.yaw_rad):
            self._device.point(self._last._replace(pitch_rad=0.0, yaw_rad=0.0))

    def _report(self, now_s: float) -> list[Result]:
        """State five times a second, and when its owner changes."""
        system, component = self._station
        if self.action_id:
            system, component = self._device.own
        is_due = now_s - self._stated_s >= REPORT_S - 1e-6
        if not is_due and self.owner == self._state.owner:
            return []
        self._stated_s = now_s
        properties, attitude = self._device.properties(), self._device.attitude()
        look = self._looks(attitude, now_s)
        is_valid = look is not None and not self._problem(now_s)
        found = properties or GimbalProperties(0)
        self._state = GimbalState(
            reason=self._problem(now_s),
            device=found.device,
            pitch_rad=look.pitch_rad if look is not None else 0.0,
            yaw_rad=look.yaw_rad if look is not None else 0.0,
            ned_from_gimbal=self._attitude(attitude, look),
            is_attitude_valid=is_valid and self._has_pose(now_s),
            owner=self.owner,
            owner_system=system,
            owner_component=component,
            pitch_limits_rad=found.pitch_limits_rad,
            yaw_limits_rad=found.yaw_limits_rad,
            capability_flags=found.capability_flags,
            device_flags=attitude.flags if attitude is not None else 0,
            manager=found.manager,
            ignored=self.ignored,
        )
        stamp_s = attitude.t_s if attitude is not None and is_valid else now_s
        return [self.gimbal.report(self._state, t_s=stamp_s)]

    def _attitude(self, attitude: GimbalAttitude | None, look: _Look | None) -> Quaternion:
        """`ned_from_gimbal`, as far as it is known."""
        if attitude is None or look is None or self._pose is None:
            return (1.0, 0.0, 0.0, 0.0)
        return from_euler(attitude.roll_rad, look.pitch_rad, wrap_pi(look.yaw_rad + yaw_of(self._pose.ned_from_frd)))


def _between(one: _Look, other: _Look) -> float:
    """Angle between two directions."""
    yaw = wrap_pi(one.yaw_rad - other.yaw_rad) * cos((one.pitch_rad + other.pitch_rad) / 2.0)
    return hypot(wrap_pi(one.pitch_rad - other.pitch_rad), yaw)


def _clipped(look: _Look, properties: GimbalProperties) -> _Look:
    """The nearest direction within the limits."""
    (low, high), (left, right) = properties.pitch_limits_rad, properties.yaw_limits_rad
    return _Look(min(max(look.pitch_rad, low), high), min(max(look.yaw_rad, left), right))


def _outside(look: _Look, properties: GimbalProperties) -> str:
    """Which limit a direction exceeds; empty for none."""
    named = (
        ("pitch", look.pitch_rad, properties.pitch_limits_rad),
        ("yaw", look.yaw_rad, properties.yaw_limits_rad),
    )
    for name, angle, (least, most) in named:
        if not least - _ROUNDING_RAD <= angle <= most + _ROUNDING_RAD:
            return f"{name} {degrees(angle):.0f} deg is outside the gimbal's {degrees(least):.0f} to {degrees(most):.0f} deg"
    return ""


def _check(look: _Look, properties: GimbalProperties) -> None:
    """Refuses a direction outside the limits.

    Raises:
        Refused: with angle and limits.
    """
    reason = _outside(look, properties)
    if reason:
        raise Refused(reason)


def _words(look: _Look) -> str:
    return f"pitch {degrees(look.pitch_rad):.0f}, yaw {degrees(look.yaw_rad):.0f} deg"
