"""Reports of one odometer composed into a pose."""

from typing import Final

from gloc3.messages.frames import (
    IDENTITY,
    Quaternion,
    Vector3,
    conjugate,
    from_yaw,
    multiply,
    normalize,
    rotate,
    yaw_of,
)
from gloc3.messages.perception import Odometry

_GOES_ON_S: Final = 2.0
_SMOOTHING_S: Final = 0.3


class OdometryChain:
    """Composes motions that are reported relative to past poses.

    Over a gap, after which an odometer starts with a new reference, the body is assumed to continue with its previous
    velocity and turn rate, for two seconds.

    Args:
        position_m: Position of the body at the first report.
        attitude: Its attitude then, in the axes of `position_m`, the third of which points down.
    """

    def __init__(self, position_m: Vector3 = (0.0, 0.0, 0.0), attitude: Quaternion = IDENTITY) -> None:
        self.position_m = position_m
        """Position at the last report, even if that measured nothing."""
        self.attitude = attitude
        self._poses: dict[float, tuple[Vector3, Quaternion]] = {}
        self._speed_m_s: Vector3 = (0.0, 0.0, 0.0)
        self._yaw_rad_s = 0.0
        """How fast the heading changes, smoothed."""
        self._known: tuple[float, Vector3, Quaternion] | None = None
        """Time of the last known pose or new reference, and the pose."""

    def add(self, report: Odometry, t_s: float) -> bool:
        """Adds a report; true if it determines the pose at its time: it is valid, or the first."""
        is_first = self._known is None
        if not report.is_valid:
            self.position_m, self.attitude = self._ahead(t_s)
            if is_first or report.reference_t_s == t_s:
                self._begin(t_s)
            return is_first
        if report.reference_t_s not in self._poses:
            self._begin(report.reference_t_s)
        # Compose: T_now = T_reference T_report; a level report turns with the reference's heading alone.
        position, attitude = self._poses[report.reference_t_s]
        axes = from_yaw(yaw_of(attitude)) if report.is_level else attitude
        moved = rotate(axes, report.position_m)
        place = (position[0] + moved[0], position[1] + moved[1], position[2] + moved[2])
        self._arrive(place, normalize(multiply(axes, report.reference_from_frd)), t_s)
        # No motion is ever told from before the last one's reference.
        self._poses = {then_s: pose for then_s, pose in self._poses.items() if then_s >= report.reference_t_s}
        self._poses[t_s] = (self.position_m, self.attitude)
        return True

    def _begin(self, t_s: float) -> None:
        """The pose of a time that no motion leads to."""
        place, attitude = self._ahead(t_s)
        self._known = (t_s, place, attitude)
        self._poses[t_s] = (place, attitude)

    def _arrive(self, place: Vector3, attitude: Quaternion, t_s: float) -> None:
        assert self._known is not None
        then_s, (x, y, z), before = self._known
        if t_s > then_s:
            after_s = t_s - then_s
            self._speed_m_s = ((place[0] - x) / after_s, (place[1] - y) / after_s, (place[2] - z) / after_s)
            turned = yaw_of(multiply(attitude, conjugate(before)))
            self._yaw_rad_s += min(after_s / _SMOOTHING_S, 1.0) * (turned / after_s - self._yaw_rad_s)
        self.position_m, self.attitude, self._known = place, attitude, (t_s, place, attitude)

    def _ahead(self, t_s: float) -> tuple[Vector3, Quaternion]:
        if self._known is None:
            return self.position_m, self.attitude
        then_s, (x, y, z), attitude = self._known
        # Bridge a gap at constant velocity and yaw rate, for two seconds at most.
        after_s = min(max(t_s - then_s, 0.0), _GOES_ON_S)
        u, v, w = self._speed_m_s
        return (x + u * after_s, y + v * after_s, z + w * after_s), multiply(
            from_yaw(self._yaw_rad_s * after_s), attitude
        )
