"""`gloc3 calibrate magnetometer`: hard and soft iron, by turning the vehicle."""

from pathlib import Path
from typing import Final

import numpy as np

from gloc3.cli.narration import narrate
from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import Floats
from gloc3_onboard.algorithms.calibration.ellipsoid import LEAST_SHARE, EllipsoidFit, fit_ellipsoid
from gloc3_onboard.calibrating.compass_parameters import (
    ardupilot_parameters,
    check_parameter_file,
    px4_parameters,
    write_parameters,
)
from gloc3_onboard.calibrating.drawing import DiagramPanel, PanelSeries, svg
from gloc3_onboard.calibrating.field_readings import is_link, listen, read_readings
from gloc3_onboard.calibrating.outcome import WRITTEN, CalibrationOutcome, OutcomeOptions, settle, today

SECTION: Final = "magnetometer"
MOST_AFTER: Final = 0.03
"""Standard deviation of the calibrated strength, as a share of the field: 3 % is a heading error of up to 2 degrees."""
MOST_OFFSET_STD: Final = 0.02
MOST_RATIO: Final = 2.0
FIELD_GAUSS: Final = (0.2, 0.7)
"""Of the Earth: from the South Atlantic to the poles, with a margin."""
BAR: Final = 20


def magnetometer(
    source: str,
    /,
    *,
    seconds: float = 180.0,
    parameters: Path | None = None,
    rotation: int = 0,
    options: OutcomeOptions | None = None,
) -> int:
    """Calibrate a magnetometer: turn the vehicle about all its axes, away from steel, with everything mounted.

    Live, it shows how to turn next, and ends when enough has been shown, or with Ctrl-C. The readings are used as they
    come: for PX4 and ArduPilot set the autopilot's own calibration to none first, if the result is to replace it.

    For example `gloc3 calibrate magnetometer serial:///dev/ttyACM0:115200`, or from a log
    `gloc3 calibrate magnetometer turn.ulg --report magnetometer.svg`.

    Args:
        source: A log of GLOC3 with MAVLink traffic (log.mcap), of PX4 (.ulg) or ArduPilot (.bin), a table of x,y,z in gauss
            (.csv), or the link to an autopilot.
        seconds: The longest time that a live turn may take.
        parameters: Where to write the result as the autopilot's parameters, a file for the ground station: PX4's where it
            ends in .params, ArduPilot's where it ends in .param or .parm.
        rotation: How a compass of PX4 is turned, as its CAL_MAG0_ROT (SENS_BOARD_ROT where that is -1), if the readings are
            on the vehicle's axes, as over MAVLink; those in PX4's logs are on the compass's own.
        options: Where to write the result: section magnetometer.
    """
    options = options or OutcomeOptions()
    options.check()
    if parameters is not None:
        check_parameter_file(parameters, rotation)
    elif rotation:
        raise Refused("--rotation is of the file that --parameters FILE.params names")
    if not 1.0 <= seconds <= 3600.0:
        raise Refused("--seconds must be from 1 to 3600")
    readings = listen(source, seconds) if is_link(source) else read_readings(Path(source))
    fit = fit_ellipsoid(readings)
    code = settle(
        CalibrationOutcome(
            lines=_lines(fit, len(readings), rotation),
            sections={
                SECTION: {
                    "offset_gauss": [round(value, 6) for value in fit.offset.tolist()],
                    "matrix": [[round(value, 6) for value in row] for row in fit.matrix.tolist()],
                    "calibration": {
                        "date": today(),
                        "field_gauss": round(fit.radius, 5),
                        "before": round(fit.before, 5),
                        "after": round(fit.after, 5),
                        "coverage": round(fit.coverage.share, 3),
                        "offset_std_gauss": [float(f"{value:.2g}") for value in fit.offset_std],
                    },
                }
            },
            doubts=doubts_of(fit),
            drawing=svg(f"{SECTION}: {fit.before:.1%} before, {fit.after:.2%} after", _panels(fit, readings)),
        ),
        options,
    )
    if code == WRITTEN and parameters is not None:
        write_parameters(parameters, fit, rotation, f"hard and soft iron, by gloc3 calibrate magnetometer, {today()}")
        narrate(
            f"parameters written into {parameters}; load them in the ground station (Services, Parameters), then restart the autopilot"
        )
    return code


def doubts_of(fit: EllipsoidFit) -> list[str]:
    """Why a calibrated magnetometer is not trustworthy; empty if it is."""
    doubts = []
    if fit.coverage.share < LEAST_SHARE:
        doubts.append(
            f"the field has come from {fit.coverage.share:.0%} of all sides, {LEAST_SHARE:.0%} is the least: "
            f"{fit.coverage.advice()}"
        )
    if fit.after > MOST_AFTER:
        doubts.append(
            f"calibrated strengths still differ by {fit.after:.1%} (standard deviation), {MOST_AFTER:.0%} is the most: "
            "turn away from steel and switch currents off"
        )
    offset_std = float(fit.offset_std.max()) / fit.radius
    if offset_std > MOST_OFFSET_STD:
        doubts.append(f"the offset is known to {offset_std:.1%} of the field only, {MOST_OFFSET_STD:.0%} is the most")
    if fit.axis_ratio > MOST_RATIO:
        doubts.append(f"the axes differ by {fit.axis_ratio:.1f} times, {MOST_RATIO:g} is the most: is an axis broken?")
    if not FIELD_GAUSS[0] <= fit.radius <= FIELD_GAUSS[1]:
        doubts.append(
            f"the field is {fit.radius:.3f} gauss, the Earth's {FIELD_GAUSS[0]:g} to {FIELD_GAUSS[1]:g}: is it in gauss?"
        )
    return doubts


def _lines(fit: EllipsoidFit, count: int, rotation: int) -> list[str]:
    offset = ", ".join(f"{v:.4f} ± {s:.4f}" for v, s in zip(fit.offset, fit.offset_std, strict=True))
    lines = [
        f"readings     {count}",
        f"hard iron    {offset} gauss",
        "soft iron    " + "; ".join(" ".join(f"{v:.4f}" for v in row) for row in fit.matrix),
        f"field        {fit.radius:.4f} gauss",
        f"residuals    {fit.before:.2%} of the field before, {fit.after:.2%} after (standard deviation of the strength)",
        f"covered      {fit.coverage.share:.0%} of all sides",
    ]
    lines += [
        f"  {name:<11}{'█' * round(BAR * share)}{'·' * (BAR - round(BAR * share))}"
        for name, share in fit.coverage.faces().items()
    ]
    for name, values in (("PX4", px4_parameters(fit, rotation)), ("ArduPilot", ardupilot_parameters(fit))):
        words = [f"{parameter}={value:.4f}" for parameter, value in values.items()]
        lines += [f"{name if first == 0 else '':<13}{' '.join(words[first : first + 3])}" for first in (0, 3, 6)]
    return lines


def _panels(fit: EllipsoidFit, readings: Floats) -> list[DiagramPanel]:
    fixed = fit.corrected(readings)
    most = 1.2 * max(float(np.abs(readings).max()), fit.radius)
    panels = [
        DiagramPanel(
            f"{'xyz'[a]} and {'xyz'[b]}",
            f"{'xyz'[a]}, gauss",
            f"{'xyz'[b]}, gauss",
            [PanelSeries("before", readings[:, a], readings[:, b]), PanelSeries("after", fixed[:, a], fixed[:, b])],
            (-most, most),
            (-most, most),
        )
        for a, b in ((0, 1), (0, 2), (1, 2))
    ]
    order = np.arange(len(readings), dtype=float)
    strength = [np.linalg.norm(each, axis=1) for each in (readings, fixed)]
    panels.append(
        DiagramPanel(
            "strength",
            "reading",
            "gauss",
            [PanelSeries(name, order, each) for name, each in zip(("before", "after"), strength, strict=True)],
        )
    )
    return panels
