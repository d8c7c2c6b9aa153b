"""DP: odometry by wheels: body motion from their rotation, with the slip in its covariance."""

from collections import deque
from collections.abc import Sequence
from math import isfinite
from typing import Annotated, Final

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import from_yaw, wrap_pi, yaw_of
from gloc3.messages.perception import UNKNOWN_VARIANCE, Odometry, WheelDistances, no_motion
from gloc3.messages.vehicle import AutopilotPose
from gloc3_onboard.algorithms.odometry.wheel_odometer import Wheelbase, WheelOdometer, WheelStep
from gloc3_onboard.sensors.checks.recent import in_time_order

SOURCE: Final = "wheels"
_MEASURED_S: Final = 0.2
"""Longest extrapolation of the autopilot's heading to a reading, s."""
_GAP_S: Final = 1.0
"""Readings that are farther apart are no step: what happened between them is not known."""
_UP_SHARE: Final = 0.05
"""Standard deviation along the body's down axis, as a share of the distance ahead."""


class WheelOdometrySettings(Settings, frozen=True):
    """Settings of the odometry; the defaults are those of a Clearpath Jackal."""

    track_m: Annotated[float, Bounds(0.05, 10.0)] = 0.37559
    """Between the middles of left and right wheels."""
    turn_factor: Annotated[float, Bounds(0.5, 4.0)] = 1.5
    """Ratio of the wheels' difference in distance to that of pure rolling; 1 for wheels without slip."""
    left: Annotated[int, Bounds(0, 15)] = 0
    """Number of the left encoder, from 0."""
    right: Annotated[int, Bounds(0, 15)] = 1
    """Number of the right encoder."""
    slip_share: Annotated[float, Bounds(0.001, 0.5)] = 0.02
    """Standard deviation of the distance, as a share of it."""
    slip_max_m_s: Annotated[float, Bounds(0.01, 5.0)] = 0.25
    """Slip above which the wheels give no information, in m/s."""
    speed_max_m_s: Annotated[float, Bounds(0.1, 50.0)] = 5.0
    """Speed above which the encoders must have restarted, in m/s."""


class WheelOdometryProcessor(DataProcessor[WheelOdometrySettings]):
    """One report for each encoder reading, relative to the previous one.

    Slip is the difference between the turn by wheels and by the autopilot's gyroscopes; it enters the covariance, and
    too much of it invalidates the report.
    """

    loggable = ("slip_m_s", "travelled_m", "reason")

    wheels = Input(WheelDistances, Keep.ALL)
    autopilot_pose = Input(AutopilotPose, Keep.ALL)
    autopilot_attitude = Input(AutopilotPose, Keep.ALL)
    odometry = Output(Odometry)

    def __init__(self) -> None:
        self.slip_m_s = self.travelled_m = 0.0
        self.reason = ""
        self._reset()

    def _reset(self) -> None:
        settings = self.settings
        base = Wheelbase(
            track_m=settings.track_m,
            turn_factor=settings.turn_factor,
            slip_share=settings.slip_share,
            slip_max_m_s=settings.slip_max_m_s,
        )
        self._odometer = WheelOdometer(base, settings.speed_max_m_s)
        self._last_s: float | None = None
        self._last_yaw_rad: float | None = None
        self._attitude: Envelope[AutopilotPose] | None = None

    def initialize(self, settings: WheelOdometrySettings) -> None:
        """Adopts the settings."""
        self.settings = settings
        self._reset()

    def start(self) -> None:
        """Begins with the next reading."""
        self._reset()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes readings and attitudes in the order of time."""
        results: list[Result] = []
        attitudes = deque(in_time_order(inbox.new(self.autopilot_pose), inbox.new(self.autopilot_attitude)))
        for wheels in inbox.new(self.wheels):
            while attitudes and attitudes[0].t_s <= wheels.t_s:
                self._attitude = attitudes.popleft()
            results += self._step(wheels.payload, wheels.t_s)
        self._attitude = attitudes[-1] if attitudes else self._attitude
        return results

    def _step(self, wheels: WheelDistances, t_s: float) -> list[Result]:
        settings, routes = self.settings, wheels.distances_m
        before_s, before_rad = self._last_s, self._last_yaw_rad
        if not wheels.is_valid or max(settings.left, settings.right) >= len(routes):
            self.reason = wheels.reason or f"{len(routes)} wheels are reported"
            self._last_s = None
            self._odometer.begin()
            return [self.odometry.report(no_motion(SOURCE, t_s, self.reason), t_s=t_s)]
        self._last_s, self._last_yaw_rad = t_s, self._yaw_rad(t_s)
        measured = self._last_yaw_rad
        turned = None if measured is None or before_rad is None else wrap_pi(measured - before_rad)
        if before_s is None or not 0.0 < t_s - before_s <= _GAP_S:
            self._odometer.begin()
        seconds = 0.0 if before_s is None else t_s - before_s
        moved = self._odometer.update(routes[settings.left], routes[settings.right], seconds, turned)
        if moved is None or before_s is None:
            return []
        self.slip_m_s, self.reason = moved.slip_m_s, moved.reason
        self.travelled_m += abs(moved.ahead_m)
        return [self.odometry.report(_report(moved, before_s, settings.slip_max_m_s), t_s=t_s)]

    def _yaw_rad(self, t_s: float) -> float | None:
        """Heading at a time, by the last attitude and turn rate; None if stale."""
        reported = self._attitude
        if reported is None or not abs(t_s - reported.t_s) <= _MEASURED_S:
            return None
        yaw = yaw_of(reported.payload.ned_from_frd) + reported.payload.rate_frd_rad_s[2] * (t_s - reported.t_s)
        return yaw if isfinite(yaw) else None


def _report(moved: WheelStep, reference_t_s: float, slip_max_m_s: float) -> Odometry:
    ahead_m, right_m = moved.place_m
    up_std_m = 0.002 + _UP_SHARE * abs(moved.ahead_m)
    variances = (
        moved.ahead_std_m**2,
        moved.side_std_m**2,
        up_std_m**2,
        *(UNKNOWN_VARIANCE,) * 2,
        moved.turn_std_rad**2,
    )
    return Odometry(
        source=SOURCE,
        reference_t_s=reference_t_s,
        position_m=(ahead_m, right_m, 0.0),
        reference_from_frd=from_yaw(moved.turn_rad),
        covariance=[variances[index // 7] if index % 7 == 0 else 0.0 for index in range(36)],
        is_valid=not moved.reason,
        reason=moved.reason,
        quality=0.0 if moved.reason else 1.0 - moved.slip_m_s / slip_max_m_s,
        shared=0.5,
    )
