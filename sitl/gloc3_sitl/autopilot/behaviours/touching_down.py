"""Landing on wings: descend in circles, approach on a slope, flare, roll out."""

from enum import StrEnum
from math import atan2, hypot
from typing import Final

from gloc3.messages.frames import Vector3, wrap_pi
from gloc3_sitl.autopilot.behaviours.base import Activity
from gloc3_sitl.autopilot.behaviours.flight_path import PlanePath, beyond
from gloc3_sitl.autopilot.control.setpoint import LANDED, Setpoint, WingSetpoint
from gloc3_sitl.autopilot.craft import Craft

_ALIGNED_RAD: Final = 0.5
_HEIGHT_M: Final = 4.0
_ROLLS_M: Final = 0.5
_FLARE_SPEED_S: Final = 1.5
"""Time before touchdown at which the flare starts, s, where that is higher than LAND_FLARE_ALT."""


class LandingPhase(StrEnum):
    """Phases of a landing."""

    CIRCLE = "circle"
    FINAL = "final"
    FLARE = "flare"


class Descent(Activity):
    """Lands at a position, from a direction; done at standstill.

    Args:
        craft: the vehicle.
        place: end of the slope on the ground.
        start: start of the slope; None for the default, against the direction of the take-off, reached by a circle at
            that height.
    """

    __slots__ = ("_circle_m", "_directions_rad", "_fix", "_path", "_place", "is_done", "phase")

    def __init__(self, craft: Craft, place: Vector3, start: Vector3 | None = None) -> None:
        super().__init__(craft)
        self.is_done = False
        gains = craft.tuning.wings
        self._path = PlanePath(craft)
        self._place = place
        self._circle_m = gains.circle_m
        if start is None:
            self._directions_rad = craft.runway_rad
            self._fix = beyond(place, self._directions_rad, -gains.approach_m, gains.approach_height_m)
            self.phase = LandingPhase.CIRCLE
        else:
            self._directions_rad = atan2(place[1] - start[1], place[0] - start[0])
            self._fix = start
            self.phase = LandingPhase.FINAL
        # The flare takes it on beyond the end of the slope.
        away_m = hypot(place[0] - self._fix[0], place[1] - self._fix[1])
        sink = gains.approach_m_s * (place[2] - self._fix[2]) / max(1.0, away_m)
        flare_m = 2.0 * gains.flare_m * gains.approach_m_s / max(0.5, sink + gains.flare_sink_m_s)
        self._path.head_for(beyond(place, self._directions_rad, -min(flare_m, 0.5 * away_m)), self._fix)

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft, gains = self.craft, self.craft.tuning.wings
        if craft.is_landed or not craft.is_armed:
            self.is_done = True
            return LANDED
        match self.phase:
            case LandingPhase.CIRCLE:
                return self._lose_height()
            case LandingPhase.FINAL:
                self._path.airspeed_m_s = gains.approach_m_s
                sink = craft.estimator.inertial.velocity_ned_m_s[2]
                if self._height_m() < max(gains.flare_m, _FLARE_SPEED_S * sink):
                    self.phase = LandingPhase.FLARE
                return self._path.on_slope()
            case LandingPhase.FLARE:
                if self._height_m() < _ROLLS_M:
                    return WingSetpoint(pitch_rad=0.0, throttle=0.0, heading_rad=self._directions_rad)
                return WingSetpoint(climb_m_s=-gains.flare_sink_m_s, throttle=0.0)

    def _height_m(self) -> float:
        return self.craft.height_over_ground_m

    def _lose_height(self) -> Setpoint:
        """Circles at the start of the slope until low enough and on course."""
        craft, gains = self.craft, self.craft.tuning.wings
        side = 1.0 if self._circle_m > 0.0 else -1.0
        centre = beyond(self._fix, wrap_pi(self._directions_rad + side * 1.5708), abs(self._circle_m))
        inertial = craft.estimator.inertial
        vn, ve, _ = inertial.velocity_ned_m_s
        is_aligned = abs(wrap_pi(atan2(ve, vn) - self._directions_rad)) < _ALIGNED_RAD
        is_low = abs(inertial.position_ned_m[2] - self._fix[2]) < _HEIGHT_M
        if is_low and is_aligned and self._path.is_round(centre, self._circle_m):
            self.phase = LandingPhase.FINAL
        if inertial.position_ned_m[2] > self._fix[2] - 2.0 * _HEIGHT_M:
            self._path.airspeed_m_s = gains.approach_m_s
        return self._path.circle(centre, self._circle_m)


class AutoLand(Descent):
    """Autoland: at home, in the direction of the take-off."""

    __slots__ = ()

    def __init__(self, craft: Craft) -> None:
        home = craft.home
        here = craft.estimator.inertial.position_ned_m
        super().__init__(craft, here if home is None else home.position_ned_m)
