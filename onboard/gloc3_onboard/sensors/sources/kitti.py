"""The folders of KITTI's odometry sequences (`image_0`, `image_1`, `times.txt`) as recorded data."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from gloc3.errors import Finding, InputError, nearest
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.camera_sources.camera import EYES, camera_name
from gloc3_onboard.sensors.camera_sources.stereo import STEREO, pair_names
from gloc3_onboard.sensors.pictures import load_picture, pictures_in
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.replay import Recorded, together
from gloc3_onboard.sensors.source_url import RATE, REPLAY

RATE_HZ: Final = 10.0
"""Of sequences without times."""


def camera_records(folder: Path, part: str, name: str, rate_hz: float = RATE_HZ) -> Sequence[Recorded[Image]]:
    """The frames of one camera.

    Raises:
        InputError: they are not there, or their times are damaged.
    """
    pictures = _pictures(folder, part)
    times = _times(folder / "times.txt", len(pictures), rate_hz)
    return [Recorded(t_s, partial(load_picture, picture, name)) for t_s, picture in zip(times, pictures, strict=False)]


def stereo_records(
    folder: Path, part: str, names: tuple[str, str], rate_hz: float = RATE_HZ
) -> Sequence[Recorded[tuple[Image, Image]]]:
    """The pairs of two cameras: image_0 and image_1, or of colour image_2 and image_3.

    Raises:
        InputError: they are not there, or their times are damaged.
    """
    left = part or "image_0"
    right = {"image_0": "image_1", "image_2": "image_3"}.get(left, left)
    sides = [camera_records(folder, side, name, rate_hz) for side, name in zip((left, right), names, strict=True)]
    return [together(first, second) for first, second in zip(*sides, strict=False)]


def _pictures(folder: Path, part: str) -> list[Path]:
    place = folder / (part or "image_0")
    found = pictures_in(place) if place.is_dir() else []
    if not found:
        known = sorted(path.name for path in folder.glob("image*") if path.is_dir()) if folder.is_dir() else []
        message = f"no pictures in {place.name}"
        raise InputError([Finding(file=str(folder), message=message, hint=nearest(place.name, known) if known else "")])
    return found


def _times(path: Path, count: int, rate_hz: float) -> list[float]:
    if not path.is_file():
        return [number / rate_hz for number in range(count)]
    times: list[float] = []
    for line, text in enumerate(path.read_text(encoding="utf-8", errors="replace").split(), start=1):
        try:
            times.append(float(text))
        except ValueError as error:
            message = f"{text[:40]!r} is not a time"
            raise InputError([Finding(file=str(path), line=line, column=1, message=message)]) from error
    return times


def _make(request: SourceRequest) -> Any:
    path, part, rate_hz = request.path, request.url.part, request.url.number("rate_hz", RATE_HZ)
    if request.sensor.name == STEREO:
        return request.replayed(partial(stereo_records, path, part, pair_names(request.device), rate_hz))
    return request.replayed(partial(camera_records, path, part, camera_name(request.device), rate_hz))


SOURCES: Final = (
    SourceKind("kitti", EYES, "kitti://sequences/00#image_0", _make, {**REPLAY, **RATE}, takes_part=True, is_file=True),
)
