"""What the body may have done between two scans: constant velocity, within the accelerations of its class."""

from typing import Annotated, Final, NamedTuple

from gloc3.component.settings import Bounds, Settings
from gloc3.messages.frames import wrap_pi
from gloc3_onboard.algorithms.scan_matching.correlative import PRIOR, SearchWindow
from gloc3_onboard.algorithms.scan_matching.planar import Planar

LONGEST_S: Final = 2.0
"""A velocity is not believed for longer."""
REPORTED_M: Final = 0.1
REPORTED_SHARE: Final = 0.15
REPORTED_RAD: Final = 0.1
REPORTED_TURN_SHARE: Final = 0.5
"""Largest error of a motion reported by others: absolute, and as a share of distance and turn."""
REPORTED_PRIOR: Final = 0.05
"""Wheels slip, and their window is small."""
FIRST_M_S: Final = 1.0
FIRST_RAD_S: Final = 0.5
"""The first motion of all is about so fast at most."""
SLACK_M: Final = 0.1
SLACK_RAD: Final = 0.06
"""A match may lie so far outside of the window: errors of the matches before, which the velocity has inherited."""


class MotionModelSettings(Settings, frozen=True):
    """How the body can move."""

    acceleration_m_s2: Annotated[float, Bounds(0.1, 50.0)] = 3.0
    """Largest acceleration, m/s²."""
    turn_acceleration_rad_s2: Annotated[float, Bounds(0.1, 100.0)] = 6.0
    """Largest turn acceleration, rad/s²."""
    speed_m_s: Annotated[float, Bounds(0.1, 100.0)] = 20.0
    """Largest speed, m/s."""
    turn_rate_rad_s: Annotated[float, Bounds(0.1, 50.0)] = 6.0
    """Largest turn rate, rad/s."""
    stamp_jitter_s: Annotated[float, Bounds(0.0, 1.0)] = 0.1
    """How wrong the time between two scans may be, s."""
    search_m: Annotated[float, Bounds(0.1, 5.0)] = 2.0
    """Largest distance from the expected place that is searched, m."""
    search_rad: Annotated[float, Bounds(0.1, 3.2)] = 3.14
    """Largest turn from the expected heading that is searched, rad."""


class Expected(NamedTuple):
    """The motion that is expected since the last good scan."""

    motion: Planar
    window: SearchWindow
    """How wrong that may be."""
    limit: SearchWindow
    """How far away from it a match is still plausible."""
    prior: float
    """What a match at the edge of the window must fit better than one in its middle, as a share of the scan."""

    def allows(self, motion: Planar) -> bool:
        """Whether the body can have moved so."""
        off = self.motion.inverse() @ motion
        return off.distance_m <= self.limit.distance_m and abs(off.yaw_rad) <= self.limit.heading_rad


class MotionModel:
    """The velocity of the body, on its own axes, and what follows for the next scan."""

    def __init__(self, settings: MotionModelSettings) -> None:
        self._settings = settings
        self.velocity: Planar | None = None
        """Per second; None if unknown."""

    def update(self, step: Planar, duration_s: float) -> None:
        """Learns from a motion: its velocity, as far as the body can have got from the one before to it.

        Over a short time, which the stamps may have wrong, that is little.
        """
        settings, before, now = self._settings, self.velocity, step.part(1.0 / duration_s)
        if before is not None:
            most_m_s = settings.acceleration_m_s2 * duration_s
            most_rad_s = settings.turn_acceleration_rad_s2 * duration_s
            now = _nearest(now, before, SearchWindow(most_m_s, most_rad_s))
        self.velocity = now

    def expected(self, duration_s: float, reported: Planar | None, turn_rad: float | None) -> Expected:
        """What the body has probably done, and what it may have done.

        Args:
            duration_s: since the last good scan.
            reported: motion in that time, by others.
            turn_rad: turn in that time, by inertial sensors.
        """
        settings, velocity = self._settings, self.velocity
        # Constant velocity, within a window of a dt^2 / 2; a reported motion or heading may replace it.
        half_square = 0.5 * duration_s * duration_s
        distance_m = settings.acceleration_m_s2 * half_square
        heading_rad = settings.turn_acceleration_rad_s2 * half_square
        possible = SearchWindow(distance_m, heading_rad)
        motion, prior = Planar(), PRIOR
        if velocity is not None:
            motion = velocity.part(min(duration_s, LONGEST_S))
        else:
            distance_m += FIRST_M_S * duration_s
            heading_rad += FIRST_RAD_S * duration_s
        if reported is not None and distance_m > REPORTED_M:
            motion, prior = reported, REPORTED_PRIOR
            distance_m = REPORTED_M + REPORTED_SHARE * motion.distance_m
            heading_rad = REPORTED_RAD + REPORTED_TURN_SHARE * abs(motion.yaw_rad)
        elif reported is not None:  # over a short time nobody knows better than the last motion, and the accelerations
            motion = _nearest(reported, motion, possible)
        if turn_rad is not None:
            motion = Planar(motion.x_m, motion.y_m, wrap_pi(turn_rad))
            heading_rad = REPORTED_RAD
        elif velocity is not None:
            heading_rad += settings.stamp_jitter_s * abs(velocity.yaw_rad)
        if velocity is not None:
            distance_m += settings.stamp_jitter_s * velocity.distance_m
        window = SearchWindow(min(distance_m, settings.search_m), min(heading_rad, settings.search_rad))
        # Wheels slip: where others report the motion, what is possible counts, and not only what they may have wrong.
        if turn_rad is None:
            heading_rad = max(heading_rad, possible.heading_rad)
        distance_m, span_s = max(distance_m, possible.distance_m), duration_s + settings.stamp_jitter_s
        limit = SearchWindow(
            min(distance_m, settings.speed_m_s * span_s) + SLACK_M,
            min(heading_rad, settings.turn_rate_rad_s * span_s) + SLACK_RAD,
        )
        return Expected(motion, window, limit, prior)


def _nearest(motion: Planar, center: Planar, window: SearchWindow) -> Planar:
    """A motion, or what is nearest to it within a window around another."""
    x, y, turn = motion.x_m - center.x_m, motion.y_m - center.y_m, motion.yaw_rad - center.yaw_rad
    share = min(1.0, window.distance_m / max(Planar(x, y).distance_m, 1e-9))
    turn = max(-window.heading_rad, min(turn, window.heading_rad))
    return Planar(center.x_m + share * x, center.y_m + share * y, center.yaw_rad + turn)
