"""CC: keeps the vehicle where it is, while it owns motion and nobody else does."""

from collections.abc import Sequence
from typing import Annotated, ClassVar

from gloc3.action import ActionPerformer
from gloc3.component import Controller
from gloc3.frames import Vector3, yaw_of
from gloc3.mission.arguments import Hold
from gloc3.mission.states import ActionState
from gloc3.ports import Inbox, Input, Output, Result
from gloc3.settings import Bounds, Settings
from gloc3.vehicle import MotionGrant, Pose, Setpoint

HOLD_ACTION = "hold"
"""The id under which this controller owns motion when no action does."""


class HoldSettings(Settings, frozen=True):
    """Settings of the hold controller."""

    stopping_s: Annotated[float, Bounds(0.0, 5.0)] = 0.4
    """The place to keep is where the vehicle would be after so many seconds of its velocity, so that it does not
    come back after it has stopped."""
    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = 0.15
    """A pose older than this is lost."""


class HoldController(ActionPerformer, Controller[HoldSettings]):
    """Takes the place to keep when it is granted motion, and streams it; performs the action `hold` too."""

    settings_type = HoldSettings
    performs: ClassVar = {"hold": Hold}

    pose = Input(Pose)
    grant = Input(MotionGrant)
    setpoint_wanted = Output(Setpoint, frame="ned")

    def __init__(self) -> None:
        self._settings = HoldSettings()
        self._owner = ""
        self._place_ned_m: Vector3 | None = None
        self._yaw_rad = 0.0
        self._duration_s: float | None = None
        self._until_s = 0.0

    def initialize(self, settings: HoldSettings) -> None:
        """Adopts the settings."""
        self._settings = settings

    def stop(self) -> None:
        """Forgets the place and the action."""
        self.drop_action()
        self._owner, self._place_ned_m = "", None

    def begin_action(self, capability: str, arguments: Hold, now_s: float) -> None:
        """Keeps the present place for a time, or until it is told to end."""
        self._duration_s = arguments.duration_s
        self._until_s = now_s + (arguments.duration_s or 0.0)

    def pause_action(self, now_s: float) -> None:
        """The time that is left stands still."""
        self._until_s -= now_s

    def resume_action(self, now_s: float) -> None:
        """The time that is left runs again."""
        self._until_s += now_s

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Streams the place to keep while motion is this controller's."""
        if self.is_running and self._duration_s is not None:
            left_s = self._until_s - now_s
            is_done = left_s <= 0.0
            progress = 1.0 - left_s / self._duration_s if self._duration_s > 0.0 else 1.0
            self.advance(now_s, progress, ActionState.DONE if is_done else ActionState.RUNNING)
        return [*self._keep(now_s, inbox), *self.action_reports(now_s)]

    def _keep(self, now_s: float, inbox: Inbox) -> list[Setpoint]:
        grant = inbox.latest(self.grant)
        owner = grant.payload.action_id if grant is not None and self._is_ours(grant.payload) else ""
        if not owner:
            self._owner, self._place_ned_m = "", None
            return []
        latest = inbox.latest(self.pose)
        if latest is None or not latest.payload.is_valid or now_s - latest.t_s > self._settings.pose_limit_s:
            return []
        if owner != self._owner or self._place_ned_m is None:
            self._take_place(latest.payload)
            self._owner = owner
        return [Setpoint(action_id=owner, position_ned_m=self._place_ned_m, yaw_rad=self._yaw_rad)]

    def _is_ours(self, grant: MotionGrant) -> bool:
        return grant.action_id == HOLD_ACTION or (bool(self.action_id) and grant.action_id == self.action_id)

    def _take_place(self, pose: Pose) -> None:
        seconds = self._settings.stopping_s
        self._place_ned_m = (
            pose.position_ned_m[0] + pose.velocity_ned_m_s[0] * seconds,
            pose.position_ned_m[1] + pose.velocity_ned_m_s[1] * seconds,
            pose.position_ned_m[2] + pose.velocity_ned_m_s[2] * seconds,
        )
        self._yaw_rad = yaw_of(pose.ned_from_frd)
