"""Limits and power model of a platform, against which motion and energy are checked."""

from typing import Annotated, Final

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
Height = Annotated[float, msgspec.Meta(ge=-11_000.0, le=1e6)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


WIND_ERROR_S2_M: Final = 0.01
"""Tracking error in gusty wind, m, for each (m/s)² of its mean speed: drag goes with its square. Both styles of the embedded
autopilot, along an edge at 2 m/s: 0.07 m in 3 m/s, up to 0.32 m in 6 m/s, 0.52 m in 9 m/s."""


class PlatformRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all structures in a platform file."""


class Limits(PlatformRow, frozen=True, kw_only=True):
    """What the driver and the limiter never let the vehicle exceed, and missions are checked against."""

    speed_m_s: Positive = 3.0
    """Greatest horizontal speed."""
    climb_m_s: Positive = 1.0
    """Greatest vertical speed."""
    landing_m_s: Positive = 0.5
    """Speed of the last part of a landing; landings are estimated with it."""
    acceleration_m_s2: Positive = 2.5
    height_min_m: Height = 0.3
    """Least height above home of a waypoint; negative for what dives."""
    height_max_m: Height = 30.0
    """Greatest height above home."""
    altitude_min_m: NotNegative = 0.5
    """Least height above the ground or the sea bed that a path may request."""
    ground_clearance_m: NotNegative | None = None
    """Least height above the ground of terrain tiles, where they are given; no less than their errors, which reach 10 m and
    more. None: paths below that ground are warned of."""
    fence_margin_m: NotNegative = 0.5
    """Distance that waypoints and legs keep from the fence, without wind."""
    wind_m_s: NotNegative = 0.0
    """Mean speed of the strongest gusty wind in which it flies: they keep so much farther away as that displaces it."""
    wind_error_m: NotNegative | None = None
    """Farthest that this wind displaces it from its path; None: 0.01 m times the square of the wind's speed in m/s, as
    measured on the simulated Pelican."""
    separation_m: NotNegative = 0.0
    """Least distance from other vehicles in the air, to the side; 0: none is kept, and none is checked."""
    separation_height_m: Positive | None = None
    """The same, up and down; None: half of `separation_m`."""
    survey_height_m: Height | None = None
    """Default height of patterns above home: 0 on the ground or the water, negative for underwater vehicles."""
    survey_speed_m_s: Positive | None = None
    """Default speed of paths; None: 1 m/s, or the maximum speed where that is less."""
    survey_acceptance_m: Positive = 0.25
    """So near patterns that say nothing come to a waypoint."""
    speed_min_m_s: NotNegative = 0.0
    """Slower paths are refused: a fixed-wing vehicle stalls."""
    turn_radius_m: NotNegative = 0.0
    """For vehicles that can neither turn on the spot nor stop, such as a plane: paths need room to turn, and it waits
    in circles."""
    approach_m: NotNegative = 0.0
    """Of what lands on wings along its runway: distance before home at which its approach begins with a circle; 0 for
    others."""
    landing_roll_m: NotNegative = 0.0
    """With that: farthest beyond home that it comes to a standstill."""

    rotors_speed_m_s: NotNegative = 0.0
    """Of what has both wings and rotors: speed of ways on rotors. 0 for others."""
    transition_m: NotNegative = 0.0
    """With that: way that it makes from wings to a hover, or from a hover to wings, at most."""
    wings_height_min_m: NotNegative = 0.0
    """With that: least height above home of ways on wings; a transition loses some height."""

    def __post_init__(self) -> None:
        if self.height_min_m >= self.height_max_m:
            raise ValueError("height_min_m must be less than height_max_m")
        if self.survey_height_m is not None and not self.height_min_m <= self.survey_height_m <= self.height_max_m:
            raise ValueError("survey_height_m must be from height_min_m to height_max_m")
        if self.survey_speed_m_s is not None and self.survey_speed_m_s > self.speed_m_s:
            raise ValueError("survey_speed_m_s must be no more than speed_m_s")
        if not self.speed_min_m_s <= (self.survey_speed_m_s or self.speed_m_s) <= self.speed_m_s:
            raise ValueError("speed_min_m_s must be no more than survey_speed_m_s and speed_m_s")

    @property
    def stays_down(self) -> bool:
        """Whether the vehicle drives, floats or dives: it needs no take-off."""
        return self.survey_height_m is not None and self.survey_height_m <= 0.0

    @property
    def margin_m(self) -> float:
        """Distance that waypoints and legs keep from the fence, with the tracking error that the stated wind causes."""
        error_m = WIND_ERROR_S2_M * self.wind_m_s**2 if self.wind_error_m is None else self.wind_error_m
        return self.fence_margin_m + error_m

    @property
    def separation_up_m(self) -> float:
        """Least distance from other vehicles, up and down; no matter where none is kept to the side."""
        return self.separation_height_m or max(0.5 * self.separation_m, 0.5)

    def margin_text(self) -> str:
        """The margin, and how much of it is for the wind."""
        wind_m = self.margin_m - self.fence_margin_m
        return f"{self.margin_m:g} m" + (f", {wind_m:g} m of it for wind of {self.wind_m_s:g} m/s" if wind_m else "")

    def is_on_wings(self, length_m: float, by: str | None = None) -> bool:
        """Whether a way of this length is flown on wings: as asked for, or where it is longer than two transitions.

        True for what has no rotors to hover on, as far as it needs room to turn.
        """
        if self.turn_radius_m <= 0.0 or self.rotors_speed_m_s <= 0.0:
            return self.turn_radius_m > 0.0
        return by == "wings" if by is not None else length_m > 2.0 * self.transition_m


class Power(PlatformRow, frozen=True, kw_only=True):
    """The stated power model from which the energy of a mission is estimated."""

    hover_w: NotNegative
    """Power to hover (or to stay put)."""
    per_m_s_w: NotNegative = 0.0
    """More power for each metre per second of horizontal speed."""
    climb_w_per_m_s: NotNegative = 0.0
    """More power for each metre per second of climb."""
    avionics_w: NotNegative = 0.0
    """Computers and sensors, all the time."""
    battery_wh: Positive
    """Energy of the full battery."""
    reserve: Share = 0.25
    """Share of the battery that missions must leave; below it the battery counts as low."""

    wings_w: NotNegative = 0.0
    """Power to fly on wings at `survey_speed_m_s`, of what can hover, too; in place of `hover_w` and `per_m_s_w`."""

    @property
    def usable_wh(self) -> float:
        """What a mission may use."""
        return self.battery_wh * (1.0 - self.reserve)
