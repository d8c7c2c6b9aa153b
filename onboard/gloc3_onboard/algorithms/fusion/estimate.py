"""State estimate: nominal state and covariance, propagated with the inertial unit and corrected by measurements.

Measurements may be late: a measurement of a past pose is converted to one of the present pose (`past_pose`), so nothing
is recomputed and the cost of each is the same. The noise of the inertial unit in between is neglected: over 0.2 s it is
below a millimetre and a hundredth of a degree.
"""

from math import sqrt
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import GRAVITY_M_S2, Quaternion, Vector3, multiply, normalize, rotate, rotate_back
from gloc3_onboard.algorithms.fusion.alignment import StartPose
from gloc3_onboard.algorithms.fusion.error_state import (
    ACCELEROMETER,
    CLONE,
    FLOOR,
    GYROSCOPE,
    POSITION,
    ROTATION,
    SIZE,
    VELOCITY,
    ErrorState,
    Matrix,
    past_pose,
)
from gloc3_onboard.algorithms.fusion.inertial import Inertial, InertialState
from gloc3_onboard.algorithms.fusion.inertial_motion import InertialMotion
from gloc3_onboard.algorithms.fusion.measurements import Measured, matrix_of
from gloc3_onboard.algorithms.fusion.settings import FusionSettings

LONGEST_S: Final = 0.05
"""The inertial unit is missed when it says nothing for longer."""
_STEP_S: Final = 0.1
"""The covariance is predicted at least so often."""
_BLIND: Final = (0.12, 1.0)
"""Noise densities of rate and acceleration where nothing is known of them: rad/s/√Hz, m/s²/√Hz."""
_BLIND_PAST_S: Final = 0.15
"""Age of a past pose up to which the assumed motion is used without the inertial unit, s."""
_TURN_REPORTED: Final = 0.03
"""Noise density of the autopilot's occasional rate, rad/s/√Hz."""
_BLIND_STD_M: Final = 0.05
"""Standard deviation of the position beside that of the filter while the inertial unit is missing: of the attitude with which
the other sources are read, and of their times."""
_TILT_STD_RAD, _VELOCITY_STD_M_S, _GYRO_BIAS_STD, _FORCE_BIAS_STD = 0.008, 0.02, 5e-4, 0.05


class Past(NamedTuple):
    """A past pose, with the Jacobian of its error by the error now."""

    state: InertialState
    jacobian: Matrix
    noise: Matrix | None = None
    """Variances (6,) of unmeasured motion since then, while the inertial unit is missing."""


class PoseEstimate:
    """Nominal state, biases, floor level and covariance, and past poses kept as clones."""

    def __init__(self, settings: FusionSettings) -> None:
        self.inertial: Final = Inertial()
        self.errors: Final = ErrorState()
        self.alone: Final = InertialMotion(settings.accelerometer_noise)
        """The motion of the inertial unit alone."""
        self.clones: dict[str, tuple[Vector3, Quaternion]] = {}
        """The believed poses behind the clones of the covariance."""
        self.floor_down_m: float | None = None
        self.reset_counter = 0
        self.disputed_m: Vector3 = (0.0, 0.0, 0.0)
        """Possible error along each axis, m, from contradicting sources: reported, and not assigned to either of
        them."""
        self.separation_m: Vector3 = (0.0, 0.0, 0.0)
        """How far the position would be from here along each axis if any one source were left out: reported, too."""
        self.scale_m: Vector3 = (0.0, 0.0, 0.0)
        """Possible error of the scale of the only odometer, along each axis, as far as the source of positions beside it may not
        see it: reported, too."""
        self.misfit = 1.0
        """By how much more the sources that are used differ from the position than its covariance says, as a factor on the
        variance: reported, too."""
        self.sunk_m = 0.0
        """By how much heights that lead away from the floor contradict the position, where nothing else tells its height:
        reported, too."""
        self.reference_m: Vector3 = (0.0, 0.0, 0.0)
        """How far the source of positions that is used now was from here when it came back from being turned down, along
        each axis: which of the two was wrong, no odometer can tell any more."""
        self._offset: Vector3 = (0.0, 0.0, 0.0)
        """What is still to come into the reported position."""
        self._settings = settings
        self._noise = (
            settings.gyroscope_noise,
            settings.accelerometer_noise,
            settings.gyroscope_walk,
            settings.accelerometer_walk,
        )
        self._predicted_s = self._distance_m = 0.0
        self._force_s: Vector3 = (0.0, 0.0, 0.0)
        self.sound_s = float("-inf")
        """What is believed of the time before is no good: nothing can be counted from there."""
        self._is_blind = False
        self._blind_turn = _BLIND[0]

    @property
    def t_s(self) -> float:
        """Time of validity of the estimate."""
        return self.inertial.now.t_s

    def begin(self, start: StartPose, state: InertialState, gyroscope_bias: Vector3) -> None:
        """Starts at a state."""
        self.inertial.gyroscope_bias_rad_s = gyroscope_bias
        self.inertial.accelerometer_bias_m_s2 = (0.0, 0.0, 0.0)
        self.inertial.place(state)
        velocity = 0.2 if start.is_moving else _VELOCITY_STD_M_S
        tilt = 0.03 if start.is_moving else _TILT_STD_RAD
        bias = 5e-3 if start.is_moving else _GYRO_BIAS_STD
        deviations = np.zeros(SIZE)
        deviations[POSITION], deviations[VELOCITY] = start.position_std_m, velocity
        deviations[ROTATION] = (tilt, tilt, start.heading_std_rad)
        deviations[GYROSCOPE], deviations[ACCELEROMETER], deviations[FLOOR] = bias, _FORCE_BIAS_STD, 100.0
        self.errors.reset(deviations)
        self.alone.clear()
        self.clones.clear()
        self.floor_down_m = None
        self._offset = self.reference_m = self.scale_m = (0.0, 0.0, 0.0)
        self._predicted_s = state.t_s
        self._force_s = (0.0, 0.0, 0.0)
        self._distance_m = 0.0

    # --- time ---

    def move(self, rate: Vector3, force: Vector3, t_s: float, *, is_blind: bool = False) -> None:
        """Propagates to `t_s` with the mean rate and specific force; blind where these are assumed."""
        duration_s = t_s - self.t_s
        is_blind = is_blind or duration_s > LONGEST_S
        if is_blind != self._is_blind:
            self.predict()
            self._is_blind = is_blind
        self.inertial.move(rate, force, t_s)
        fn, fe, fd = self.inertial.force_ned_m_s2
        x, y, z = self._force_s
        self._force_s = (x + fn * duration_s, y + fe * duration_s, z + fd * duration_s)
        vn, ve, _ = self.inertial.now.velocity_ned_m_s
        self._distance_m += sqrt(vn * vn + ve * ve) * duration_s
        if self._settings.blend_s > 0.0:
            x, y, z = self._offset
            left = max(0.0, 1.0 - duration_s / self._settings.blend_s)
            self._offset = (x * left, y * left, z * left)
        if t_s - self._predicted_s >= _STEP_S:
            self.predict()

    def coast(self, t_s: float, rate_frd_rad_s: Vector3 | None = None) -> None:
        """Propagates without the IMU at constant velocity, with another source's turn rate or none."""
        now = self.inertial.now
        # Constant velocity: assume f = R^T (0, 0, -g), and add the biases that the integration subtracts.
        level = rotate_back(now.ned_from_frd, (0.0, 0.0, -GRAVITY_M_S2))
        fx, fy, fz = (f + b for f, b in zip(level, self.inertial.accelerometer_bias_m_s2, strict=True))
        p, q, r = self.inertial.gyroscope_bias_rad_s
        if rate_frd_rad_s is not None:
            p, q, r = p + rate_frd_rad_s[0], q + rate_frd_rad_s[1], r + rate_frd_rad_s[2]
        turn = _BLIND[0] if rate_frd_rad_s is None else _TURN_REPORTED
        if turn != self._blind_turn:
            self.predict()
            self._blind_turn = turn
        self.move((p, q, r), (fx, fy, fz), t_s, is_blind=True)
        self.sound_s = max(self.sound_s, t_s - _BLIND_PAST_S)

    def jolt(self, std_m_s: float) -> None:
        """Inflates the velocity covariance after an unmeasured change."""
        self.predict()
        self.alone.clear()
        self.errors.inflate(VELOCITY, std_m_s)

    def predict(self) -> None:
        """Propagates the covariance to the time of the nominal state.

        Before every update it has to be current: a covariance of an earlier position would make measurements of motion
        appear to contain an absolute heading, which they do not.
        """
        duration_s = self.t_s - self._predicted_s
        if duration_s <= 0.0:
            return
        floor_m2 = self._settings.floor_walk**2 * self._distance_m
        if self._is_blind:  # what is supposed of the motion follows from no attitude and no bias
            noise, attitude, mean = (self._blind_turn, _BLIND[1], *self._noise[2:]), _NOTHING, _NONE
        else:
            noise, attitude = self._noise, matrix_of(self.inertial.now.ned_from_frd)
            x, y, z = self._force_s
            mean = (x / duration_s, y / duration_s, z / duration_s)
        self.errors.predict(duration_s, attitude, mean, noise, floor_m2)
        self._predicted_s = self.t_s
        self._force_s = (0.0, 0.0, 0.0)
        self._distance_m = 0.0

    def past(self, t_s: float) -> Past:
        """The pose at a past time that the inertial solution covers."""
        state, now = self.inertial.at(t_s), self.inertial.now
        age_s = now.t_s - t_s
        if age_s < 1e-6:
            return Past(now, past_pose(0.0, _UNTURNED, _NONE, _NONE))
        if self._is_blind:
            # Blind: white acceleration noise s gives s^2 t^3 / 3 in position, white rate noise w gives w^2 t in angle.
            place, angle = _BLIND[1] ** 2 * age_s**3 / 3.0, self._blind_turn**2 * age_s
            noise = np.array((place, place, place, angle, angle, angle))
            return Past(state, past_pose(age_s, _NOTHING, _NONE, _NONE), noise)
        (vn, ve, vd), (un, ue, ud) = now.velocity_ned_m_s, state.velocity_ned_m_s
        (pn, pe, pd), (qn, qe, qd) = now.position_ned_m, state.position_ned_m
        # Integrals of the specific force since then: u = v - v_then - g a, d = p - p_then - v_then a - g a^2/2.
        fall = GRAVITY_M_S2 * age_s
        change = (vn - un, ve - ue, vd - ud - fall)
        shift = (pn - qn - un * age_s, pe - qe - ue * age_s, pd - qd - ud * age_s - 0.5 * fall * age_s)
        return Past(state, past_pose(age_s, matrix_of(now.ned_from_frd), change, shift))

    # --- measurements ---

    def remember(self, name: str, t_s: float) -> None:
        """Clones a past pose under a name."""
        self.predict()
        past = self.past(t_s)
        noise = np.zeros((CLONE, CLONE)) if past.noise is None else np.diag(past.noise)
        self.errors.clone(name, past.jacobian, noise)
        self.clones.pop(name, None)
        self.clones[name] = (past.state.position_ned_m, past.state.ned_from_frd)

    def drop(self, name: str) -> None:
        """Drops a clone, if there is one."""
        if name in self.clones:
            self.errors.drop(name)
            del self.clones[name]

    def rows(self, measured: Measured, past: Past, clone: str = "") -> Matrix:
        """Jacobian of a measurement by the full error state, (m, size)."""
        # Chain rule: H = H_pose J_past on the present error, H_reference on the clone.
        rows = np.zeros((measured.degrees, self.errors.size))
        rows[:, :SIZE] = measured.by_pose @ past.jacobian
        if measured.by_reference is not None:
            first = self.errors.place_of(clone)
            rows[:, first : first + CLONE] = measured.by_reference
        return rows

    def correct(self, residual: Matrix, rows: Matrix, noise: Matrix) -> None:
        """Updates state, biases, floor and clones by a measurement."""
        error = self.errors.update(residual, rows, noise).tolist()
        # Inject: x <- x + dx, q <- exp(dtheta) * q (Solà 2017, ch. 7); the reset Jacobian is taken as I.
        moved = (error[0], error[1], error[2])
        inertial = self.inertial
        velocity, turn = (error[3], error[4], error[5]), (error[6], error[7], error[8])
        self.alone.correct(self.t_s, moved, velocity, self._acceleration(turn, (error[12], error[13], error[14])))
        inertial.correct(moved, velocity, turn)
        p, q, r = inertial.gyroscope_bias_rad_s
        inertial.gyroscope_bias_rad_s = (p + error[9], q + error[10], r + error[11])
        x, y, z = inertial.accelerometer_bias_m_s2
        inertial.accelerometer_bias_m_s2 = (x + error[12], y + error[13], z + error[14])
        if self.floor_down_m is not None:
            self.floor_down_m += error[FLOOR]
        for index, (name, (position, attitude)) in enumerate(self.clones.items()):
            dx, dy, dz, a, b, c = error[SIZE + CLONE * index : SIZE + CLONE * (index + 1)]
            self.clones[name] = (
                (position[0] + dx, position[1] + dy, position[2] + dz),
                _turned((a, b, c), attitude),
            )
        self._blend(moved)

    def _acceleration(self, turn_rad: Vector3, bias_m_s2: Vector3) -> Vector3:
        """Change of the acceleration by corrections of attitude and bias: dtheta x f - R db."""
        (a, b, c), (fn, fe, fd) = turn_rad, self.inertial.force_ned_m_s2
        north, east, down = rotate(self.inertial.now.ned_from_frd, bias_m_s2)
        return (b * fd - c * fe - north, c * fn - a * fd - east, a * fe - b * fn - down)

    def _blend(self, moved: Vector3) -> None:
        x, y, z = self._offset
        if moved[0] ** 2 + moved[1] ** 2 + moved[2] ** 2 > self._settings.jump_m**2:
            self.reset_counter += 1
            self._offset = (0.0, 0.0, 0.0)
        elif self._settings.blend_s > 0.0:
            self._offset = (x - moved[0], y - moved[1], z - moved[2])

    def stand(self) -> None:
        """Applies a zero-velocity update."""
        self.predict()
        # Zero-velocity update: residual 0 - v, H = I on the velocity (Groves 2013, ch. 15).
        rows = np.zeros((3, self.errors.size))
        rows[:, VELOCITY] = np.eye(3)
        self.correct(-np.array(self.inertial.now.velocity_ned_m_s), rows, _AT_REST)

    def measure_floor(self, height_m: float, down_m: float, variance_m2: float) -> None:
        """Sets the floor to the level just measured."""
        self.floor_down_m = down_m + height_m
        self.errors.copy_floor(variance_m2)

    def remember_motion(self) -> None:
        """Keeps the state of now, to tell later what the inertial unit alone has measured since."""
        self.predict()
        if self._is_blind:
            self.alone.clear()
        else:
            attitude = matrix_of(self.inertial.now.ned_from_frd)
            self.alone.remember(self.t_s, self.errors.covariance, attitude, self.inertial.force_ned_m_s2)

    # --- doubts ---

    def move_over(self, by_m: Vector3, covariance: Matrix) -> None:
        """Shifts the position by an offset of covariance (3, 3)."""
        self.alone.correct(self.t_s, by_m, _NONE, _NONE)
        self.inertial.correct(by_m, _NONE, _NONE)
        self.errors.loosen(POSITION.start, covariance)
        self._blend(by_m)

    def doubt_reference(self, apart_m: Matrix, std_m: Vector3) -> None:
        """Reports from now on that the position may be off by this vector, (3,), and as uncertain as it was before.

        A source of positions that was wrong does not make certain again what others have made uncertain meanwhile.
        """
        north, east, down = np.maximum(np.hypot(apart_m, std_m), self.reference_m).tolist()
        self.reference_m = (north, east, down)

    def inflate_position(self, apart_m: Vector3) -> None:
        """Inflates all positions, clones included, by a common error along each axis."""
        for axis, size in enumerate(apart_m):
            # Rank one: P <- P + s s^T, the same error in the present position and in every clone.
            shift = np.zeros(self.errors.size)
            shift[axis] = size
            shift[SIZE + axis :: CLONE] = size
            self.errors.covariance += np.outer(shift, shift)

    def doubt_drag(self, apart_m: Vector3, begin_s: float) -> None:
        """Inflates all positions by a common error, and the velocity by what has been added to it since a time."""
        self.inflate_position(apart_m)
        self.errors.loosen(VELOCITY.start, self.alone.corrected(begin_s)[1] ** 2)

    def lean(self, by_rad: Matrix, std_rad: float) -> None:
        """Turns the attitude by (2,) radians about north and east, and inflates its tilt covariance."""
        north, east = by_rad.tolist()
        self.alone.correct(self.t_s, _NONE, _NONE, self._acceleration((north, east, 0.0), _NONE))
        self.inertial.correct(_NONE, _NONE, (north, east, 0.0))
        self.errors.loosen(ROTATION.start, np.full(2, std_rad**2))

    def inflate_motion(self) -> None:
        """Inflates velocity, attitude and biases, because the sources agree on a different motion."""
        self.sound_s = self.t_s
        self.errors.loosen(VELOCITY.start, np.array((0.25, 0.25, 0.25, 2e-3, 2e-3, 2e-3)))
        self.errors.loosen(GYROSCOPE.start, np.array((1e-3, 1e-3, 1e-3, 0.25, 0.25, 0.25)))

    # --- what is reported ---

    @property
    def reported_ned_m(self) -> Vector3:
        """The position with corrections blended in."""
        (x, y, z), (dx, dy, dz) = self.inertial.now.position_ned_m, self._offset
        return (x + dx, y + dy, z + dz)

    @property
    def heading_std_rad(self) -> float:
        """Standard deviation of the heading."""
        return sqrt(float(self.errors.covariance[8, 8]))

    @property
    def position_std_m(self) -> Vector3:
        """Standard deviation of the reported position along each axis: with what is not blended in yet."""
        n, e, d = self.errors.covariance.diagonal()[POSITION].tolist()
        doubts = zip(self.disputed_m, self.separation_m, self.reference_m, self.scale_m, self._offset, strict=True)
        blind_m2 = _BLIND_STD_M**2 if self._is_blind else 0.0
        north, east, down = (blind_m2 + sum(m * m for m in possible_m) for possible_m in doubts)
        down += self.sunk_m**2
        return (sqrt(n * self.misfit + north), sqrt(e * self.misfit + east), sqrt(d * self.misfit + down))


def _turned(rotation_rad: tuple[float, float, float], attitude: Quaternion) -> Quaternion:
    """An attitude turned by a small rotation vector in NED."""
    a, b, c = rotation_rad
    return normalize(multiply((1.0, 0.5 * a, 0.5 * b, 0.5 * c), attitude))


_NONE: Final[Vector3] = (0.0, 0.0, 0.0)
_UNTURNED: Final = np.eye(3)
_NOTHING: Final = np.zeros((3, 3))
_AT_REST: Final = np.eye(3) * 0.01**2
