"""Pictures with their poses, as files."""

import json
from pathlib import Path

import msgspec

from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3.log.report.recording import CAMERAS, POSES
from gloc3_onboard.components.drivers.image_recorder import RecordedPicture
from gloc3_onboard.sensors.devices import Rig
from gloc3_onboard.sensors.pictures import pixels_for_people


class PictureFolder:
    """Writes pictures as PNG, and their poses to `poses.jsonl`.

    Args:
        folder: destination.
        rig: camera calibrations, stored in `cameras.json` for inspection reports.
    """

    def __init__(self, folder: Path, rig: Rig | None = None) -> None:
        self._folder, self._rig = folder, rig
        self._cameras: dict[str, CameraModel | None] = {}

    def highest(self, camera: str) -> int:
        """The greatest number of a camera's picture that is there already; 0 for none."""
        numbers = [path.stem.removeprefix(f"{camera}-") for path in self._folder.glob(f"{camera}-*.png")]
        return max((int(number) for number in numbers if number.isdecimal()), default=0)

    def write(self, picture: RecordedPicture) -> None:
        """Writes a picture with its pose; raises `OSError` where that fails."""
        cv2 = load_opencv()
        self._folder.mkdir(parents=True, exist_ok=True)
        image = picture.image
        is_fine, encoded = cv2.imencode(".png", pixels_for_people(image), [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not is_fine:
            raise OSError(f"{picture.file} cannot be encoded")
        half = self._folder / (picture.file + ".part")
        half.write_bytes(encoded.tobytes())
        half.replace(self._folder / picture.file)
        tag = {
            "file": picture.file,
            "t_s": round(picture.t_s, 6),
            "position_ned_m": picture.position_ned_m,
            "ned_from_frd_wxyz": picture.ned_from_frd,
        }
        with (self._folder / POSES).open("a") as file:
            file.write(json.dumps(tag) + "\n")
        self._write_calibration(image.camera)

    def _write_calibration(self, name: str) -> None:
        """Writes a camera's calibration, once."""
        if self._rig is None or name in self._cameras:
            return
        self._cameras[name] = self._rig.model(name)
        known = {name: model for name, model in sorted(self._cameras.items()) if model is not None}
        if known:
            half = self._folder / (CAMERAS + ".part")
            half.write_bytes(msgspec.json.format(msgspec.json.encode(known)) + b"\n")
            half.replace(self._folder / CAMERAS)


class NoPictures:
    """For runs that keep no files: pictures are counted and dropped."""

    def __init__(self) -> None:
        self.written = 0

    def highest(self, camera: str) -> int:
        """None is there."""
        return 0

    def write(self, picture: RecordedPicture) -> None:
        """Counts a picture."""
        self.written += 1
