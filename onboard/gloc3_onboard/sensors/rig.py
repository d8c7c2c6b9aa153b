"""The cameras of a platform as they are calibrated: inline in its file, or in files that it names."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from gloc3.camera.model import CameraModel
from gloc3.errors import Finding, Gloc3Error, InputError
from gloc3.platform.platform import Platform
from gloc3_onboard.calibration.reader import read_reference
from gloc3_onboard.sensors.devices import Rig


class PlatformRig:
    """The models of a platform's cameras, read once.

    Args:
        platform: its `cameras` are models, or references such as `front.yaml?axes=flu#cam0`.
        folder: of the platform file.

    Raises:
        InputError: a calibration cannot be used; with everything that is wrong in all of them.
    """

    def __init__(self, platform: Platform, folder: Path) -> None:
        self.warnings: Final[list[Finding]] = []
        self._models, wrong = _read(platform, folder, self.warnings)
        if wrong:
            raise InputError(wrong)

    def model(self, camera: str) -> CameraModel | None:
        """The model of the camera of that name; None where the platform file has none."""
        return self._models.get(camera)


def calibrations(platform: Platform, rig: Rig) -> dict[str, CameraModel]:
    """The platform's cameras as the components of a process have them."""
    return {name: model for name in platform.cameras if (model := rig.model(name)) is not None}


def calibration_problems(platform: Platform, folder: Path) -> Mapping[str, str]:
    """Why a camera's calibration cannot be used, or is doubtful, by camera; without those that are well."""
    found: dict[str, str] = {}
    for name, given in platform.cameras.items():
        if isinstance(given, str):
            try:
                calibration, _ = read_reference(given, folder)
            except Gloc3Error as error:
                found[name] = str(error)
            else:
                if calibration.warnings:
                    found[name] = "; ".join(map(str, calibration.warnings))
    return found


def _read(
    platform: Platform, folder: Path, warnings: list[Finding]
) -> tuple[dict[str, CameraModel], Sequence[Finding]]:
    models: dict[str, CameraModel] = {}
    wrong: list[Finding] = []
    for name, given in platform.cameras.items():
        if isinstance(given, CameraModel):
            models[name] = given
            continue
        try:
            calibration, models[name] = read_reference(given, folder)
            warnings += calibration.warnings
        except InputError as error:
            wrong += error.findings
        except Gloc3Error as error:
            wrong.append(Finding(file=f"cameras: {name}", message=str(error)))
    return models, wrong
