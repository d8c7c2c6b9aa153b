"""Odometer reports as measurements relative to references, which are kept as clones."""

from math import isfinite
from typing import Final

import numpy as np

from gloc3.messages.frames import (
    Quaternion,
    Vector3,
    conjugate,
    from_yaw,
    multiply,
    normalize,
    rotate,
    rotate_back,
    yaw_of,
)
from gloc3.messages.perception import Odometry
from gloc3_onboard.algorithms.fusion.error_state import CLONE, Matrix
from gloc3_onboard.algorithms.fusion.estimate import Past, PoseEstimate
from gloc3_onboard.algorithms.fusion.measurements import UNKNOWN_FROM, Measured, covariance_of, matrix_of, relative

_LEAST: Final = np.array((2.5e-7, 2.5e-7, 2.5e-7, 1e-8, 1e-8, 1e-8))
"""No odometer is better than 0.5 mm and 0.006 degrees."""
_FARTHEST_M: Final = 1e4
_WANDER_S: Final = 0.6
"""Time after which the errors of reports from one reference count as independent, s. In flights of 60 m in the hold it
is 0.5 to 1.3 s."""


class OdometerReport:
    """One checked report of an odometer."""

    __slots__ = ("attitude", "covariance", "drift", "is_level", "position", "reference_t_s", "shared", "source", "t_s")

    def __init__(self, message: Odometry, t_s: float, covariance: Matrix) -> None:
        self.source = message.source
        self.t_s = t_s
        self.reference_t_s = message.reference_t_s
        self.position: Vector3 = message.position_m
        self.attitude: Quaternion = normalize(message.reference_from_frd)
        self.covariance = covariance
        self.is_level = message.is_level
        self.shared = message.shared
        self.drift = message.drift


def read(message: Odometry, t_s: float) -> OdometerReport | str:
    """The report of a message; or why it cannot be used."""
    numbers = (t_s, message.reference_t_s, *message.position_m, *message.reference_from_frd)
    if not all(map(isfinite, numbers)) or max(map(abs, message.position_m)) > _FARTHEST_M:
        return "its numbers are not finite"
    if abs(sum(value * value for value in message.reference_from_frd) - 1.0) > 0.01:
        return "its rotation is none"
    if message.reference_t_s > t_s:
        return "its reference is in its future"
    covariance = covariance_of(message.covariance, 6, _LEAST)
    return "its covariance is none" if covariance is None else OdometerReport(message, t_s, covariance)


class Reference:
    """The reference pose of one odometer's reports, kept as a clone."""

    __slots__ = ("base", "granted", "reference_t_s", "reported_s")

    def __init__(self, reference_t_s: float, reported_s: float, base: tuple[Vector3, Quaternion] | None) -> None:
        self.reference_t_s = reference_t_s
        """The odometer's own reference."""
        self.reported_s = reported_s
        """The time of the last report."""
        self.base = base
        """Report that defined the pose, where that is the pose of an earlier report and not of its reference."""
        self.granted: Matrix = np.zeros(CLONE)
        """Variances that were added to the clone, for what all its reports have in common."""

    def grant(self, common: Matrix, drift: float, t_s: float) -> Matrix:
        """Variances (6,) to add to the clone for a report.

        Args:
            common: part of the report's error that is common to others; unmeasured directions get none.
            drift: factor by which that accumulates faster than independent errors.
            t_s: the time of the report: the common error has changed since the last one.
        """
        more = np.maximum(drift * common - self.granted, 0.0)
        self.granted += more
        wandered = min(t_s - self.reported_s, _WANDER_S) / _WANDER_S
        self.reported_s = t_s
        return np.where(common < 0.1 * UNKNOWN_FROM, more + common * wandered, 0.0)


class Odometers:
    """The references of all odometers, kept as clones in the estimate.

    The clone is of the reference's own time where that is still in the history. Otherwise, as for an odometer that
    counts from the start of its map, or one that is readmitted after a fault, the clone is of the first report's time,
    and later reports are relative to that report.
    """

    def __init__(self, estimate: PoseEstimate) -> None:
        self._estimate = estimate
        self._references: dict[str, Reference] = {}

    def clear(self) -> None:
        """Clears all references."""
        self._references.clear()

    def reset(self, source: str) -> None:
        """Drops a source's reference; its next report sets a new one."""
        self._references.pop(source, None)
        self._estimate.drop(source)

    def rebase(self, report: OdometerReport) -> None:
        """Makes this report the reference of the later ones."""
        estimate = self._estimate
        estimate.remember(report.source, report.t_s)
        base = (report.position, report.attitude)
        reference = Reference(report.reference_t_s, report.t_s, base)
        self._references[report.source] = reference
        more = reference.grant(report.covariance.diagonal(), 1.0, report.t_s)
        self._loosen(report.source, more, from_yaw(0.0), report.attitude)

    def measure(self, report: OdometerReport, past: Past) -> Measured | None:
        """A report as a measurement; None if it only sets a reference or measures nothing.

        Args:
            report: the report.
            past: the believed pose at its time.
        """
        reference = self._references.get(report.source)
        if reference is None or abs(reference.reference_t_s - report.reference_t_s) > 1e-6:
            begun = self._begin(report)
            if begun is None:
                return None
            reference = begun
        position, attitude = self._estimate.clones[report.source]
        reported, covariance, is_level = (report.position, report.attitude), report.covariance, report.is_level
        if reference.base is not None:
            reported, covariance, is_level = _since(reference.base, report)
        axes = from_yaw(yaw_of(attitude)) if is_level else attitude
        state = past.state
        # White part of the noise: (1 - shared) C; the shared part goes into the clone's covariance, once.
        measured = relative(
            (position, attitude),
            axes,
            (state.position_ned_m, state.ned_from_frd),
            reported,
            covariance * (1.0 - report.shared),
            is_level=is_level,
        )
        if measured is None:
            return None
        more = reference.grant(report.shared * covariance.diagonal(), report.drift, report.t_s)
        self._loosen(report.source, more, axes, state.ned_from_frd)
        return measured

    def _begin(self, report: OdometerReport) -> Reference | None:
        if not self._estimate.inertial.covers(report.reference_t_s) or report.reference_t_s < self._estimate.sound_s:
            self.rebase(report)
            return None
        self._estimate.remember(report.source, report.reference_t_s)
        reference = Reference(report.reference_t_s, report.t_s, None)
        self._references[report.source] = reference
        return reference

    def _loosen(self, source: str, more: Matrix, axes: Quaternion, ned_from_frd: Quaternion) -> None:
        """Lets the clone be as wrong as the reports have their error in common."""
        errors = self._estimate.errors
        first = errors.place_of(source)
        place, body = matrix_of(axes), matrix_of(ned_from_frd)
        errors.loosen(first, (place * more[:3]) @ place.T)
        errors.loosen(first + 3, (body * more[3:]) @ body.T)


def _since(base: tuple[Vector3, Quaternion], report: OdometerReport) -> tuple[tuple[Vector3, Quaternion], Matrix, bool]:
    """What two reports from one reference say of the motion between them, in the body's axes at the first."""
    # Difference of two reports: A^T (p - b) and A^T Z, with the first attitude A.
    (bx, by, bz), attitude = base
    x, y, z = report.position
    back = conjugate(attitude)
    reported = (rotate_back(attitude, (x - bx, y - by, z - bz)), normalize(multiply(back, report.attitude)))
    turn = np.eye(6)
    turn[:3, :3] = matrix_of(back)
    return reported, turn @ report.covariance @ turn.T, False


def axes_of(report: OdometerReport, ned_from_frd: Quaternion) -> Quaternion:
    """Rotation from a report's axes to NED, by the attitude of the body at its time.

    Level axes stay level: with a tilt of a tenth of a degree, what is unknown of the height would hide the horizontal
    motion.
    """
    axes = multiply(ned_from_frd, conjugate(report.attitude))
    return from_yaw(yaw_of(axes)) if report.is_level else axes


def source_of(
    before: OdometerReport, report: OdometerReport, ned_from_frd: Quaternion
) -> tuple[float, Vector3, bool] | None:
    """Motion of a source since its previous report: start time, displacement in NED, whether it has a new reference.

    The axes of the reference are derived from the present estimated attitude, so earlier reports of the source have no
    effect.
    """
    axes = multiply(ned_from_frd, conjugate(report.attitude))
    (x, y, z) = report.position
    if abs(before.reference_t_s - report.reference_t_s) <= 1e-6:
        bx, by, bz = before.position
        return before.t_s, rotate(axes, (x - bx, y - by, z - bz)), False
    if abs(report.reference_t_s - before.t_s) > 0.5:
        return None
    return report.reference_t_s, rotate(axes, (x, y, z)), True
