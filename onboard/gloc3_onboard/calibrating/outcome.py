"""Common end of the calibrations: printed, drawn, judged, and written with its date unless it is not trustworthy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from gloc3.cli.narration import ERROR, narrate
from gloc3.clock import utc_now
from gloc3.errors import Refused
from gloc3_onboard.calibration.rig_file import read_sections, write_sections

WRITTEN: Final = 0
NOT_TRUSTED: Final = 1


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OutcomeOptions:
    """The options that all calibrations share."""

    rig: Path = Path("rig.yaml")
    """The rig file that is written; other sections in it stay."""
    report: Path | None = None
    """Where to draw residuals and coverage, as SVG."""
    force: Annotated[bool, Parameter(negative=())] = False
    """Write a result that is not trustworthy, too."""

    def check(self) -> None:
        """Checks the options before a long run.

        Raises:
            Refused: a file cannot be written there.
            InputError: there is a file that is no rig file.
        """
        for name, path in (("--rig", self.rig), ("--report", self.report)):
            if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
                reason = "it is a folder" if path.is_dir() else f"there is no folder {path.parent}"
                raise Refused(f"{name} {path}: {reason}")
        if self.report is not None and self.report.suffix != ".svg":
            raise Refused(f"--report {self.report}: the report is an SVG; name a file that ends in .svg")
        read_sections(self.rig)


@dataclass(frozen=True, kw_only=True)
class CalibrationOutcome:
    """A calibration as it is shown and written."""

    lines: Sequence[str]
    """For people."""
    sections: Mapping[str, Mapping[str, Any]]
    """For the rig file."""
    doubts: Sequence[str]
    """Why it is not trustworthy; empty if it is."""
    drawing: str = ""
    """The report, as SVG."""
    hints: Sequence[str] = field(default_factory=tuple)
    """What to do with it."""
    drop: Sequence[str] = ()
    """Entries of the rig file that do not hold any longer."""


def today() -> str:
    """The date, as it is written into rig files."""
    return utc_now().strftime("%Y-%m-%d")


def settle(outcome: CalibrationOutcome, options: OutcomeOptions) -> int:
    """Prints a calibration, draws it, and writes it if it may be.

    Returns:
        The exit code: 1 where it is not trustworthy, and not forced.
    """
    print("\n".join(outcome.lines))  # noqa: T201
    if options.report is not None:
        options.report.write_text(outcome.drawing, encoding="utf-8")
        narrate(f"drawn in {options.report}")
    for doubt in outcome.doubts:
        narrate(f"not trustworthy: {doubt}", ERROR)
    if outcome.doubts and not options.force:
        narrate(f"{options.rig} is not written; take more data, or write it all the same with --force", ERROR)
        return NOT_TRUSTED
    write_sections(options.rig, outcome.sections, outcome.drop)
    narrate("\n".join([f"written into {options.rig}: {', '.join(outcome.sections)}", *outcome.hints]))
    return WRITTEN
