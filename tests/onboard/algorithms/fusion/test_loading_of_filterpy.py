"""filterpy is loaded without its statistics, and is whole for others that use it in the same process."""

import subprocess
import sys

PROGRAM = """
import sys
import numpy as np
from gloc3_onboard.algorithms.fusion.error_state import ErrorState
ErrorState()
assert "filterpy.kalman" in sys.modules
assert not {"filterpy.stats", "scipy.stats"} & set(sys.modules)
from filterpy.kalman import KalmanFilter
plain = KalmanFilter(dim_x=1, dim_z=1)
plain.H = np.eye(1)
plain.update([1.0])
assert plain.log_likelihood < 0.0
assert "scipy.stats" in sys.modules
"""


def test_pose_fusion_loads_no_statistics_and_leaves_filterpy_whole() -> None:
    ended = subprocess.run([sys.executable, "-W", "error", "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
