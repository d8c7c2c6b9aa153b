"""Motion reported by each source less the estimated one: the input of the vote."""

from collections import deque
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.fusion.error_state import Matrix
from gloc3_onboard.algorithms.fusion.fault_isolation import FaultIsolation
from gloc3_onboard.algorithms.fusion.inertial import Inertial, InertialState
from gloc3_onboard.algorithms.fusion.measurements import CHI2_999, matrix_of
from gloc3_onboard.algorithms.fusion.odometers import OdometerReport, axes_of, source_of


class PlaceReport(NamedTuple):
    """One absolute position."""

    source: str
    t_s: float
    position_ned_m: Vector3
    covariance: Matrix


Report = OdometerReport | PlaceReport


class SourceReports:
    """Records the reports of all sources for the vote."""

    def __init__(self, inertial: Inertial, isolation: FaultIsolation) -> None:
        self._inertial, self._isolation = inertial, isolation
        self._booked: dict[str, Report] = {}
        """The last report of each source in its record."""
        self._last: dict[str, Report] = {}
        self._offsets: dict[str, deque[Vector3]] = {}
        """Offsets of the last three reports of each source from the estimate, in NED, but for a constant."""

    def clear(self) -> None:
        """Clears the last reports."""
        self._booked.clear()
        self._last.clear()
        self._offsets.clear()

    def follow(self, report: Report, state: InertialState) -> None:
        """Follows where the reports of a source lead to, also those that are not used.

        Args:
            report: the report.
            state: the estimated state at its time.
        """
        found = self._excess(self._last.get(report.source), report, state)
        self._last[report.source] = report
        offsets = self._offsets.setdefault(report.source, deque(maxlen=3))
        (n, e, d), (x, y, z) = found[0] if found is not None else (0.0, 0.0, 0.0), offsets[-1] if offsets else _HERE
        if found is None:
            offsets.clear()
        offsets.append((x + n, y + e, z + d))

    def is_steady(self, report: Report, state: InertialState) -> bool:
        """Whether a report that was followed is where the two before it lead to, by its covariance.

        An error that stays, or that grows as a wrong motion lets it grow, leaves three reports in a row on a line beside
        the estimate. An outlier does not, and three of them hardly ever do.
        """
        offsets = self._offsets[report.source]
        if len(offsets) < 3:
            return False
        # Second difference b of three reports of covariance C: b^T (6 C)^-1 b against chi-square, 3 degrees of freedom.
        bend = np.array(offsets[2]) - 2.0 * np.array(offsets[1]) + np.array(offsets[0])
        return float(bend @ np.linalg.solve(6.0 * _in_ned(report, state), bend)) <= CHI2_999[3]

    def book(self, report: Report, state: InertialState) -> None:
        """Records a report, with the estimated state at its time."""
        before = self._booked.get(report.source)
        self._booked[report.source] = report
        record = self._isolation.record(report.source)
        record.is_of_places = isinstance(report, PlaceReport)
        if before is None:
            return
        found = self._excess(before, report, state)
        if found is None:
            record.reset()
        elif isinstance(report, PlaceReport):
            record.add(report.t_s, found[0], report.covariance)
        else:
            axes = axes_of(report, state.ned_from_frd)
            record.add(report.t_s, found[0], report.covariance[:3, :3], axes, is_new_reference=found[1])

    def _excess(self, before: Report | None, report: Report, state: InertialState) -> tuple[Vector3, bool] | None:
        """Reported less estimated motion since a report before, in NED, and whether it has a new reference."""
        if isinstance(report, PlaceReport):
            if not isinstance(before, PlaceReport):
                return None
            since_s, is_new = before.t_s, False
            shift = _minus(report.position_ned_m, before.position_ned_m)
        else:
            reported = source_of(before, report, state.ned_from_frd) if isinstance(before, OdometerReport) else None
            if reported is None:
                return None
            since_s, shift, is_new = reported
        if not self._inertial.covers(since_s):
            return None
        believed = _minus(self._inertial.path_at(report.t_s), self._inertial.path_at(since_s))
        return _minus(shift, believed), is_new


def _in_ned(report: Report, state: InertialState) -> Matrix:
    """Covariance of the reported position, (3, 3)."""
    if isinstance(report, PlaceReport):
        return report.covariance
    axes = matrix_of(axes_of(report, state.ned_from_frd))
    return np.asarray(axes @ report.covariance[:3, :3] @ axes.T, dtype=np.float64)


_HERE: Final[Vector3] = (0.0, 0.0, 0.0)


def _minus(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
