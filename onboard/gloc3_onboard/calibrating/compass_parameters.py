"""A calibrated magnetometer as parameters of its autopilot: PX4's and ArduPilot's, and files with them.

PX4 computes `rotation @ scale @ (reading - offset)` on the compass's own axes (sensor_calibration::Magnetometer); ArduPilot
`matrix @ (reading + offset)` on the body's (AP_Compass_Backend::correct_field), in milligauss.
"""

import math
import re
from pathlib import Path
from typing import Final

import numpy as np

from gloc3.camera.geometry import matrix
from gloc3.errors import Refused
from gloc3.mavlink.codec import enum_name
from gloc3.messages.frames import from_euler
from gloc3.store import replace_file
from gloc3_onboard.algorithms.calibration.boards import Floats
from gloc3_onboard.algorithms.calibration.ellipsoid import EllipsoidFit

PX4: Final = ".params"
"""QGroundControl's files."""
ARDUPILOT: Final = {".param": "{},{}\n", ".parm": "{:<16} {}\n"}
"""A line of Mission Planner's and of MAVProxy's files."""
ANGLES: Final = re.compile(r"(ROLL|PITCH|YAW)_(\d+)")
MOST_ROTATION: Final = 40


def check_parameter_file(path: Path, rotation: int) -> None:
    """Checks where parameters are to be written.

    Raises:
        Refused: the file's name tells no autopilot, or its folder does not exist; there is no such rotation.
    """
    if path.suffix not in (PX4, *ARDUPILOT):
        raise Refused(
            f"--parameters {path}: name a file that ends in .params for PX4, in .param or .parm for ArduPilot"
        )
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise Refused(f"--parameters {path}: it is a folder, or there is no folder {path.parent}")
    if not 0 <= rotation <= MOST_ROTATION:
        raise Refused(
            f"--rotation must be from 0 to {MOST_ROTATION}, as CAL_MAG0_ROT, and SENS_BOARD_ROT where that is -1"
        )
    if rotation and path.suffix != PX4:
        raise Refused("--rotation is of PX4: ArduPilot counts its offsets on the vehicle's axes")


def body_from_compass(rotation: int) -> Floats:
    """Rotation from a compass's axes to the body's, (3, 3), by its number in MAV_SENSOR_ORIENTATION."""
    angles = dict(ANGLES.findall(enum_name("MAV_SENSOR_ORIENTATION", rotation)))
    roll, pitch, yaw = (math.radians(float(angles.get(name, 0))) for name in ("ROLL", "PITCH", "YAW"))
    return np.asarray(matrix(from_euler(roll, pitch, yaw)))


def px4_parameters(fit: EllipsoidFit, rotation: int = 0) -> dict[str, float]:
    """Of PX4's first compass, in gauss, from readings on the body's axes."""
    turn = body_from_compass(rotation)
    return _named("CAL_MAG0_{}OFF", turn.T @ fit.offset) | _soft_iron(
        "CAL_MAG0_{}SCALE", "CAL_MAG0_{}ODIAG", turn.T @ fit.matrix @ turn
    )


def ardupilot_parameters(fit: EllipsoidFit) -> dict[str, float]:
    """Of ArduPilot's first compass, in milligauss."""
    return _named("COMPASS_OFS_{}", -1000.0 * fit.offset) | _soft_iron("COMPASS_DIA_{}", "COMPASS_ODI_{}", fit.matrix)


def write_parameters(path: Path, fit: EllipsoidFit, rotation: int, remark: str) -> None:
    """Writes the parameters as the ground station reads them, in the form that the file's name says."""
    if path.suffix == PX4:
        lines = [f"1\t1\t{name}\t{value:.6f}\t9\n" for name, value in px4_parameters(fit, rotation).items()]
    else:
        lines = [
            ARDUPILOT[path.suffix].format(name, f"{value:.4f}") for name, value in ardupilot_parameters(fit).items()
        ]
    replace_file(path, f"# {remark}\n{''.join(lines)}".encode())


def _soft_iron(diagonal: str, others: str, scale: Floats) -> dict[str, float]:
    return _named(diagonal, np.diag(scale)) | _named(others, scale[np.triu_indices(3, 1)])


def _named(name: str, values: Floats) -> dict[str, float]:
    return {name.format(axis): float(value) for axis, value in zip("XYZ", values, strict=True)}
