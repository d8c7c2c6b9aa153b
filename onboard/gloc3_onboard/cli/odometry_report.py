"""Common end of the `gloc3 odometry` commands: writes the estimate, compares it with the truth, prints the errors."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter

from gloc3.cli.narration import narrate
from gloc3.errors import Refused
from gloc3.evaluation.metrics import Evaluation, Statistics, TrajectoryAlignment, evaluate, names_a_frame
from gloc3.evaluation.trajectory import Array, Trajectory, read_trajectory, write_tum

ON_A_LINE = (
    "laid over          by the first pose: the first tenth lies in one place or along one line (--align all|begin|none)"
)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """The options that all odometry commands share."""

    truth: Path | None = None
    """True poses: in TUM form, EuRoC's (data.csv) or KITTI's (poses.txt)."""
    trajectory: Path | None = None
    """Where to write the estimate, in TUM form, with the data set's own times."""
    align: TrajectoryAlignment | None = None
    """How the estimate is laid over the truth: by the first tenth of its positions (begin), all, the first pose (origin)
    or not at all (none). The scale is never corrected. Default: begin; origin where these positions lie in one place or
    along one line."""
    over: float = 10.0
    """Length of the stretches of the relative error, in metres."""
    json: Annotated[bool, Parameter(negative=())] = False
    """Print JSON for programs."""

    def check(self) -> None:
        """Checks the options before a long run.

        Raises:
            Refused: an option is out of range, there is no such truth, or the trajectory cannot be written there.
        """
        if not 0.0 < self.over < float("inf"):
            raise Refused("--over must be above 0 metres")
        if self.truth is not None and not self.truth.is_file():
            raise Refused(
                f"--truth {self.truth}: {'it is a folder' if self.truth.is_dir() else 'there is no such file'}"
            )
        if self.trajectory is not None and (self.trajectory.is_dir() or not self.trajectory.absolute().parent.is_dir()):
            is_folder = self.trajectory.is_dir()
            reason = "it is a folder" if is_folder else f"there is no folder {self.trajectory.parent}"
            raise Refused(f"--trajectory {self.trajectory}: {reason}")


class Cost(msgspec.Struct, frozen=True, kw_only=True):
    """Inputs of a run: used, refused, and what they cost."""

    inputs: int
    """Pictures, pairs of pictures, or scans."""
    valid: int
    """Number of valid outputs."""
    mean_ms: float = 0.0
    """Mean wall time of one output, ms."""
    worst_ms: float = 0.0
    reasons: dict[str, int] = {}
    """Why outputs were not valid, and how often."""


def report(
    estimate: Trajectory,
    options: ReportOptions,
    cost: Cost | None = None,
    times_s: Array | None = None,
    truth: Trajectory | None = None,
) -> int:
    """Writes and prints the requested reports.

    Args:
        estimate: the odometer's trajectory.
        options: the user's options.
        cost: cost of the run.
        times_s: times of the data set's inputs, for a truth without times.
        truth: the truth, if not in a form that all commands read.

    Returns:
        The exit code: 1 where no output was valid.

    Raises:
        Refused: an option is out of range, or the truth does not belong to the estimate.
        InputError: the truth cannot be read.
    """
    if options.trajectory is not None:
        write_tum(estimate, options.trajectory)
    found, notes = None, list[str]()
    if options.truth is not None:
        known = truth or read_trajectory(options.truth, times_s)
        align = options.align or TrajectoryAlignment.BEGIN
        if options.align is None and not names_a_frame(estimate, known, align):
            align = TrajectoryAlignment.ORIGIN
        found = evaluate(estimate, known, align, options.over)
        notes = [] if align is options.align or align is TrajectoryAlignment.BEGIN else [ON_A_LINE]
    print(_json(estimate, found, cost) if options.json else "\n".join(_lines(estimate, found, cost) + notes))  # noqa: T201
    if cost is not None and cost.valid == 0:
        narrate("no output was valid")
        return 1
    return 0


def _json(estimate: Trajectory, found: Evaluation | None, cost: Cost | None) -> str:
    whole = {"poses": len(estimate), "path_m": _path_m(estimate), "run": cost, "errors": found}
    return msgspec.json.format(msgspec.json.encode(whole)).decode()


def _lines(estimate: Trajectory, found: Evaluation | None, cost: Cost | None) -> list[str]:
    lines = [f"estimate           {len(estimate)} poses, {_path_m(estimate):.3f} m"]
    if cost is not None:
        lines.append(f"inputs             {cost.inputs}, {cost.valid} with a valid output")
        lines += [f"  not valid        {count} times: {reason}" for reason, count in cost.reasons.items()]
        if cost.worst_ms > 0.0:
            lines.append(f"time for one       mean {cost.mean_ms:.2f} ms, worst {cost.worst_ms:.2f} ms")
    return lines + (_error_lines(found) if found is not None else [])


def _error_lines(found: Evaluation) -> list[str]:
    lines = [
        f"truth              {found.poses} poses in common, {found.path_m:.3f} m in {found.duration_s:.2f} s",
        f"absolute (ATE)     {_text(found.absolute_m, 'm')}; {100.0 * found.absolute_share:.3f} % of the path",
        f"  attitude         {_text(found.absolute_deg, 'deg')}",
        f"  at the end       {found.end_m:.4f} m",
    ]
    title = f"relative, {found.relative_over_m:g} m"
    if found.relative_m is None or found.relative_deg is None:
        return [*lines, f"{title:<19}the path is too short for it"]
    return [
        *lines,
        f"{title:<19}{_text(found.relative_m, 'm')}; {100.0 * found.relative_m.rms / found.relative_over_m:.3f} %",
        f"  attitude         {_text(found.relative_deg, 'deg')}",
    ]


def _text(errors: Statistics, unit: str) -> str:
    return f"rms {errors.rms:.4f} mean {errors.mean:.4f} median {errors.median:.4f} max {errors.max:.4f} {unit}"


def _path_m(trajectory: Trajectory) -> float:
    return float(trajectory.distances_m[-1]) if len(trajectory) else 0.0
