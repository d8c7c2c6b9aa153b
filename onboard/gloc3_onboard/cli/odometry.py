"""The commands `gloc3 odometry`: the odometers alone, on data sets, compared with the truth."""

from pathlib import Path

from cyclopts import App

from gloc3.errors import Refused
from gloc3.evaluation.trajectory import read_trajectory
from gloc3_onboard.cli.odometry_ground import ground
from gloc3_onboard.cli.odometry_laser import laser
from gloc3_onboard.cli.odometry_report import ReportOptions, report
from gloc3_onboard.cli.odometry_stereo import stereo

app = App(
    name="gloc3 odometry",
    help="""Run an odometer on a data set, and compare a trajectory with the truth.

    Errors are those of the tool evo: the absolute trajectory error after a rigid alignment, without correction of the
    scale, and the relative error over stretches of a length. Exit codes: 0 done, 1 no output was valid, 2 wrong use or
    a data set that cannot be read.

    For example, with data sets that the simulation makes:

    - `gloc3 sitl record euroc hold` and `gloc3 odometry stereo hold --truth hold/mav0/state_groundtruth_estimate0/data.csv`
    - `gloc3 sitl record carmen hold.log` and `gloc3 odometry laser hold.log --truth hold.log --trajectory out.txt`
    - `gloc3 odometry compare out.txt --truth poses.txt --over 100 --json`""",
    help_format="markdown",
    version_flags=[],
)


@app.command
def compare(estimate: Path, /, *, options: ReportOptions | None = None) -> int:
    """Compare a trajectory that is there already with the truth.

    Args:
        estimate: The trajectory, in TUM form, EuRoC's or KITTI's.
        options: What to compare with, and how.
    """
    options = options or ReportOptions()
    options.check()
    if not estimate.is_file():
        raise Refused(f"{estimate}: {'it is a folder' if estimate.is_dir() else 'there is no such file'}")
    return report(read_trajectory(estimate), options)


app.command(ground)
app.command(laser)
app.command(stereo)
