"""Reports of one odometer put end to end: where it believes the body is."""

from gloc3.frames import IDENTITY, Quaternion, Vector3, from_yaw, multiply, normalize, rotate, yaw_of
from gloc3.perception import Odometry

_KEPT_S = 30.0
"""A report may be told from a moment at most so long ago."""


class OdometryChain:
    """Adds up motions that are told from moments of the past.

    Args:
        position_m: Where the body is at the first report.
        attitude: How it is turned then: on the axes of `position_m`, the third of which points down.
    """

    def __init__(self, position_m: Vector3 = (0.0, 0.0, 0.0), attitude: Quaternion = IDENTITY) -> None:
        self.position_m = position_m
        self.attitude = attitude
        self._poses: dict[float, tuple[Vector3, Quaternion]] = {}

    def add(self, report: Odometry, t_s: float) -> bool:
        """Takes a report of a time.

        Returns:
            Whether there is a pose of that time: the report is valid, or the first. Motion that no report tells of is
            missing from all that follows.
        """
        if not report.is_valid:
            is_first = not self._poses
            if is_first or report.reference_t_s == t_s:
                self._poses[t_s] = (self.position_m, self.attitude)
            return is_first
        position, attitude = self._poses.setdefault(report.reference_t_s, (self.position_m, self.attitude))
        axes = from_yaw(yaw_of(attitude)) if report.is_level else attitude
        moved = rotate(axes, report.position_m)
        self.position_m = (position[0] + moved[0], position[1] + moved[1], position[2] + moved[2])
        self.attitude = normalize(multiply(axes, report.reference_from_frd))
        self._poses[t_s] = (self.position_m, self.attitude)
        for old_s in [old_s for old_s in self._poses if old_s < t_s - _KEPT_S]:
            del self._poses[old_s]
        return True
