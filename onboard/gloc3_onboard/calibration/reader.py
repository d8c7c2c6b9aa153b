"""Reads a calibration file of any known form, detected by its content, into camera models."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import parse_qsl

import msgspec

from gloc3.camera.model import CameraModel
from gloc3.documents.document import load_bytes, parse
from gloc3.errors import Finding, InputError, Refused, nearest
from gloc3_onboard.calibration.euroc import looks_like_euroc, read_euroc
from gloc3_onboard.calibration.kalibr import looks_like_kalibr, read_kalibr
from gloc3_onboard.calibration.kitti import looks_like_kitti, read_kitti
from gloc3_onboard.calibration.mounting import Transform, frd_from_axes
from gloc3_onboard.calibration.numbers import Values
from gloc3_onboard.calibration.opencv import looks_like_opencv, read_opencv
from gloc3_onboard.sensors.pictures import picture_size

_LABELS: Final = ("make", "product", "pixel_um")
FORMS: Final = "OpenCV (YAML, XML), Kalibr camchain, EuRoC sensor.yaml, KITTI calib.txt"


class CalibrationFile(NamedTuple):
    """Contents of a calibration file."""

    file: str
    form: str
    cameras: dict[str, CameraModel]
    """By their names in the file."""
    warnings: Sequence[Finding] = ()

    def camera(self, name: str = "") -> CameraModel:
        """One camera; without a name the only one.

        Raises:
            InputError: there is none of that name, or there are several to choose from.
        """
        if name in self.cameras:
            return self.cameras[name]
        if not name and len(self.cameras) == 1:
            return next(iter(self.cameras.values()))
        if name:
            finding = Finding(file=self.file, message=f"it has no camera {name!r}", hint=nearest(name, [*self.cameras]))
        else:
            hint = f"write {self.file}#{next(iter(self.cameras))}"
            finding = Finding(file=self.file, message=f"it has {len(self.cameras)} cameras", hint=hint)
        raise InputError([finding])


def read_calibration(path: Path, *, axes: str = "", size: tuple[int, int] | None = None) -> CalibrationFile:
    """Reads a calibration file.

    Args:
        path: the file.
        axes: where x, y and z of the file's IMU or body point, `flu` for forward, left, up; default: *frd*, and for
            EuRoC's own files *urf*.
        size: of the pictures, for files without it; default: that of a picture beside a KITTI file.

    Raises:
        InputError: with all errors in the file.
        Refused: the axes are invalid.
    """
    file = str(path)
    text = load_bytes(path).decode("utf-8-sig", "replace")
    body = Transform((0.0, 0.0, 0.0), frd_from_axes(axes or "frd"))
    if looks_like_kitti(text):
        return CalibrationFile(file, "KITTI", read_kitti(text, file, size or picture_size(path.parent)))
    if text.lstrip().startswith("<"):
        return _checked(file, "OpenCV", *read_opencv(text, file))
    plain = _without_directive(text)
    if "!!opencv" not in text:
        document = parse(plain, file)
        if looks_like_kalibr(document.value):
            return _checked(file, "Kalibr", *read_kalibr(document, body))
        if looks_like_euroc(document.value):
            body = body if axes else Transform((0.0, 0.0, 0.0), frd_from_axes("urf"))
            return _checked(file, "EuRoC", *read_euroc(document, body))
    if looks_like_opencv(text):
        return _checked(file, "OpenCV", *read_opencv(text, file))
    raise InputError([Finding(file=file, message="this is not a known calibration format", hint=FORMS)])


def read_reference(reference: str, folder: Path) -> tuple[CalibrationFile, CameraModel]:
    """A camera by a reference such as `front.yaml#cam0` or `front.yaml?axes=flu#cam1`, relative to a folder.

    Raises:
        InputError: with everything that is wrong in the file.
        Refused: the reference is none.
    """
    rest, _, camera = reference.partition("#")
    name, _, query = rest.partition("?")
    options = dict(parse_qsl(query))
    unknown = sorted(set(options) - {"axes", "size", *_LABELS})
    if unknown or not name:
        raise Refused(
            f"calibration {reference!r}: write it as FILE?axes=flu&size=640x480&make=NAME&product=NAME&pixel_um=3#CAMERA"
        )
    size: tuple[int, int] | None = None
    if "size" in options:
        width, _, height = options["size"].partition("x")
        if not (width.isdecimal() and height.isdecimal()):
            raise Refused(f"calibration {reference!r}: the size is written as 640x480")
        size = (int(width), int(height))
    calibration = read_calibration(folder / name, axes=options.get("axes", ""), size=size)
    return calibration, _labelled(calibration.camera(camera), options, reference)


def _labelled(model: CameraModel, options: Mapping[str, str], reference: str) -> CameraModel:
    """The camera with what no calibration file says of it."""
    labels = {name: options[name] for name in _LABELS if name in options}
    if not labels:
        return model
    try:
        return msgspec.convert({**msgspec.structs.asdict(model), **labels}, CameraModel, strict=False)
    except msgspec.ValidationError as error:
        raise Refused(f"calibration {reference!r}: {error}") from error


def _without_directive(text: str) -> str:
    """Blanks OpenCV's first line, which other tools write as well."""
    return "\n" + text.partition("\n")[2] if text.startswith("%YAML") else text


def _checked(file: str, form: str, cameras: dict[str, CameraModel], values: Values) -> CalibrationFile:
    findings = sorted(values.findings)
    if any(not finding.is_warning for finding in findings):
        raise InputError(findings)
    if not cameras:
        raise InputError([Finding(file=file, message="no camera is in it")])
    return CalibrationFile(file, form, cameras, findings)
