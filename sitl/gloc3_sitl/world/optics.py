"""Lens distortion: the scene is drawn undistorted on one to five canvases and warped once.

A canvas is a pinhole picture at the resolution of the middle of the lens. One looks ahead; a lens that sees more than
60 degrees beside its axis has four more, on the sides of a cube round the eye.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import unproject
from gloc3.camera.model import CameraModel, Lens
from gloc3.camera.opencv import load_opencv
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.patches import Pinhole
from gloc3_sitl.world.texture import Image

_ONE_CANVAS_TAN: Final = 1.75
_RIM_PX: Final = 2
_FACES: Final = (
    ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
    ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
    ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)),
)
"""Axes (right, down, forward) of the sides of the cube: ahead, right, left, below, above."""


class LensCanvas(NamedTuple):
    """A pinhole picture that the lens takes a part of its picture from."""

    face_from_rdf: Floats
    """Rotation of the camera's axes to those of the canvas, 3 by 3."""
    pinhole: Pinhole
    maps: tuple[Any, Any] | None
    """Where each pixel of the lens's picture lies on the canvas, for OpenCV's `remap`; None where both are the same."""
    mask: NDArray[np.uint8] | None
    """Which pixels come from this canvas; None for all."""


class Optics:
    """The canvases of a camera, and how they become its picture; what the lens cannot show stays black."""

    def __init__(self, model: CameraModel) -> None:
        self._cv2 = load_opencv()
        self._model = model
        self.canvases: Final = self._canvases()
        """What has to be drawn for a picture."""

    def bend(self, canvases: list[Image]) -> Image:
        """The picture of the lens, from the pictures on its canvases."""
        found: Image | None = None
        for canvas, drawn in zip(self.canvases, canvases, strict=True):
            part = drawn
            if canvas.maps is not None:
                part = self._cv2.remap(drawn, *canvas.maps, self._cv2.INTER_LINEAR)
            if canvas.mask is None:
                return part
            found = np.zeros_like(part) if found is None else found
            self._cv2.copyTo(part, canvas.mask, found)
        assert found is not None
        return found

    def _canvases(self) -> list[LensCanvas]:
        model = self._model
        if model.lens is Lens.PINHOLE:
            return [
                LensCanvas(np.eye(3), Pinhole(model.focal_px, model.center_px, model.width, model.height), None, None)
            ]
        columns, rows = np.meshgrid(np.arange(model.width, dtype=float), np.arange(model.height, dtype=float))
        flat = unproject(model, np.column_stack([columns.ravel(), rows.ravel()]))
        is_shown = np.isfinite(flat[:, 0]) & np.isfinite(flat[:, 1])
        views = np.column_stack([np.where(is_shown[:, None], flat, 0.0), np.ones(len(flat))])
        if is_shown.all() and np.abs(flat).max() < _ONE_CANVAS_TAN:
            return [self._canvas(np.eye(3), views, None)]
        towards = np.stack([views @ np.array(face[2]) for face in _FACES])
        best = np.where(is_shown, towards.argmax(axis=0), -1)
        return [self._canvas(np.array(face), views, best == n) for n, face in enumerate(_FACES) if (best == n).any()]

    def _canvas(self, face_from_rdf: Floats, looks: Floats, chosen: NDArray[np.bool_] | None) -> LensCanvas:
        model, cv2 = self._model, self._cv2
        (focal_x, focal_y), shape = model.focal_px, (model.height, model.width)
        seen = looks @ face_from_rdf.T
        inside = np.ones(len(seen), bool) if chosen is None else chosen
        depth = np.where(inside, seen[:, 2], 1.0)
        columns, rows = focal_x * seen[:, 0] / depth, focal_y * seen[:, 1] / depth
        left, top = float(columns[inside].min()) - _RIM_PX, float(rows[inside].min()) - _RIM_PX
        width = int(np.ceil(columns[inside].max() - left)) + 1 + _RIM_PX
        height = int(np.ceil(rows[inside].max() - top)) + 1 + _RIM_PX
        across, down = (
            (line - begin).reshape(shape).astype(np.float32) for line, begin in ((columns, left), (rows, top))
        )
        maps = cv2.convertMaps(across, down, cv2.CV_16SC2)
        mask = None if chosen is None else (chosen.reshape(shape) * np.uint8(255)).astype(np.uint8)
        return LensCanvas(face_from_rdf, Pinhole(model.focal_px, (-left, -top), width, height), maps, mask)
