"""Procedural textures and tags: the same file always gives the same picture."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gloc3_sitl.world.model import Marker, Texture

Image = NDArray[np.uint8]
"""Grey values, rows by columns."""

MARKER_PIXELS_PER_CELL = 16
MARKER_CELLS = 8
"""Cells across a tag with its white border: four of code, two of black frame, two of white."""


@lru_cache(maxsize=16)
def paint(texture: Texture) -> Image:
    """Make a texture, once for all cameras; it repeats without a seam at its edges."""
    import cv2

    random = np.random.Generator(np.random.PCG64(texture.seed))
    width = round(texture.size_m[0] * texture.resolution_px_m)
    height = round(texture.size_m[1] * texture.resolution_px_m)
    picture = np.zeros((height, width), np.float32)
    weight, cell_m = 1.0, 4.0
    while cell_m * texture.resolution_px_m >= 3.0:
        picture += weight * _stains(cv2, random, texture.size_m, cell_m, width, height)
        weight, cell_m = weight * 0.75, cell_m / 2.0
    deviation = float(picture.std()) or 1.0
    picture = texture.brightness + picture * (0.5 * texture.contrast / deviation)
    if texture.seam_m > 0.0:
        _seams(picture, texture)
    image: Image = np.clip(picture, 0.0, 255.0).astype(np.uint8)
    _speckles(cv2, random, image, texture)
    image.flags.writeable = False
    return image


def _stains(
    cv2: Any, random: np.random.Generator, size_m: tuple[float, float], cell_m: float, width: int, height: int
) -> NDArray[np.float32]:
    """Smooth noise with one random value a cell, wrapped round at the edges."""
    columns, rows = max(2, round(size_m[0] / cell_m)), max(2, round(size_m[1] / cell_m))
    values = random.standard_normal((rows, columns), np.float32)
    padded = np.pad(values, 2, mode="wrap")
    across, down = width / columns, height / rows
    big = cv2.resize(padded, (round(across * (columns + 4)), round(down * (rows + 4))), interpolation=cv2.INTER_CUBIC)
    top, left = round(2 * down), round(2 * across)
    cut: NDArray[np.float32] = big[top : top + height, left : left + width]
    return cut


def _seams(picture: NDArray[np.float32], texture: Texture) -> None:
    """Dark lines with a bright edge between plates."""
    step, line = texture.seam_m * texture.resolution_px_m, max(1, round(0.02 * texture.resolution_px_m))
    for axis in (0, 1):
        for place in np.arange(0.0, picture.shape[axis], step):
            start = int(place)
            for offset, change in ((0, -45.0), (line, 25.0)):
                cut = slice(start + offset, start + offset + line)
                picture[(cut, slice(None)) if axis == 0 else (slice(None), cut)] += change


def _speckles(cv2: Any, random: np.random.Generator, image: Image, texture: Texture) -> None:
    """Rust spots and paint drops."""
    height, width = image.shape
    count = round(texture.speckles_per_m2 * texture.size_m[0] * texture.size_m[1])
    radii = random.uniform(0.01, 0.04, count) * texture.resolution_px_m
    greys = np.where(random.random(count) < 0.5, random.uniform(5, 50, count), random.uniform(190, 250, count))
    margin = 0.05 * texture.resolution_px_m
    columns, rows = random.uniform(margin, width - margin, count), random.uniform(margin, height - margin, count)
    for column, row, radius, grey in zip(columns, rows, radii, greys, strict=True):
        center = (round(column * 16), round(row * 16))
        cv2.circle(image, center, max(16, round(radius * 16)), float(grey), -1, cv2.LINE_AA, 4)


def paint_marker(marker: Marker) -> Image:
    """The tag with its white border."""
    import cv2

    cell = MARKER_PIXELS_PER_CELL
    image = np.full((MARKER_CELLS * cell, MARKER_CELLS * cell), 255, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    image[cell:-cell, cell:-cell] = cv2.aruco.generateImageMarker(dictionary, marker.id, 6 * cell)
    return image
