"""Pose of the platform, fused from an IMU and any odometers, position fixes and heights."""

from collections.abc import Callable
from math import hypot, isfinite, nan, tanh
from typing import Final

import numpy as np

from gloc3.messages.frames import Vector3, from_yaw
from gloc3.messages.perception import FusionState, Odometry, PositionFix, SourceState
from gloc3.messages.vehicle import AutopilotPose, HeightAboveGround, Pose
from gloc3_onboard.algorithms.fusion.alignment import RestAlignment, RestMonitor, StartPose
from gloc3_onboard.algorithms.fusion.error_state import FLOOR, SIZE, VELOCITY, Matrix
from gloc3_onboard.algorithms.fusion.estimate import Past, PoseEstimate
from gloc3_onboard.algorithms.fusion.imu_watch import ImuWatch
from gloc3_onboard.algorithms.fusion.inertial import InertialState
from gloc3_onboard.algorithms.fusion.measurements import CHI2_999, Measured, covariance_of, height_over, level_of, place
from gloc3_onboard.algorithms.fusion.odometers import Odometers, read
from gloc3_onboard.algorithms.fusion.settings import FusionSettings
from gloc3_onboard.algorithms.fusion.source_reports import PlaceReport, Report, SourceReports
from gloc3_onboard.algorithms.fusion.source_voting import HEIGHT, LEADING_M, SourceVoting
from gloc3_onboard.algorithms.fusion.trust import Trust
from gloc3_onboard.algorithms.fusion.turn_witness import TurnWitness

IMU, AUTOPILOT = "imu", "autopilot"
_IMU_LOST_S: Final = 0.1
_COAST_STEP_S: Final = 0.02
_HEIGHT_PERIOD_S: Final = 0.09
"""More often a height is not worth its cost."""
_LEAP_M: Final = 0.1
"""Heights that differ by more from one to the next do not lead anywhere."""
_LEVEL_M: Final = 2.0
"""Over so long a way no range to the floor stays the same to the last digit."""
_UNSURE_M2: Final = 0.1**2
"""With a larger variance of the height, one that is repeated to the last digit does not hold it: it may be frozen."""
_NEW_FLOOR, _LEVEL_M_S = 15, 0.2
"""So many heights in a row that do not fit the floor are another floor, a box, a step, where the vehicle does not climb or
sink faster than the second: heights that are late fit none meanwhile."""
_STAND_S: Final = 0.1
"""Interval of zero-motion updates for a body that has not moved yet, s."""
_RATE_YOUNG_S: Final = 0.15
"""Age up to which the autopilot's rate is used, s."""
_TILT_STD_RAD: Final = 0.02
"""Standard deviation of the autopilot's roll and pitch, including errors that last for a second."""
_ASKEW: Final = (0.09, 3)
"""Difference from the autopilot's vertical, rad, and number of occurrences in a row, that show that the inertial unit
is wrong: with a wrong autopilot the vehicle would have fallen."""
_WAITING: Final = 64
_LEAST_FIX: Final = np.array((1e-6, 1e-6, 1e-6))

Measurement = Odometry | PositionFix | HeightAboveGround | AutopilotPose
"""What may have to wait for the inertial unit."""


class PoseFusion:
    """An error-state Kalman filter with stochastic clones; see docs/pose.md for how sources are judged.

    Feed it with `imu`, `odometry`, `fix` and `height` in the order of arrival, call `tick` some times a second, and ask
    for `pose` whenever it is needed. It has no clock: a measurement arrives at the time of the last sample or tick.
    """

    def __init__(self, settings: FusionSettings | None = None) -> None:
        self.settings: Final = settings or FusionSettings()
        self.estimate: Final = PoseEstimate(self.settings)
        self.is_aligned = False
        self.on_innovation: Callable[[str, float, int], None] | None = None
        """Called with each innovation: source, normalised square, degrees of freedom; for measuring consistency."""
        self._odometers: Final = Odometers(self.estimate)
        self._voting: Final = SourceVoting(self.estimate, self._odometers, self.settings, self._distrust_imu)
        self._standing: Final = RestAlignment()
        self._remainder: Final = RestMonitor()
        self._stood_s = float("-inf")
        self._start: StartPose | None = None
        self._now_s = float("-inf")
        self._imu: Final = ImuWatch()
        self._restlessness = 0.0
        """Smoothed turn rate, rad/s: more than noise where the body moves."""
        self._rate: tuple[float, Vector3] = (float("-inf"), (0.0, 0.0, 0.0))
        """The autopilot's last rate, and its time."""
        self._askew = 0
        self._turns: Final = TurnWitness()
        self._waiting: list[tuple[float, Measurement]] = []
        self._source_reports: Final = SourceReports(self.estimate.inertial, self._voting.isolation)
        self._height_misses = 0
        self._heights_off_m = (0.0, 0.0)
        """By how much the first of the heights that lead away from the floor was off, and the last one."""
        self._height_m = nan
        """The last height."""
        settings = self.settings
        if settings.start_ned_m is not None and settings.start_heading_deg is not None:
            heading = from_yaw(np.radians(settings.start_heading_deg))
            self.align_by(InertialState(0.0, settings.start_ned_m, (0.0, 0.0, 0.0), heading))

    # --- the start ---

    def align_by(
        self,
        state: InertialState,
        *,
        position_std_m: float | None = None,
        heading_std_rad: float | None = None,
        is_moving: bool = False,
    ) -> None:
        """Sets the initial pose; has no effect once aligned."""
        if not self.is_aligned:
            heading_std = float(np.radians(self.settings.start_heading_std_deg))
            self._start = StartPose(
                state,
                self.settings.start_std_m if position_std_m is None else position_std_m,
                heading_std if heading_std_rad is None else heading_std_rad,
                is_moving,
            )

    @property
    def is_prepared_in_flight(self) -> bool:
        """Whether the initial pose is one in flight."""
        return self._start is not None and self._start.is_moving

    def _align(self, rate: Vector3, force: Vector3, t_s: float) -> None:
        start = self._start
        is_still = self._standing.add(rate, force, t_s)
        if start is None or not (is_still or start.is_moving):
            return
        state, bias = start.state._replace(t_s=t_s), (0.0, 0.0, 0.0)
        if not start.is_moving:
            state, bias = self._standing.state(start.state, t_s)
            self._remainder.begin(self._standing.force)
        self.estimate.begin(start, state, bias)
        self._odometers.clear()
        self._source_reports.clear()
        self._voting.hold(t_s)
        self.is_aligned = True

    # --- what comes in ---

    def imu(self, rate_frd_rad_s: Vector3, force_frd_m_s2: Vector3, t_s: float) -> None:
        """Handles an IMU sample taken at `t_s`."""
        trust = self._voting.received(IMU, self._now_s)
        estimated_s = self.estimate.t_s if self.is_aligned else float("-inf")
        mean = self._imu.add_sample(rate_frd_rad_s, force_frd_m_s2, t_s, self._now_s, estimated_s, trust)
        if mean is None:
            return
        self._now_s = trust.received_s = max(self._now_s, t_s)
        if not self.is_aligned:
            self._align(rate_frd_rad_s, force_frd_m_s2, t_s)
            return
        # Predict with the IMU where it is trusted; else coast at constant velocity.
        if mean.is_believed:
            self.estimate.move(mean.rate_frd_rad_s, mean.force_frd_m_s2, t_s)
            self._turns.feel(self.estimate.inertial.rate_frd_rad_s, t_s)
            if mean.jolt_m_s > 0.0:
                self.estimate.jolt(mean.jolt_m_s)
        else:
            self._coast(t_s)
        self._remainder.add(self.estimate.inertial.rate_frd_rad_s, force_frd_m_s2)
        if self._remainder.is_standing and t_s - self._stood_s >= _STAND_S:
            self._stood_s = t_s
            self.estimate.stand()
            self._voting.hold(t_s)
        self._voting.is_standing = self._remainder.is_standing
        self._restlessness += 0.02 * (hypot(*self.estimate.inertial.rate_frd_rad_s) - self._restlessness)
        self._use_waiting()

    def odometry(self, message: Odometry, t_s: float) -> None:
        """Handles an odometer report valid at `t_s`."""
        self._arrive(message.source, message, t_s)

    def fix(self, message: PositionFix, t_s: float) -> None:
        """Handles an absolute position valid at `t_s`."""
        self._arrive(message.source, message, t_s)

    def height(self, message: HeightAboveGround, t_s: float) -> None:
        """Handles a height above ground valid at `t_s`."""
        self._arrive(HEIGHT, message, t_s)

    def attitude(self, message: AutopilotPose, t_s: float) -> None:
        """Handles the autopilot's attitude at `t_s`: checks the IMU with it, and uses it while the IMU is distrusted.

        The rates are taken, and where down is. Not the heading, nor position and velocity: an autopilot that flies by
        our pose has them from here.
        """
        imu = self._voting.trust.get(IMU)
        if (
            not self.is_aligned
            or imu is None
            or not all(map(isfinite, (*message.ned_from_frd, *message.rate_frd_rad_s)))
        ):
            return
        self._rate = (t_s, message.rate_frd_rad_s)
        if imu.is_used:
            if AUTOPILOT in self._voting.trust:
                self._voting.received(AUTOPILOT, self._now_s).step_back("the inertial unit is believed")
            if self.estimate.inertial.covers(t_s):
                level = level_of(self.estimate.inertial.at(t_s).ned_from_frd, message.ned_from_frd, _TILT_STD_RAD)
                self._askew = self._askew + 1 if hypot(*level.residual) > _ASKEW[0] else 0
            if self._turns.contradicts(message.rate_frd_rad_s, t_s):
                reason = "the autopilot feels other turns"
            elif self._askew >= _ASKEW[1]:
                reason = "the autopilot says that down is elsewhere"
            else:
                return
            self._distrust_imu(self._now_s, reason)
            self._voting.distrust((), self.estimate.t_s)
        self._arrive(AUTOPILOT, message, t_s)

    def _coast(self, t_s: float) -> None:
        """Propagates without the inertial unit, with the autopilot's rate where it is available."""
        reported_s, rate = self._rate
        trust = self._voting.trust.get(AUTOPILOT)
        is_reported = t_s - reported_s < _RATE_YOUNG_S and trust is not None and trust.is_used
        self.estimate.coast(t_s, rate if is_reported else None)

    def _arrive(self, source: str, message: Measurement, t_s: float) -> None:
        trust = self._voting.received(source, self._now_s)
        if not isfinite(t_s):
            trust.refuse("its time is not finite")
        elif not isinstance(message, AutopilotPose) and not message.is_valid:
            trust.step_back(message.reason or "it says that it is not valid")
        elif self.is_aligned:
            if t_s > self.estimate.t_s + 1e-6:
                self._wait(source, message, t_s)
            else:
                self._apply(message, t_s)
        elif isinstance(message, PositionFix):
            self._start_at(message)

    def _wait(self, source: str, message: Measurement, t_s: float) -> None:
        """The inertial unit has not come so far yet."""
        if t_s > self.estimate.t_s + 0.2 or len(self._waiting) >= _WAITING:
            self._voting.received(source, self._now_s).refuse("it is of the future")
            return
        self._waiting.append((t_s, message))

    def _use_waiting(self) -> None:
        if self._waiting:
            now_s = self.estimate.t_s + 1e-6
            due = [entry for entry in self._waiting if entry[0] <= now_s]
            if due:
                self._waiting = [entry for entry in self._waiting if entry[0] > now_s]
                for t_s, message in sorted(due, key=lambda entry: entry[0]):
                    self._apply(message, t_s)

    def _apply(self, message: Measurement, t_s: float) -> None:
        trust = self._voting.trust[_source_of(message)]
        age_s = self.estimate.t_s - t_s
        if age_s > self.settings.latest_s or not self.estimate.inertial.covers(t_s):
            trust.refuse(f"late by {age_s:.2f} s")
            return
        if t_s <= trust.valid_s:
            trust.refuse("its time does not go on")
            return
        if isinstance(message, HeightAboveGround) and t_s - trust.valid_s < _HEIGHT_PERIOD_S:
            return
        trust.valid_s = t_s
        # Delayed measurement: it updates the present error through the Jacobian of the pose at t_s.
        self.estimate.predict()
        match message:
            case Odometry():
                self._use_odometry(trust, message, t_s)
            case PositionFix():
                self._use_fix(trust, message, t_s)
            case HeightAboveGround():
                self._use_height(trust, message, t_s)
            case AutopilotPose():
                past = self.estimate.past(t_s)
                level = level_of(past.state.ned_from_frd, message.ned_from_frd, _TILT_STD_RAD)
                if hypot(*level.residual) > _ASKEW[0]:
                    self.estimate.lean(level.residual, _TILT_STD_RAD)
                else:
                    self._judge(trust, level, self.estimate.rows(level, past), past)

    # --- odometers ---

    def _use_odometry(self, trust: Trust, message: Odometry, t_s: float) -> None:
        report = read(message, t_s)
        if isinstance(report, str):
            trust.refuse(report)
            return
        past = self.estimate.past(t_s)
        numbers = (*message.position_m, *message.reference_from_frd)
        if trust.is_frozen(numbers, past.state.position_ned_m, self._restlessness > 5e-3):
            trust.turn_down("frozen: the same motion again and again")
            self._voting.isolation.record(report.source).reset()
        self._source_reports.follow(report, past.state)
        measured = self._odometers.measure(report, past)
        if measured is None:
            return
        rows = self.estimate.rows(measured, past, report.source)
        if self._judge(trust, measured, rows, past, report):
            self._voting.doubt_gap(report.source)
            self._voting.hold(t_s)
        elif trust.is_out_of_step:
            self._odometers.rebase(report)
        if not trust.is_stray:
            self._source_reports.book(report, self.estimate.inertial.at(t_s))

    def _judge(self, trust: Trust, measured: Measured, rows: Matrix, past: Past, report: Report | None = None) -> bool:
        """Gates a measurement and, if it passes, updates the estimate; with a report, an outlier is told from an error."""
        # R scaled by what past innovations show; blind motion since t_s adds H N H^T.
        noise, t_s = measured.noise * trust.widening, past.state.t_s
        if past.noise is not None:
            noise = noise + (measured.by_pose * past.noise) @ measured.by_pose.T
        # Gate by the normalized innovation squared (Bar-Shalom, Li, Kirubarajan 2001, 5.4), then update.
        innovation = self.estimate.errors.test(measured.residual, rows, noise)
        if self.on_innovation is not None:
            self.on_innovation(trust.name, innovation, measured.degrees)
        if not isfinite(innovation):
            return False
        # One position alone, of whatever source, does not make a jump.
        is_jump = isinstance(report, PlaceReport) and hypot(*measured.residual) > self.settings.jump_m
        is_sound = not is_jump and innovation <= CHI2_999[measured.degrees]
        is_steady = report is None or is_sound or self._source_reports.is_steady(report, past.state)
        was_coarse, was_used_s = trust.is_coarse, trust.used_s
        is_accepted = trust.judge(innovation, measured.degrees, t_s, is_steady=is_steady)
        if was_coarse and trust.is_used:  # what it told while it was plainly wrong is forgotten
            self._voting.isolation.record(trust.name).reset()
        if not is_accepted or (is_jump and not is_steady):
            return False
        if isinstance(report, PlaceReport) and self.settings.fix_correlation_s > 0.0:
            # Errors with r = exp(-dt / tau) from one to the next average out like independent ones of R (1 + r) / (1 - r).
            noise = noise / tanh((t_s - was_used_s) / (2.0 * self.settings.fix_correlation_s))
        self.estimate.correct(measured.residual, rows, noise)
        return True

    # --- fixes and heights ---

    def _start_at(self, message: PositionFix) -> None:
        """Without a declared start the first position from outside is it; the heading is the autopilot's."""
        start = self._start
        if start is None or self.settings.start_ned_m is not None or start.is_moving:
            return
        covariance = covariance_of(message.covariance, 3, _LEAST_FIX)
        if covariance is not None and all(map(isfinite, message.position_ned_m)) and covariance.max() < 1.0:
            position = _minus(message.position_ned_m, message.lever_frd_m)
            std_m = float(np.sqrt(covariance.max())) + hypot(*message.lever_frd_m)
            self._start = start._replace(state=start.state._replace(position_ned_m=position), position_std_m=std_m)

    def _use_fix(self, trust: Trust, message: PositionFix, t_s: float) -> None:
        covariance = covariance_of(message.covariance, 3, _LEAST_FIX)
        if covariance is None or not all(map(isfinite, (*message.position_ned_m, *message.lever_frd_m))):
            trust.refuse("its numbers are not finite")
            return
        past = self.estimate.past(t_s)
        state = past.state
        if trust.is_frozen(message.position_ned_m, state.position_ned_m, self._restlessness > 5e-3):
            trust.turn_down("frozen: the same position again and again")
            self._voting.isolation.record(message.source).reset()
        pose = (state.position_ned_m, state.ned_from_frd)
        measured = place(pose, message.position_ned_m, message.lever_frd_m, covariance)
        was = self.estimate.inertial.now.position_ned_m
        report = PlaceReport(message.source, t_s, message.position_ned_m, covariance)
        self._source_reports.follow(report, state)
        was_turned_down, was_used, std_m = trust.is_turned_down, trust.is_used, self.estimate.position_std_m
        if measured is not None and self._judge(trust, measured, self.estimate.rows(measured, past), past, report):
            self._voting.hold(t_s)
            if was_turned_down or self._voting.has_been_wrong(message.source):
                self._voting.returned(message.source, measured.by_pose[:, :3].T @ measured.residual, std_m)
            self._voting.isolation.record(message.source).pull(
                _minus(self.estimate.inertial.now.position_ned_m, was), t_s
            )
        elif was_used and trust.is_turned_down and not trust.is_coarse:  # before, its error has passed the gate
            self._voting.doubt_drag(message.source)
        if not trust.is_stray:
            self._source_reports.book(report, self.estimate.inertial.at(t_s))

    def _use_height(self, trust: Trust, message: HeightAboveGround, t_s: float) -> None:
        if not isfinite(message.height_m) or not 0.0 <= message.height_m < 1e3:
            trust.refuse("its number is no height")
            return
        estimate, variance = self.estimate, self.settings.height_std_m**2
        estimate.sunk_m = 0.0
        past = estimate.past(t_s)
        north, east, down = past.state.position_ned_m
        if trust.is_frozen((message.height_m,), (north, east, 0.0), is_moving=False, least_m=_LEVEL_M):
            trust.turn_down("frozen: the same height again and again")
            return
        if trust.is_repeating and estimate.errors.covariance[2, 2] > _UNSURE_M2:
            trust.refuse("the same height again while the height is uncertain")
            return
        reported = height_over(message.height_m, past.state.ned_from_frd, is_slant=self.settings.is_height_slant)
        is_new_floor = self._height_misses >= _NEW_FLOOR and not self._voting.is_disputed
        is_new_floor = is_new_floor and abs(past.state.velocity_ned_m_s[2]) < _LEVEL_M_S
        if estimate.floor_down_m is None or is_new_floor:
            estimate.measure_floor(reported.vertical_m, down, variance)
            self._height_misses = 0
            trust.let_in()
            return
        # Height over the floor: residual h - (floor - down), H = H_range J_past, and 1 on the floor.
        rows = np.zeros((1, estimate.errors.size))
        rows[:, :SIZE] = reported.by_pose @ past.jacobian
        rows[0, FLOOR] += 1.0
        residual = np.array((reported.vertical_m - (estimate.floor_down_m - down),))
        measured = Measured(residual, reported.by_pose, None, np.array(((variance,),)))
        was_turned_down, was = trust.is_turned_down, estimate.inertial.now.position_ned_m
        std_m = estimate.position_std_m
        is_accepted = self._judge(trust, measured, rows, past)
        if is_accepted and was_turned_down:
            self._voting.returned(HEIGHT, np.subtract(estimate.inertial.now.position_ned_m, was), std_m)
        self._follow_heights(float(residual[0]), message.height_m, is_accepted=is_accepted)
        self._height_misses = 0 if is_accepted or trust.is_used else self._height_misses + 1

    def _follow_heights(self, off_m: float, height_m: float, *, is_accepted: bool) -> None:
        """Follows heights that fail the gate and lead away from the floor; garbage leaps, and a frozen sensor repeats one."""
        first_m, last_m = self._heights_off_m
        is_leading_on = not is_accepted and abs(off_m - last_m) < _LEAP_M and height_m != self._height_m
        self._heights_off_m = (first_m if is_leading_on else off_m, off_m)
        self._height_m = height_m
        self._voting.height_drift_m = abs(off_m - self._heights_off_m[0])
        if self._voting.height_drift_m > LEADING_M and not self._voting.is_height_held:
            self.estimate.sunk_m = abs(off_m)

    # --- time passes ---

    def tick(self, now_s: float) -> None:
        """Detects silent sources, coasts without the IMU and runs the vote; called a few times a second."""
        self._now_s = max(self._now_s, now_s)
        self._voting.check_silence(now_s)
        if not self.is_aligned:
            return
        if now_s - self.estimate.t_s > _IMU_LOST_S:
            self._voting.received(IMU, self._voting.trust[IMU].received_s).step_back("nothing comes from it")
            while self.estimate.t_s < now_s - 1e-6:
                self._coast(min(self.estimate.t_s + _COAST_STEP_S, now_s))
            self._use_waiting()
        self._voting.update()
        if self._voting.is_height_held:
            self.estimate.sunk_m = 0.0

    def _distrust_imu(self, now_s: float, reason: str) -> None:
        if not self._imu.is_distrusted(now_s):
            self._imu.distrust(now_s, reason, self._voting.trust[IMU])

    # --- what it says ---

    @property
    def witnesses(self) -> list[str]:
        """The sources that hold the position now."""
        return self._voting.witnesses

    def why_not_valid(self) -> str:
        """Why the pose is not valid; empty if it is."""
        if not self.is_aligned:
            return "not aligned yet" if self._start is not None else "the start is not known yet"
        lost_s = self.estimate.t_s - self._voting.held_s
        if lost_s > self.settings.coast_s:
            return f"nothing has held the position for {lost_s:.1f} s: {self._voting.problems()}"
        argued_s = self._voting.argued_s
        if self._voting.conflict is not None and argued_s > self.settings.dispute_s:
            return f"{' and '.join(self._voting.conflict.against)} have contradicted each other for {argued_s:.0f} s"
        std_m = max(self.estimate.position_std_m)
        if not std_m <= self.settings.std_limit_m:
            return f"uncertain by {std_m:.2f} m: {self._voting.problems()}"
        return ""

    def pose(self) -> Pose:
        """The current pose, valid at `estimate.t_s`."""
        reason = self.why_not_valid()
        inertial = self.estimate.inertial
        is_lost = bool(reason)
        return Pose(
            position_ned_m=self.estimate.reported_ned_m,
            velocity_ned_m_s=inertial.now.velocity_ned_m_s,
            ned_from_frd=inertial.now.ned_from_frd,
            rate_frd_rad_s=inertial.rate_frd_rad_s,
            position_std_m=self.estimate.position_std_m if self.is_aligned else (0.0, 0.0, 0.0),
            is_valid=not is_lost,
            reason=reason,
            quality=0.0 if is_lost else self._voting.quality,
            reset_counter=self.estimate.reset_counter,
            sources=[name for name, trust in self._voting.trust.items() if trust.is_used] if self.is_aligned else [],
        )

    def velocity_std_m_s(self) -> Vector3:
        """Standard deviation of the velocity along each axis."""
        n, e, d = np.sqrt(self.estimate.errors.covariance.diagonal()[VELOCITY]).tolist()
        return (n, e, d)

    def state(self) -> FusionState:
        """State of the sources, and the IMU's biases."""
        sources: list[SourceState] = [trust.state() for trust in self._voting.trust.values()]
        inertial = self.estimate.inertial
        return FusionState(
            sources=sources,
            gyroscope_bias_rad_s=inertial.gyroscope_bias_rad_s,
            accelerometer_bias_m_s2=inertial.accelerometer_bias_m_s2,
        )


def _source_of(message: Measurement) -> str:
    match message:
        case HeightAboveGround():
            return HEIGHT
        case AutopilotPose():
            return AUTOPILOT
        case _:
            return message.source


def _minus(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
