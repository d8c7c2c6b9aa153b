"""AD: sends the platform's pose to the autopilot, which flies by it without satellites."""

from collections.abc import Sequence
from math import radians
from typing import Annotated, Any, Final, NamedTuple, Protocol

import msgspec

from gloc3.component.component import ActuatorDriver
from gloc3.component.ports import Actuation, Inbox, Input, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.messages.vehicle import AutopilotPose, AutopilotState, Pose
from gloc3_onboard.sensors.devices import CommandAnswer

ORIGIN_PERIOD_S: Final = 1.0
HOME_S: Final = 8.0
"""Time within which an autopilot with our origin should report its home, s."""
REPEAT_S: Final = 5.0
"""Time between requests for a set of sources that the autopilot has not accepted, s; a missing answer is reported before."""
_SAME_DEG: Final = 2e-7
_SAME_M: Final = 0.01


class PoseInput(Protocol):
    """Interface for sending an autopilot its pose. Nothing blocks."""

    @property
    def contacts(self) -> int:
        """Times that an autopilot was found, came back or restarted: it may have dropped what it was commanded before."""

    def send_pose(self, pose: Pose, t_s: float, attitude_std_rad: float, velocity_std_m_s: float) -> None:
        """Sends a valid pose of the time `t_s`."""

    def send_origin(self, origin_geo: tuple[float, float, float]) -> None:
        """Sends the origin of the poses' frame: degrees, degrees, metres above mean sea level."""

    def command_home(self, place_geo: tuple[float, float, float]) -> int:
        """Tells where home is, in the same numbers."""

    def command_source_set(self, number: int) -> int:
        """Has the estimator fly by the set of sources 1, 2 or 3 (ArduPilot)."""

    def answer(self, ticket: int) -> CommandAnswer | None:
        """The answer to a command; None while there is none."""


class VisionPoseSettings(Settings, frozen=True):
    """Settings of the vision pose driver."""

    rate_hz: Annotated[float, Bounds(4.0, 50.0)] = 30.0
    """Poses come no more often than that to the autopilot. PX4 wants 30 to 50, ArduPilot at least 4."""
    attitude_std_deg: Annotated[float, Bounds(0.01, 45.0)] = 1.0
    """Standard deviation of the attitude, which a pose does not include, in degrees."""
    velocity_std_m_s: Annotated[float, Bounds(0.001, 10.0)] = 0.05
    """Standard deviation of the velocity, which a pose does not include, in m/s."""
    least_quality: Annotated[float, Bounds(0.0, 1.0)] = 0.0
    """A pose of less quality is not sent."""
    source_set: Annotated[int, Bounds(0, 3)] = 0
    """ArduPilot: the set of sources (EK3_SRC…) that is chosen while our pose is sent; 0 leaves the choice alone."""
    other_source_set: Annotated[int, Bounds(0, 3)] = 0
    """… and the one that is chosen when it has been away for `lost_s`; 0 leaves that as it is."""
    lost_s: Annotated[float, Bounds(0.2, 60.0)] = 1.0
    """See `other_source_set`; as long a pose must have come before `source_set` is chosen."""
    in_place_of: str = ""
    """A pose source that the autopilot has as well, such as *satellites*. While the pose rests on it,
    `other_source_set` is selected; otherwise `source_set`, immediately. The change back waits for `lost_s`, in which
    the autopilot follows our pose to that source's position. If empty, only whether a pose is sent decides."""


class SendPose(NamedTuple):
    """Write: a pose."""

    pose: Pose
    t_s: float


class SendOrigin(NamedTuple):
    """Write: the frame's origin."""

    origin_geo: tuple[float, float, float]


class SendHome(NamedTuple):
    """Write: where home is."""

    place_geo: tuple[float, float, float]


class ChooseSources(NamedTuple):
    """Write: by which set of sources to fly."""

    number: int


class VisionPoseDriver(ActuatorDriver[VisionPoseSettings]):
    """Sends each valid pose once, and the origin until the autopilot reports it.

    An invalid pose is not sent: the autopilot notices within half a second, and acts as configured.
    """

    loggable = ("sent", "withheld", "reason", "chosen_set", "refusal")

    pose = Input(Pose)
    autopilot_pose = Input(AutopilotPose)
    autopilot = Input(AutopilotState)

    def __init__(self, device: PoseInput) -> None:
        self.sent = self.withheld = 0
        self.reason = ""
        """Why the last pose was not sent."""
        self.chosen_set = 0
        """Latest requested set of sources."""
        self.refusal = ""
        """Why the autopilot did not take it."""
        self._device = device
        self._reset()

    def _reset(self) -> None:
        self._sent_s = self._reported_s = float("-inf")
        self._homed_s: float | None = None
        """Since when the autopilot has been waited for to say where its home is."""
        self._since_s: float | None = None
        """Since when poses are sent without a gap."""
        self._begun_s: float | None = None
        self._is_needed = True
        """Whether the autopilot lacks the source that the pose rests on."""
        self._has_it_since_s: float | None = None
        self.chosen_set, self._ticket = 0, 0
        self._is_accepted = False
        """Whether the autopilot has accepted the latest requested set, and has not restarted since."""
        self._chosen_s = float("-inf")
        self._contacts = self._device.contacts

    def start(self) -> None:
        """Begins with the next pose."""
        self._reset()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Sends new poses."""
        results: list[Result] = []
        for envelope in inbox.new(self.pose):
            pose, t_s = envelope.payload, envelope.t_s
            self.reason = self._why_not(pose, t_s)
            self._is_needed = self._check_need(pose, t_s)
            pose = _from_their_origin(pose, inbox.latest(self.autopilot_pose))
            if self.reason:
                self.withheld += 1
            elif t_s - self._sent_s >= 1.0 / self.settings.rate_hz - 2e-3:
                self._sent_s = t_s
                self.sent += 1
                results.append(Actuation(SendPose(pose, t_s)))
            origin_geo = envelope.payload.origin_geo
            if origin_geo is not None and self._must_send(origin_geo, inbox, now_s):
                self._reported_s = now_s
                results.append(Actuation(SendOrigin(origin_geo)))
        latest = inbox.latest(self.pose)
        if latest is not None:
            results += self._home(latest.payload, inbox, now_s)
        state = inbox.latest(self.autopilot)
        is_under_way = state is not None and state.payload.is_armed
        return [*results, *(self._sources(now_s) if latest is not None or is_under_way else [])]

    def _check_need(self, pose: Pose, t_s: float) -> bool:
        """Whether the autopilot lacks the source that the pose rests on."""
        source = self.settings.in_place_of
        if not source or source not in pose.sources:
            self._has_it_since_s = None
        elif self._has_it_since_s is None:
            self._has_it_since_s = t_s
        return self._has_it_since_s is None or t_s - self._has_it_since_s < self.settings.lost_s

    def _home(self, pose: Pose, inbox: Inbox, now_s: float) -> list[Actuation]:
        """Sets home at the vehicle's position, for an autopilot with our origin but without a home."""
        state = inbox.latest(self.autopilot)
        reported = None if state is None else state.payload
        is_homeless = reported is not None and reported.is_connected and not reported.is_armed and not reported.has_home
        if not is_homeless or self._homed_s is None:
            self._homed_s = now_s
        if now_s - self._homed_s < HOME_S or pose.origin_geo is None or not pose.is_valid:
            return []
        self._homed_s = now_s
        place = TangentPlane(GeoPoint(*pose.origin_geo)).geo_from_ned(pose.position_ned_m)
        return [Actuation(SendHome((place[0], place[1], place[2])))]

    def _sources(self, now_s: float) -> list[Actuation]:
        """Selects the set of sources that fits the sent poses."""
        settings = self.settings
        if not settings.source_set:
            return []
        if self._begun_s is None:
            self._begun_s = now_s
        answer = self._device.answer(self._ticket) if self._ticket else None
        if answer is not None:
            self._ticket, self.refusal = 0, "" if answer.is_accepted else answer.reason
            self._is_accepted = answer.is_accepted
        if self._device.contacts != self._contacts:
            self._contacts, self._is_accepted = self._device.contacts, False
        quiet_s = now_s - max(self._sent_s, self._begun_s)
        if quiet_s > settings.lost_s:
            self._since_s = None
        elif self._since_s is None and self._sent_s > float("-inf"):
            self._since_s = now_s
        steady = self._since_s is not None and now_s - self._since_s >= settings.lost_s
        if steady:
            wanted = settings.source_set if self._is_needed else settings.other_source_set
        else:
            wanted = settings.other_source_set if quiet_s > settings.lost_s else 0
        is_settled = self._is_accepted or now_s - self._chosen_s < REPEAT_S
        if not wanted or (wanted == self.chosen_set and is_settled):
            return []
        self.chosen_set, self._chosen_s = wanted, now_s
        self._ticket, self._is_accepted = 0, False
        return [Actuation(ChooseSources(wanted))]

    def _why_not(self, pose: Pose, t_s: float) -> str:
        if not pose.is_valid:
            return pose.reason or "the pose is not valid"
        if pose.quality < self.settings.least_quality:
            return f"its quality is only {pose.quality:.2f}"
        return "" if t_s > self._sent_s else "its time does not advance"

    def _must_send(self, origin_geo: tuple[float, float, float], inbox: Inbox, now_s: float) -> bool:
        """Whether the autopilot is connected and has no origin or another one."""
        reported = inbox.latest(self.autopilot_pose)
        if reported is None or now_s - self._reported_s < ORIGIN_PERIOD_S:
            return False
        has = reported.payload.origin_geo
        return has is None or not (_is_same_place(has, origin_geo) and abs(has[2] - origin_geo[2]) < _SAME_M)

    def actuate(self, write: Any) -> None:
        """Sends to the autopilot."""
        if isinstance(write, SendOrigin):
            self._device.send_origin(write.origin_geo)
        elif isinstance(write, SendHome):
            self._device.command_home(write.place_geo)
        elif isinstance(write, ChooseSources):
            self._ticket = self._device.command_source_set(write.number)
        else:
            settings = self.settings
            deviation_rad = radians(settings.attitude_std_deg)
            self._device.send_pose(write.pose, write.t_s, deviation_rad, settings.velocity_std_m_s)

    def make_safe(self) -> None:
        """Does nothing: without poses the autopilot acts as configured."""


def _is_same_place(one: tuple[float, float, float], other: tuple[float, float, float]) -> bool:
    return abs(one[0] - other[0]) < _SAME_DEG and abs(one[1] - other[1]) < _SAME_DEG


def _from_their_origin(pose: Pose, reported: Envelope[AutopilotPose] | None) -> Pose:
    """The pose relative to the autopilot's own origin, which one with satellites keeps."""
    theirs = None if reported is None else reported.payload.origin_geo
    if theirs is None or pose.origin_geo is None or _is_same_place(theirs, pose.origin_geo):
        return pose
    north, east, _ = TangentPlane(GeoPoint(*pose.origin_geo)).ned_from_geo(*theirs)
    n, e, d = pose.position_ned_m
    return msgspec.structs.replace(pose, position_ned_m=(n - north, e - east, d))
