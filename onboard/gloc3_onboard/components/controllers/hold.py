"""CC: keeps the vehicle's position while no other controller owns motion."""

import math
from collections.abc import Sequence
from typing import Annotated

from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3, yaw_of
from gloc3.messages.standard_topics import POSE_LATE_S
from gloc3.messages.vehicle import MotionGrant, Pose, Setpoint
from gloc3_onboard.components.controllers.holding import Holding

STEP_S = 0.1
"""Longest time by which the target advances in one cycle, s."""
GAP_S = 0.5
"""Time without a pose after which the autopilot has held by itself, s; the position to keep is then its own."""


class HoldSettings(Settings, frozen=True):
    """Settings of the hold controller."""

    braking_m_s2: Annotated[float, Bounds(0.1, 20.0)] = 1.75
    """How hard a moving vehicle is braked. The place to keep is where it comes to rest, so that it need not come back."""
    pose_limit_s: Annotated[float, Bounds(0.05, 5.0)] = POSE_LATE_S
    """Age above which a pose is late, in seconds; setpoints stop until a newer one arrives."""


class HoldController(Holding, Controller[HoldSettings]):
    """Keeps the position at which it is granted motion, and streams it; performs the action `hold` too."""

    pose = Input(Pose)
    grant = Input(MotionGrant)
    setpoint_wanted = Output(Setpoint, frame="ned")

    def __init__(self) -> None:
        self._place_ned_m: Vector3 | None = None
        self._velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
        self._moved_s = 0.0
        self._yaw_rad = 0.0
        self._seen: Envelope[Pose] | None = None

    def stop(self) -> None:
        """Forgets the place and the action."""
        self.drop_action()
        self._place_ned_m = None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Streams the place to keep while motion is this controller's."""
        held = self._keep(now_s, inbox)
        self.report_progress(now_s)
        return [*held, *self.action_reports(now_s)]

    def _keep(self, now_s: float, inbox: Inbox) -> list[Setpoint]:
        owner, latest = self.owner(inbox.latest(self.grant)), inbox.latest(self.pose)
        if not owner:
            self._place_ned_m = None
            return []
        if latest is None or not latest.payload.is_valid or now_s - latest.t_s > self.settings.pose_limit_s:
            return []
        before, self._seen = self._seen, latest
        if self._place_ned_m is None or before is None or latest.t_s - before.t_s > GAP_S:
            self._choose_position(latest.payload)
        elif latest.payload.reset_counter != before.payload.reset_counter:
            self._move_place(before, latest)
        self._brake(min(now_s - self._moved_s, STEP_S))
        self._moved_s = now_s
        setpoint = Setpoint(
            action_id=owner,
            position_ned_m=self._place_ned_m,
            velocity_ned_m_s=self._velocity_ned_m_s,
            yaw_rad=self._yaw_rad,
        )
        return [setpoint]

    def _choose_position(self, pose: Pose) -> None:
        """Begins where the vehicle is, as fast as it is."""
        self._place_ned_m, self._velocity_ned_m_s = pose.position_ned_m, pose.velocity_ned_m_s
        self._yaw_rad = yaw_of(pose.ned_from_frd)

    def _brake(self, duration_s: float) -> None:
        """Moves the target on until it rests."""
        assert self._place_ned_m is not None
        speed = math.hypot(*self._velocity_ned_m_s)
        share = max(0.0, 1.0 - self.settings.braking_m_s2 * duration_s / speed) if speed > 0.0 else 0.0
        (n, e, d), (vn, ve, vd) = self._place_ned_m, self._velocity_ned_m_s
        self._velocity_ned_m_s = (vn * share, ve * share, vd * share)
        elapsed_s = 0.5 * (1.0 + share) * duration_s
        self._place_ned_m = (n + vn * elapsed_s, e + ve * elapsed_s, d + vd * elapsed_s)

    def _move_place(self, before: Envelope[Pose], after: Envelope[Pose]) -> None:
        """The estimate has jumped, the vehicle has not: the place to keep jumps with it."""
        assert self._place_ned_m is not None
        duration_s = after.t_s - before.t_s
        n, e, d = (
            kept + new - previous - speed * duration_s
            for kept, new, previous, speed in zip(
                self._place_ned_m,
                after.payload.position_ned_m,
                before.payload.position_ned_m,
                before.payload.velocity_ned_m_s,
                strict=True,
            )
        )
        self._place_ned_m = (n, e, d)
