"""Stream of the owner's setpoints to the autopilot: what may be sent, in which frame, and when it expires."""

import math
from collections.abc import Sequence
from typing import Final

from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3
from gloc3.messages.standard_topics import POSE_LATE_S, POSE_LOST_S
from gloc3.messages.vehicle import AutopilotPose, MotionLimits, Pose, Setpoint
from gloc3_onboard.algorithms.paths.motion_limits import SetpointLimiter
from gloc3_onboard.algorithms.paths.setpoint_gate import SETPOINT_AGE_S, SetpointGate
from gloc3_onboard.sensors.devices import AutopilotSetpoint

EXPIRY_S: Final = 0.5
"""Time without a valid setpoint after which the stream stops and the autopilot's hold is commanded, s (DESIGN §7)."""
MISSED_S: Final = 0.15
"""Age of the newest setpoint from which the vehicle is braked until the next one comes, s."""
STEADY_S: Final = 1.0
"""Time of steady setpoints required after an expiry, and shortest hold, s; the hold is doubled with each further expiry."""
STEADY_MOST_S: Final = 8.0
RECOVERED_S: Final = 30.0
"""Time of following after which earlier expiries no longer count, s."""
_AT_REST: Final = (0.0, 0.0, 0.0)
SHORTEST_S: Final = 0.01
LONGEST_S: Final = 0.2
"""Setpoints that follow each other within these times tell an acceleration."""
FASTER_SHARE: Final = 0.5
"""Part of the acceleration along the path that is told while the setpoint speeds up."""
PAIRED_S: Final = 0.1
"""Largest time difference of two estimates that relate their frames, s."""


class SetpointStream:
    """Begins with the first valid setpoint, and is over when none came for `EXPIRY_S`."""

    def __init__(self) -> None:
        self.gate = SetpointGate()
        self.clamped = self.expired = 0
        self.since_s: float | None = None
        """When it began; None while there is none."""
        self.steady_s = 0.0
        """Time from the last expiry until the autopilot is asked to follow again, s; 0 without one."""
        self._valid_s = self._expired_s = -math.inf
        self._limiter: SetpointLimiter | None = None
        self._pose: Pose | None = None
        self._pose_s = -math.inf
        self._offset_ned_m: Vector3 | None = None
        """From the autopilot's frame to ours."""
        self._led: tuple[Vector3, float] | None = None
        """The last velocity that went with a position, and when it was."""

    @property
    def is_steady(self) -> bool:
        """Whether it has held for the required time after a gap, and setpoints are steady since a second.

        Gaps meanwhile do not prolong the hold: on a computer that is always late it would not end.
        """
        since_s = math.inf if self.since_s is None else max(self.since_s, self._expired_s + self.steady_s - STEADY_S)
        return self._valid_s - since_s >= min(self.steady_s, STEADY_S) - 1e-9

    @property
    def pose(self) -> Pose | None:
        """The last valid one."""
        return self._pose

    def young_pose(self, now_s: float) -> Pose | None:
        """The last valid pose, unless stale."""
        return self._pose if now_s - self._pose_s <= SETPOINT_AGE_S else None

    def is_interrupted(self, now_s: float) -> bool:
        """Whether the autopilot may have changed to its hold: setpoints were missed, or the pose is late.

        A late pose may mean a lost cable, in which case the autopilot misses our setpoints as well.
        """
        is_missed = now_s - min(self._valid_s, self._pose_s) > EXPIRY_S
        return self.since_s is not None and is_missed

    def adopt(self, limits: MotionLimits) -> None:
        """Applies these limits from now on."""
        if self._limiter is None:
            self._limiter = SetpointLimiter(limits)
        self._limiter.limits = limits

    @property
    def home_ned_m(self) -> Vector3 | None:
        """Where the vehicle was armed; None where that is not known."""
        return self._limiter.limits.home_ned_m if self._limiter is not None else None

    def set_vehicle(self, pose: Envelope[Pose] | None, own: Envelope[AutopilotPose] | None, *, is_guided: bool) -> None:
        """Sets the vehicle's pose, in our frame and in the autopilot's.

        Until the autopilot follows, the stream stays at the vehicle's position, so that there is no step. After a late
        pose it restarts there.
        """
        if pose is None or not pose.payload.is_valid:
            return
        was_late = pose.t_s - self._pose_s > POSE_LATE_S
        self._pose, self._pose_s = pose.payload, pose.t_s
        place, velocity = pose.payload.position_ned_m, pose.payload.velocity_ned_m_s
        if self._limiter is not None:
            if was_late or not is_guided:
                self._limiter.restart(place, velocity, pose.t_s)
                self._led = None
            self._limiter.set_vehicle(place, velocity, pose.t_s, pose.payload.reset_counter)
        if own is not None and abs(gap_s := own.t_s - pose.t_s) <= PAIRED_S:
            theirs = own.payload.position_ned_m
            self._offset_ned_m = (
                place[0] + velocity[0] * gap_s - theirs[0],
                place[1] + velocity[1] * gap_s - theirs[1],
                place[2] + velocity[2] * gap_s - theirs[2],
            )

    def next_setpoint(
        self, envelopes: Sequence[Envelope[Setpoint]], owner: str, now_s: float, *, may_fly: bool, is_guided: bool
    ) -> AutopilotSetpoint | None:
        """Handles received setpoints; returns the setpoint to send."""
        found = self.gate.newest(envelopes, owner, now_s)
        send = None
        if found is not None and self._is_ready(now_s):
            send = self._convert(found, is_guided=is_guided)
        elif found is not None and self._may_stand(found.payload, now_s):
            send = self._standing(now_s)
        if send is not None and may_fly:
            is_steady = is_guided or now_s - self._valid_s <= SETPOINT_AGE_S
            self._valid_s = now_s
            self.since_s = now_s if self.since_s is None or not is_steady else self.since_s
            if is_guided and now_s - self.since_s > RECOVERED_S:
                self.steady_s = 0.0
            return send
        if self.since_s is not None and now_s - self._valid_s > EXPIRY_S:
            self.since_s = None
            self.expired += 1
            if is_guided:
                self._expired_s = now_s
                self.steady_s = min(max(2.0 * self.steady_s, STEADY_S), STEADY_MOST_S)
        if (
            may_fly
            and is_guided
            and self.since_s is not None
            and now_s - self._valid_s > MISSED_S
            and self._is_ready(now_s)
        ):
            return self._standing(now_s)  # else the autopilot goes on by the last velocity and acceleration
        return None

    def brake(self, now_s: float) -> AutopilotSetpoint | None:
        """Setpoint during a hand-over to the autopilot; prevents its failsafe after a lost frame."""
        self.since_s = None
        if self._limiter is None or not self._is_ready(now_s):
            return None
        return self._standing(now_s)

    def stop(self) -> None:
        """Ends the stream on purpose."""
        self.since_s = None

    def _is_ready(self, now_s: float) -> bool:
        """Whether the limits, and where the vehicle is, are known."""
        return self._limiter is not None and now_s - self._pose_s <= SETPOINT_AGE_S

    def _may_stand(self, wanted: Setpoint, now_s: float) -> bool:
        """Whether a stream under way continues despite a late pose: to brake, but not towards a position."""
        is_waited_for = self._limiter is not None and now_s - self._pose_s <= POSE_LOST_S
        return is_waited_for and self.since_s is not None and wanted.position_ned_m is None

    def _standing(self, now_s: float) -> AutopilotSetpoint:
        """The next velocity setpoint while braking to rest."""
        assert self._limiter is not None
        self._led = None
        standing = self._limiter.limit(Setpoint(action_id="", velocity_ned_m_s=_AT_REST), now_s).setpoint
        return AutopilotSetpoint(None, standing.velocity_ned_m_s, None)

    def _convert(self, wanted: Envelope[Setpoint], *, is_guided: bool) -> AutopilotSetpoint | None:
        assert self._limiter is not None
        limited = self._limiter.limit(wanted.payload, wanted.t_s)
        self.clamped += limited.is_clamped and is_guided
        setpoint = limited.setpoint
        position, offset = setpoint.position_ned_m, self._offset_ned_m
        if position is not None:
            if offset is None:
                return None
            position = (position[0] - offset[0], position[1] - offset[1], position[2] - offset[2])
        acceleration = self._acceleration(setpoint, wanted.t_s)
        return AutopilotSetpoint(position, setpoint.velocity_ned_m_s, setpoint.yaw_rad, acceleration)

    def _acceleration(self, setpoint: Setpoint, t_s: float) -> Vector3 | None:
        """How a moving place slows down and turns: without it a vehicle lags, and flies past corners.

        How it speeds up, in part: if the whole process stalls just then, the autopilot speeds up until its own time-out.
        """
        before, velocity = self._led, setpoint.velocity_ned_m_s
        if setpoint.position_ned_m is None or velocity is None:
            self._led = None
            return None
        self._led = velocity, t_s
        if before is None or not SHORTEST_S <= (duration_s := t_s - before[1]) <= LONGEST_S:
            return None
        assert self._limiter is not None
        change = math.dist(velocity, before[0])
        most = self._limiter.limits.acceleration_m_s2 * duration_s
        share = (min(1.0, most / change) if change > 0.0 else 1.0) / duration_s
        (vn, ve, vd), (n, e, d) = velocity, before[0]
        change_m_s2 = ((vn - n) * share, (ve - e) * share, (vd - d) * share)
        square = vn * vn + ve * ve + vd * vd
        along = sum(one * other for one, other in zip(change_m_s2, velocity, strict=True)) / square if square else 0.0
        faster = max(0.0, (1.0 - FASTER_SHARE) * along)
        north, east, down = change_m_s2
        return (north - faster * vn, east - faster * ve, down - faster * vd)
