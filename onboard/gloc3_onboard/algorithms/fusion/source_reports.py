"""Motion reported by each source less the estimated one: the input of the vote."""

from gloc3.messages.frames import Vector3, conjugate, multiply
from gloc3_onboard.algorithms.fusion.error_state import Matrix
from gloc3_onboard.algorithms.fusion.fault_isolation import FaultIsolation
from gloc3_onboard.algorithms.fusion.inertial import Inertial, InertialState
from gloc3_onboard.algorithms.fusion.odometers import OdometerReport, source_of


class SourceReports:
    """Records the reports of all sources for the vote."""

    def __init__(self, inertial: Inertial, isolation: FaultIsolation) -> None:
        self._inertial, self._isolation = inertial, isolation
        self._reports: dict[str, OdometerReport] = {}
        self._places: dict[str, tuple[float, Vector3]] = {}

    def clear(self) -> None:
        """Clears the last reports."""
        self._reports.clear()
        self._places.clear()

    def book_motion(self, report: OdometerReport, state: InertialState) -> None:
        """Records an odometer's report, with the estimated state at its time."""
        before = self._reports.get(report.source)
        self._reports[report.source] = report
        record = self._isolation.record(report.source)
        if before is None:
            return
        reported = source_of(before, report, state.ned_from_frd)
        if reported is None or not self._inertial.covers(reported[0]):
            record.reset()
            return
        since_s, shift, is_new = reported
        axes = multiply(state.ned_from_frd, conjugate(report.attitude))
        # Excess: reported less estimated motion over the same interval, in NED.
        excess = _minus(shift, self._believed(since_s, state))
        record.add(report.t_s, excess, report.covariance[:3, :3], axes, is_new_reference=is_new)

    def book_place(self, source: str, position_ned_m: Vector3, covariance: Matrix, state: InertialState) -> None:
        """Records an absolute position, with the estimated state at its time."""
        before = self._places.get(source)
        self._places[source] = (state.t_s, position_ned_m)
        record = self._isolation.record(source)
        record.is_of_places = True
        if before is None:
            return
        if not self._inertial.covers(before[0]):
            record.reset()
            return
        shift = _minus(position_ned_m, before[1])
        record.add(state.t_s, _minus(shift, self._believed(before[0], state)), covariance)

    def _believed(self, since_s: float, state: InertialState) -> Vector3:
        return _minus(state.position_ned_m, self._inertial.at(since_s).position_ned_m)


def _minus(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
