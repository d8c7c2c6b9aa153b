"""Pictures of pictures, with OpenCV: a contact sheet, and the map of how often each part of a wall was seen."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.opencv import load_opencv
from gloc3.camera.wall_coverage import Coverage
from gloc3.log.report.recording import PictureRecording, TakenPicture

Picture = NDArray[np.uint8]

COLUMNS: Final = 6
MOST: Final = 60
"""More pictures than this are thinned out evenly."""
_WIDTH_PX: Final = 200
_LABEL_PX: Final = 18
_GAP_PX: Final = 4
_PAPER: Final = 250
_INK_BGR: Final = (40, 40, 40)
SHADES: Final = ("#f3c6bd", "#cfe3f4", "#9ac5e8", "#5c9fd4", "#2a72b5", "#124a84")
"""Not seen, seen once, twice, … five times or more."""


def chosen(recording: PictureRecording) -> list[tuple[int, TakenPicture]]:
    """The pictures of the sheet, with their numbers from 1: all, or an even choice."""
    numbered = list(enumerate(recording.pictures, start=1))
    if len(numbered) <= MOST:
        return numbered
    return [numbered[round(index)] for index in np.linspace(0, len(numbered) - 1, MOST)]


def contact_sheet(recording: PictureRecording) -> bytes | None:
    """The pictures side by side with number and time, as PNG; None where there are none."""
    cv2 = load_opencv()
    used = chosen(recording)
    if not used:
        return None
    tiles = [_tile(cv2, recording.folder, number, picture, recording.time_of(picture, 1)) for number, picture in used]
    height = max(tile.shape[0] for tile in tiles)
    rows = -(-len(tiles) // COLUMNS)
    step_x, step_y = _WIDTH_PX + _GAP_PX, height + _GAP_PX
    columns = min(COLUMNS, len(tiles))
    sheet = np.full((rows * step_y + _GAP_PX, columns * step_x + _GAP_PX, 3), _PAPER, np.uint8)
    for index, tile in enumerate(tiles):
        top, left = _GAP_PX + index // COLUMNS * step_y, _GAP_PX + index % COLUMNS * step_x
        sheet[top : top + tile.shape[0], left : left + _WIDTH_PX] = tile
    return _png(cv2, sheet)


def coverage_map(coverage: Coverage) -> bytes:
    """How often each cell of a wall was seen, a pixel a cell, as PNG in the colours of `SHADES`."""
    cv2 = load_opencv()
    palette = np.array([[int(shade[i : i + 2], 16) for i in (5, 3, 1)] for shade in SHADES], np.uint8)
    return _png(cv2, palette[np.minimum(coverage.times, len(SHADES) - 1)])


def _tile(cv2: Any, folder: Path, number: int, picture: TakenPicture, time: str) -> Picture:
    """One picture, made small, with a label below; an empty one where it cannot be read."""
    path = folder / picture.file
    data = np.frombuffer(path.read_bytes(), np.uint8) if path.exists() else np.zeros(0, np.uint8)
    found = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    if found is None:
        found = np.full((150, _WIDTH_PX, 3), 225, np.uint8)
        cv2.putText(found, "no file", (60, 80), cv2.FONT_HERSHEY_SIMPLEX, 0.5, _INK_BGR, 1, cv2.LINE_AA)
    height = max(1, round(found.shape[0] * _WIDTH_PX / found.shape[1]))
    tile = np.full((height + _LABEL_PX, _WIDTH_PX, 3), _PAPER, np.uint8)
    tile[:height] = cv2.resize(found, (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    label = f"{number}  {picture.camera}  {time}"
    cv2.putText(tile, label, (2, height + 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _INK_BGR, 1, cv2.LINE_AA)
    return tile


def _png(cv2: Any, pixels: Picture) -> bytes:
    _, encoded = cv2.imencode(".png", pixels)
    return bytes(encoded.tobytes())
