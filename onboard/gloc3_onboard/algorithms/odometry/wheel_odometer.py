"""Wheel odometry of differential and skid-steered vehicles, with an estimate of slip: a plain algorithm.

Left and right wheels that roll turn the body by the difference of their distances over the track. Those of a
skid-steered body slide sideways as it turns: they turn it by less, 1/1.5 for the example rover (`turn_factor`; Mandow
et al., "Experimental kinematics for wheeled skid-steer mobile robots", IROS 2007, call the same an effective track).
The slip in a motion follows from comparing that turn with the one measured by gyroscopes.
"""

from math import cos, hypot, isfinite, sin
from typing import NamedTuple

import msgspec


class Wheelbase(msgspec.Struct, frozen=True, kw_only=True):
    """Geometry of the vehicle, and error model of its wheels."""

    track_m: float = 0.37559
    """Between the middles of left and right wheels."""
    turn_factor: float = 1.5
    """Factor on the difference of the distances compared with pure rolling; 1 for wheels that roll."""
    noise_m_s: float = 0.01
    """Standard deviation that is always there: ticks, time stamps."""
    slip_share: float = 0.02
    """Standard deviation of the forward distance, as a share of it."""
    side_share: float = 0.02
    """Standard deviation of the sideways distance, as a share of the forward distance."""
    side_turn_m: float = 0.05
    """The same for each radian that it turns: how far from its reference point the body turns about."""
    slip_max_m_s: float = 0.25
    """Slip beyond which the wheels are not used."""


class WheelStep(NamedTuple):
    """Motion between two readings of the encoders."""

    ahead_m: float
    turn_rad: float
    """To the right, as the wheels say."""
    ahead_std_m: float
    side_std_m: float
    turn_std_rad: float
    slip_m_s: float
    """Of the rims, as far as it shows in the turn."""
    reason: str
    """Why it says nothing; empty where it does."""

    @property
    def place_m(self) -> tuple[float, float]:
        """Displacement ahead and to the right, along an arc."""
        half = 0.5 * self.turn_rad
        # Chord of an arc s with angle t: s sin(t/2) / (t/2), in the direction t/2; sin(x)/x is about 1 - x^2/6.
        chord_m = self.ahead_m * (1.0 - half * half / 6.0)
        return chord_m * cos(half), chord_m * sin(half)


class WheelOdometer:
    """Converts the distances of both sides into steps.

    Args:
        base: of the vehicle.
        speed_max_m_s: a faster change of the distances means that the encoders have been reset.
    """

    def __init__(self, base: Wheelbase = Wheelbase(), speed_max_m_s: float = 5.0) -> None:  # noqa: B008 # frozen
        self._base, self._speed_max_m_s = base, speed_max_m_s
        self._last: tuple[float, float] | None = None

    def begin(self) -> None:
        """Restarts with the next distances."""
        self._last = None

    def update(self, left_m: float, right_m: float, seconds: float, measured_rad: float | None) -> WheelStep | None:
        """The step since the previous distances; None for the first, and after a reset of the counters.

        Args:
            left_m: distance of the left rim since the encoders' reset.
            right_m: of the right one.
            seconds: since the previous distances.
            measured_rad: rotation of the body to the right since then, by its gyroscopes; None where it is unknown.
        """
        before, self._last = self._last, (left_m, right_m) if isfinite(left_m + right_m) else None
        if before is None or self._last is None or seconds <= 0.0:
            return None
        left, right = left_m - before[0], right_m - before[1]
        if max(abs(left), abs(right)) > self._speed_max_m_s * seconds:
            return None
        base = self._base
        # Differential drive: s = (l + r) / 2, turn = (l - r) / b, b the effective track (Mandow et al. 2007).
        ahead, arm_m = 0.5 * (left + right), base.track_m * base.turn_factor
        turn = (left - right) / arm_m
        # Slip of the rims: b |turn - gyroscopes' turn| / 2; it widens the deviations below.
        slip_m = 0.0 if measured_rad is None else 0.5 * arm_m * abs(turn - measured_rad)
        slip_m_s = slip_m / seconds
        noise_m = base.noise_m_s * seconds
        turned = abs(turn if measured_rad is None else measured_rad)
        ahead_std = hypot(noise_m, base.slip_share * ahead, slip_m)
        return WheelStep(
            ahead_m=ahead,
            turn_rad=turn,
            ahead_std_m=ahead_std,
            side_std_m=hypot(noise_m, base.side_share * ahead, base.side_turn_m * turned, slip_m),
            turn_std_rad=2.0 * ahead_std / arm_m,
            slip_m_s=slip_m_s,
            reason=f"the wheels slip by {slip_m_s:.2f} m/s" if slip_m_s > base.slip_max_m_s else "",
        )
