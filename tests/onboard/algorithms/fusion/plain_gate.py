"""The plain filter that the fusion is compared with: the same states, models and noises, and one chi-square gate.

Each measurement that passes 99.9 % of its innovation's distribution is used, each other one is dropped. There is no record
of a source, no vote and no doubt. Its pose is always valid.
"""

from gloc3.messages.vehicle import Pose
from gloc3_onboard.algorithms.fusion.error_state import Matrix
from gloc3_onboard.algorithms.fusion.estimate import Past
from gloc3_onboard.algorithms.fusion.measurements import CHI2_999, Measured
from gloc3_onboard.algorithms.fusion.pose_fusion import IMU, PoseFusion
from gloc3_onboard.algorithms.fusion.source_reports import Report
from gloc3_onboard.algorithms.fusion.trust import Trust


class PlainGate(PoseFusion):
    """Gates each measurement by itself."""

    def _judge(self, trust: Trust, measured: Measured, rows: Matrix, past: Past, report: Report | None = None) -> bool:
        innovation = self.estimate.errors.test(measured.residual, rows, measured.noise)
        if not innovation <= CHI2_999[measured.degrees]:
            return False
        self.estimate.correct(measured.residual, rows, measured.noise)
        return True

    def tick(self, now_s: float) -> None:
        """Nothing is watched."""
        for name, trust in self._voting.trust.items():
            if name != IMU:
                trust.let_in()

    def pose(self) -> Pose:
        """The pose as it is believed."""
        inertial = self.estimate.inertial
        return Pose(
            position_ned_m=self.estimate.reported_ned_m,
            velocity_ned_m_s=inertial.now.velocity_ned_m_s,
            ned_from_frd=inertial.now.ned_from_frd,
            position_std_m=self.estimate.position_std_m,
            is_valid=True,
        )
