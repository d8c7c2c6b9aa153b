"""Vehicle messages, between samplers, processors, controllers and drivers.

Frames: *ned* is the tangent plane at the origin of the platform's local frame (x north, y east, z down), *frd* the body
(x forward, y right, z down). Attitudes are `ned_from_frd`, quaternions wxyz, Hamilton, w >= 0. Times of validity are in
the envelope.
"""

from enum import StrEnum
from math import inf, isfinite, pi
from typing import Final

import msgspec

from gloc3.messages.envelope import Message
from gloc3.messages.frames import Quaternion, Vector3
from gloc3.mission.model.fence import Fence


class Style(StrEnum):
    """Family of an autopilot, from its heartbeat."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"


class VehicleClass(StrEnum):
    """Classes of vehicles, reported in the heartbeat; an autopilot's modes and behaviour differ by it."""

    COPTER = "copter"
    ROVER = "rover"
    BOAT = "boat"
    SUB = "sub"
    PLANE = "plane"
    VTOL = "vtol"
    """A plane that rotors lift and hold: on rotors it is led as it likes, on wings it does not stop."""


class VtolForm(StrEnum):
    """What carries a VTOL, by EXTENDED_SYS_STATE."""

    ROTORS = "rotors"
    TO_WINGS = "to_wings"
    WINGS = "wings"
    TO_ROTORS = "to_rotors"


VTOL_FORMS: Final = {
    1: VtolForm.TO_WINGS,
    2: VtolForm.TO_ROTORS,
    3: VtolForm.ROTORS,
    4: VtolForm.WINGS,
}
"""By MAV_VTOL_STATE."""
_FORM_WORDS: Final = {
    VtolForm.ROTORS: "on rotors",
    VtolForm.TO_WINGS: "in transition to wings",
    VtolForm.WINGS: "on wings",
    VtolForm.TO_ROTORS: "in transition to rotors",
}


def mode_in_words(mode_name: str, form: VtolForm | None) -> str:
    """A mode as people read it, with what carries a VTOL: `AUTO.MISSION, on wings`."""
    return mode_name if form is None else f"{mode_name}, {_FORM_WORDS[form]}"


class FlightMode(StrEnum):
    """Meaning of an autopilot's mode; each style maps its own numbers to these."""

    TAKE_OFF = "take_off"
    HOLD = "hold"
    """It holds its position autonomously."""
    GUIDED = "guided"
    """It follows our setpoints (PX4: offboard; ArduPilot: guided)."""
    MISSION = "mission"
    RETURN = "return"
    LAND = "land"
    MANUAL = "manual"
    """Any mode that a pilot flies with sticks."""
    OTHER = "other"


class LandedState(StrEnum):
    """The autopilot's belief about being on the ground or in the air."""

    UNKNOWN = "unknown"
    ON_GROUND = "on_ground"
    IN_AIR = "in_air"
    TAKING_OFF = "taking_off"
    LANDING = "landing"


class AutopilotState(Message, frozen=True):
    """State of the autopilot, from its heartbeat and status messages."""

    is_connected: bool
    """False when no heartbeat came for 2.5 s; the other fields are then the last known ones."""
    style: Style | None = None
    is_armed: bool = False
    mode: FlightMode = FlightMode.OTHER
    mode_name: str = ""
    """The mode in the autopilot's own words."""
    landed: LandedState = LandedState.UNKNOWN
    is_armable: bool = False
    reasons: list[str] = []
    """Why it would refuse to arm, in words."""
    battery_v: float = 0.0
    battery_a: float = 0.0
    battery_remaining: float = -1.0
    """0 to 1; negative where it is not known."""
    is_failsafe: bool = False
    """A failsafe of the autopilot is active (MAV_STATE critical or emergency)."""
    vehicle: VehicleClass | None = None
    doubts: list[str] = []
    """What its sensors' health and its estimator's flags say against a start, in words."""
    has_home: bool = False
    """Whether it has reported its home position."""
    form: VtolForm | None = None
    """What carries it, where it is a VTOL."""
    has_transmitter: bool = False
    """Whether it hears a pilot's transmitter or joystick, by SYS_STATUS."""


class AutopilotPose(Message, frozen=True):
    """The autopilot's own estimate, in its own local frame (NED at its estimator's origin).

    On the topic `autopilot_attitude`, while the estimator has no position, attitude and rates alone hold.
    """

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    ned_from_frd: Quaternion
    rate_frd_rad_s: Vector3
    origin_geo: tuple[float, float, float] | None = None
    """The estimator's origin: latitude and longitude in degrees, altitude above mean sea level in metres."""
    has_height: bool = True
    """Whether anything measures the height; else it is reckoned from accelerations alone."""


class HeightAboveGround(Message, frozen=True):
    """Distance to the ground below, from a range finder that is fixed to the body."""

    height_m: float
    """Along the body's down axis: where the body is tilted, more than the height above level ground."""
    is_valid: bool
    reason: str = ""


class Pose(Message, frozen=True):
    """Pose of the platform, in the NED frame at the origin of its local frame."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    ned_from_frd: Quaternion
    rate_frd_rad_s: Vector3 = (0.0, 0.0, 0.0)
    position_std_m: Vector3 = (0.0, 0.0, 0.0)
    """Standard deviation along each axis."""
    is_valid: bool = True
    reason: str = ""
    quality: float = 1.0
    """0 to 1."""
    reset_counter: int = 0
    """Grows by one at each jump of the estimate."""
    sources: list[str] = []
    """Sources of the estimate."""
    origin_geo: tuple[float, float, float] | None = None
    """Origin of the NED frame: latitude and longitude in degrees, altitude above mean sea level in metres."""

    def is_sound(self) -> bool:
        """Whether it is finite, or not valid: NaN is neither near to nor far from anything, and so passes comparisons.

        The origin, which is used without a valid pose, too, is finite in any case.
        """
        numbers = (
            *self.position_ned_m,
            *self.velocity_ned_m_s,
            *self.ned_from_frd,
            *self.rate_frd_rad_s,
            *self.position_std_m,
            self.quality,
        )
        return all(map(isfinite, self.origin_geo or ())) and (not self.is_valid or all(map(isfinite, numbers)))


OBSTACLE_SECTORS: Final = 72
NOT_MEASURED_M: Final = -1.0
"""Distance of a sector without measurements."""


class ObstacleScan(Message, frozen=True):
    """Hits of a range scanner, once round."""

    points_ne_m: list[tuple[float, float]]
    """Where something was hit: metres north and east, in the NED frame of the pose."""
    height_m: float = 0.0
    """Height of the plane of the scan above the origin of that frame."""
    is_valid: bool = True
    reason: str = ""
    sectors_m: list[float] = []
    """Nearest hit in each of `OBSTACLE_SECTORS` sectors, clockwise, the first centred ahead of the body, as in
    MAVLink's OBSTACLE_DISTANCE. `range_max_m` and more: nothing there; `NOT_MEASURED_M`: not measured."""
    range_max_m: float = 0.0
    closest_ne_m: list[tuple[float, float]] = []
    """Nearest points of separate objects, the nearest first."""

    @property
    def closest_m(self) -> float:
        """Distance of the nearest hit; infinite without one that was measured."""
        return min((distance_m for distance_m in self.sectors_m if distance_m >= 0.0), default=inf)


class Image(Message, frozen=True):
    """A camera's frame, passed by reference inside a process."""

    camera: str
    width: int
    height: int
    data: bytes
    """Rows of 8-bit grey values, `height * width` bytes."""
    is_valid: bool = True
    reason: str = ""
    bgr: bytes = b""
    """For people: rows of 8-bit blue, green and red values, `3 * height * width` bytes; empty for a grey picture."""


class ImageRecorded(Message, frozen=True):
    """An image that was written to disk, with where it was taken from."""

    action_id: str
    camera: str
    file: str
    """The file's name inside the run's `images` folder."""
    index: int
    position_ned_m: Vector3
    ned_from_frd: Quaternion


class MotionGrant(Message, frozen=True):
    """Owner of `motion`: published by the command interface server, obeyed by limiter and driver."""

    action_id: str
    component: str
    """The component that may move the vehicle; empty for none."""


class Setpoint(Message, frozen=True):
    """Next motion of the vehicle; streamed. Fields that are None are left to the autopilot."""

    action_id: str
    """The owner of motion that this comes from."""
    position_ned_m: Vector3 | None = None
    velocity_ned_m_s: Vector3 | None = None
    """With a position: feed-forward."""
    yaw_rad: float | None = None
    """Heading, clockwise from north."""


class ManoeuvreKind(StrEnum):
    """Manoeuvres that the autopilot flies by itself on request."""

    TAKE_OFF = "take_off"
    LAND = "land"
    HOLD = "hold"
    SET_OFF = "set_off"
    """Arm and follow setpoints from the current position: for vehicles that do not take off autonomously."""
    PLAN = "plan"
    """Fly the uploaded plan."""


class Manoeuvre(Message, frozen=True):
    """Requests from the driver that the autopilot flies a manoeuvre in one of its own modes."""

    action_id: str
    kind: ManoeuvreKind
    height_m: float = 0.0
    """Take-off: height above the place of arming."""
    may_arm: bool = False
    """Take-off, and a plan that begins with one: whether the vehicle may be armed for it."""
    end_ned_m: Vector3 | None = None
    """Plan: where it ends, or where its last item begins to come down."""
    comes_down: bool = False
    """Plan: whether its last item brings the vehicle to the ground, so that a return, a landing and the disarming follow."""


class ManoeuvreState(StrEnum):
    """Progress of a manoeuvre."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


class DriverState(Message, frozen=True):
    """State of the autopilot driver, and counts of what it has turned down."""

    action_id: str = ""
    """The owner of motion that it obeys."""
    is_streaming: bool = False
    has_pilot_control: bool = False
    """A human pilot (or the autopilot itself) has taken over: GLOC3 does not move or command the vehicle."""
    pilot_reason: str = ""
    manoeuvre_id: str = ""
    """Action of the current or last manoeuvre."""
    manoeuvre: ManoeuvreKind | None = None
    manoeuvre_state: ManoeuvreState | None = None
    manoeuvre_reason: str = ""
    foreign: int = 0
    """Setpoints from a component that did not own motion."""
    stale: int = 0
    """Setpoints older than 0.25 s."""
    not_finite: int = 0
    clamped: int = 0
    """Setpoints beyond the platform's limits, brought back inside."""
    expired: int = 0
    """Times that no valid setpoint came for 0.5 s and the autopilot's hold was commanded."""
    is_guided: bool = False
    """The autopilot follows the stream of setpoints."""
    refusal: str = ""
    """Why the autopilot does not accept the mode that the start or end of the stream requires."""
    is_failsafe: bool = False
    """Who has taken over is the autopilot's failsafe, no human."""
    held_after_gap_s: float = 0.0
    """Duration of the last loss of contact in which the autopilot switched to hold, s; the stream then continues."""
    steady_s: float = 0.0
    """Time for which setpoints must arrive steadily before the autopilot is commanded to follow them, s; 0 without
    recent gaps."""
    is_after_landing: bool = False
    """The autopilot is in a mode that it enters by itself after a landing, as ArduSub does."""


class MotionLimits(Message, frozen=True):
    """Limits that the limiter and the driver keep to: the platform's limits and the mission's fence."""

    speed_m_s: float
    climb_m_s: float
    acceleration_m_s2: float
    height_min_m: float
    height_max_m: float
    fence: Fence | None = None
    fence_margin_m: float = 0.5
    """How near to the fence the vehicle may come."""
    home_ned_m: Vector3 | None = None
    """Home, from which `height_min_m` and `height_max_m` count; None while it is not known: then only the fence's
    ceiling limits the height."""
    separation_m: float = 0.0
    """Least distance from other vehicles, to the side; 0 for none."""
    separation_height_m: float = 1.0
    """The same, up and down."""


class RouteWanted(Message, frozen=True):
    """Request for a way around obstacles, repeated while its action runs."""

    action_id: str
    request: int
    """Grows with each request for another way of the same action."""
    down_m: float
    """Height to fly at, as NED."""
    goal_ne_m: tuple[float, float] | None = None
    """Where to; None to explore."""
    area_ne_m: tuple[tuple[float, float], ...] = ()
    """Corners of the area to explore; empty for all that is inside the fence."""


class PlannedRoute(Message, frozen=True):
    """A way around obstacles, as an answer to a request and again whenever it changes."""

    action_id: str
    request: int
    """That it answers."""
    number: int = 0
    """Grows with each way of an action."""
    waypoints_ned_m: list[Vector3] = []
    """From the vehicle to the goal; empty where there is no way, or nothing is left to explore."""
    is_complete: bool = False
    """Whether nothing is left to explore."""
    progress: float = 0.0
    """Share of the area that is known, 0 to 1."""
    reason: str = ""
    """Why there is no way, or what was found."""


class GeoArea(msgspec.Struct, frozen=True, array_like=True):
    """One area of a geographic fence: a polygon, or a circle if there is a centre."""

    is_inclusion: bool
    """Where the vehicle may be, else where it may not."""
    polygon: list[tuple[float, float]] = []
    """Corners: latitude and longitude in degrees."""
    center: tuple[float, float] | None = None
    radius_m: float = 0.0


class GeoFence(Message, frozen=True):
    """Fence of the loaded mission for the autopilot to enforce, too; without areas where it has no geographic fence."""

    digest: str
    """Of the mission, empty without one; identifies the upload."""
    areas: list[GeoArea] = []


class FenceProgress(StrEnum):
    """Progress of the autopilot's fence."""

    NONE = "none"
    UPLOADING = "uploading"
    CONFIRMED = "confirmed"
    """The autopilot has it, returned an identical copy, and has enabled it, as far as it reports that."""
    FAILED = "failed"


class FenceState(Message, frozen=True):
    """State of the fence that the autopilot was given."""

    digest: str
    progress: FenceProgress
    reason: str = ""


class Home(Message, frozen=True):
    """Position at which the vehicle was armed; kept on disk by the command interface server."""

    position_ned_m: Vector3


class EmergencyDisarm(Message, frozen=True):
    """An operator has typed the platform's name: disarm now, in flight too."""

    author: str


class TakeOver(Message, frozen=True):
    """An operator's permission to continue after a pilot had control."""

    is_resumed: bool


class GimbalState(Message, frozen=True):
    """State of the gimbal and its owner.

    Pitch is measured from the horizon, up positive; yaw from the vehicle's nose or from north, clockwise positive. The axes
    of the gimbal are forward, right, down, as a body's; its camera looks ahead along the first.
    """

    reason: str = ""
    """Why it cannot be pointed, such as that none is heard; empty if it can."""
    device: int = 0
    """MAVLink component of the gimbal; 0 while none is known."""
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    """From the nose."""
    ned_from_gimbal: Quaternion = (1.0, 0.0, 0.0, 0.0)
    is_attitude_valid: bool = False
    """Whether the three above are known."""
    owner: str = ""
    """What points it: the id of an action, or `station SYSTEM/COMPONENT`; empty for nobody."""
    owner_system: int = 0
    """MAVLink address of the owner: that of the onboard computer while an action points it; 0 for nobody."""
    owner_component: int = 0
    pitch_limits_rad: tuple[float, float] = (-pi, pi)
    yaw_limits_rad: tuple[float, float] = (-pi, pi)
    """From the nose."""
    capability_flags: int = 0
    """GIMBAL_DEVICE_CAP_FLAGS."""
    device_flags: int = 0
    """GIMBAL_DEVICE_FLAGS."""
    manager: int = 0
    """MAVLink component of another gimbal manager that the gimbal belongs to; 0 if it belongs to the onboard computer."""
    ignored: int = 0
    """Demands of those who do not own it, so far."""


class GimbalVerb(StrEnum):
    """Kinds of demands."""

    TAKE = "take"
    """Own the gimbal; refused while an action points it."""
    RELEASE = "release"
    DIRECTION = "direction"
    RATE = "rate"
    POINT = "point"
    NEUTRAL = "neutral"


class GimbalDemand(Message, frozen=True):
    """A station's demand by hand; after `take`, only those of the owner count."""

    verb: GimbalVerb
    system: int
    """MAVLink address of the sender."""
    component: int
    pitch_rad: float = 0.0
    """With `direction`; with `rate` in rad/s."""
    yaw_rad: float = 0.0
    is_from_north: bool = False
    """Whether the yaw is measured from north, and kept when the vehicle turns."""
    point_ned_m: Vector3 | None = None
    """With `point`: looked at until the next demand."""
