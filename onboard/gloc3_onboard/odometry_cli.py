"""The commands `gloc3 odometry`: the odometers alone, on data sets, against the truth."""

from pathlib import Path

from cyclopts import App

from gloc3.trajectory import read_trajectory
from gloc3_onboard.odometry_ground import ground
from gloc3_onboard.odometry_laser import laser
from gloc3_onboard.odometry_report import ReportOptions, report
from gloc3_onboard.odometry_stereo import stereo

app = App(
    name="gloc3 odometry",
    help="""Run an odometer on a data set, and compare a trajectory with the truth.

    Errors are those of the tool evo: the absolute trajectory error after a rigid alignment, without correction of the
    scale, and the relative error over stretches of a length.""",
    help_format="markdown",
    version_flags=[],
)


@app.command
def compare(estimate: Path, /, *, options: ReportOptions | None = None) -> int:
    """Compare a trajectory that is there already with the truth.

    Args:
        estimate: the trajectory, in TUM form, EuRoC's or KITTI's.
        options: what to compare with, and how.
    """
    return report(read_trajectory(estimate), options or ReportOptions())


app.command(ground)
app.command(laser)
app.command(stereo)
