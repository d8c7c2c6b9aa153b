"""Procedural textures of painted and rusty steel, and tags: the same file always gives the same picture."""

from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.opencv import load_opencv
from gloc3_sitl.world.model import Marker, Texture

Image = NDArray[np.uint8]
"""Grey values, rows by columns."""
Picture = NDArray[np.float32]
"""Grey values while they are painted."""

DARKEST = 12
"""Lowest grey value of painted steel; black means empty."""
MARKER_PIXELS_PER_CELL = 16
MARKER_CELLS = 8
"""Cells across a tag with its white border: four of code, two of black frame, two of white."""


NEUTRAL: Final = 128
"""Value of a tint that leaves grey as it is; a channel of a coloured picture is grey times tint over this."""
_RUST_RGB: Final = (150.0, 82.0, 40.0)
_LUMA_RGB: Final = (0.299, 0.587, 0.114)
"""Shares of the channels in a grey value (ITU-R BT.601), as OpenCV has them."""


class Painting(NamedTuple):
    """A finished texture."""

    grey: Image
    rust: Image
    """How rusty each pixel is, 0 to 255."""


def paint(texture: Texture) -> Image:
    """The grey values of a texture."""
    return painted(texture).grey


@lru_cache(maxsize=24)
def painted(texture: Texture) -> Painting:
    """Make a texture, once for all cameras; it repeats without a seam at its edges."""
    cv2 = load_opencv()
    random = np.random.Generator(np.random.PCG64(texture.seed))
    width = round(texture.size_m[0] * texture.resolution_px_m)
    height = round(texture.size_m[1] * texture.resolution_px_m)
    picture = np.full((height, width), texture.brightness, np.float32)
    if texture.contrast > 0.0:
        picture += _clouds(cv2, random, texture, width, height) * np.float32(0.5 * texture.contrast)
    rust = _rust(cv2, random, picture, texture) if texture.rust > 0.0 else np.zeros_like(picture)
    if texture.seam_m > 0.0:
        _welds(random, picture, texture)
    if texture.ribs_m > 0.0:
        _ribs(picture, texture)
    if texture.label:
        _stencil(cv2, random, picture, texture)
    if texture.grain > 0.0:
        picture += random.standard_normal(picture.shape, np.float32) * np.float32(texture.grain)
    image: Image = np.clip(picture, DARKEST, 255.0).astype(np.uint8)
    _speckles(cv2, random, image, texture)
    image.flags.writeable = False
    return Painting(image, np.round(rust * np.float32(255.0)).astype(np.uint8))


def tint_of(texture: Texture) -> Image:
    """The colours of a texture without its brightness, shape `(rows, columns, 3)`: blue, green and red."""
    share = (painted(texture).rust.astype(np.float32) / np.float32(255.0))[..., None]
    paint_bgr, rust_bgr = _tint(texture.colour), _tint(_RUST_RGB)
    tint: Image = np.round(paint_bgr + (rust_bgr - paint_bgr) * share).astype(np.uint8)
    return tint


def _tint(rgb: tuple[float, float, float]) -> Picture:
    luma = sum(share * value for share, value in zip(_LUMA_RGB, rgb, strict=True))
    tint: Picture = np.clip(np.array(rgb[::-1], np.float32) * np.float32(NEUTRAL / max(luma, 1.0)), 0.0, 255.0)
    return tint


def _clouds(cv2: Any, random: np.random.Generator, texture: Texture, width: int, height: int) -> Picture:
    """Stains of many sizes, with a mean of 0 and a deviation of 1."""
    picture = np.zeros((height, width), np.float32)
    weight, cell_m = 1.0, 4.0
    while cell_m * texture.resolution_px_m >= 3.0:
        picture += np.float32(weight) * _stains(cv2, random, texture.size_m, cell_m, width, height)
        weight, cell_m = weight * 0.75, cell_m / 2.0
    return picture / np.float32(float(picture.std()) or 1.0)


def _stains(
    cv2: Any, random: np.random.Generator, size_m: tuple[float, float], cell_m: float, width: int, height: int
) -> Picture:
    """Smooth noise with one random value a cell, wrapped round at the edges."""
    columns, rows = max(2, round(size_m[0] / cell_m)), max(2, round(size_m[1] / cell_m))
    values = random.standard_normal((rows, columns), np.float32)
    padded = np.pad(values, 2, mode="wrap")
    across, down = width / columns, height / rows
    big = cv2.resize(padded, (round(across * (columns + 4)), round(down * (rows + 4))), interpolation=cv2.INTER_CUBIC)
    top, left = round(2 * down), round(2 * across)
    cut: Picture = big[top : top + height, left : left + width]
    return cut


def _rust(cv2: Any, random: np.random.Generator, picture: Picture, texture: Texture) -> Picture:
    """Dark, rough blotches with ragged edges, and the streaks that water has drawn down from them; returns how rusty it is."""
    height, width = picture.shape
    field = _stains(cv2, random, texture.size_m, 0.7, width, height)
    field += np.float32(0.6) * _stains(cv2, random, texture.size_m, 0.12, width, height)
    field += np.float32(0.35) * _stains(cv2, random, texture.size_m, 0.04, width, height)
    edge = np.quantile(field[::8, ::8], 1.0 - texture.rust)
    depth: Picture = np.clip((field - edge) / np.float32(0.35), 0.0, 1.0)
    length = max(1, round(0.6 * texture.resolution_px_m))
    padded = np.concatenate([depth[-length:], depth])
    streaks = cv2.blur(padded, (1, 2 * length + 1), borderType=cv2.BORDER_REPLICATE)[:height]
    lines = np.abs(random.standard_normal(width, np.float32))
    picture -= np.float32(55.0) * depth + np.float32(35.0) * streaks * np.minimum(lines, np.float32(1.5))
    picture += depth * (random.standard_normal(picture.shape, np.float32) * np.float32(14.0))
    rust: Picture = np.clip(depth + np.float32(0.7) * streaks * np.minimum(lines, np.float32(1.5)), 0.0, 1.0)
    return rust


def _welds(random: np.random.Generator, picture: Picture, texture: Texture) -> None:
    """Draws weld beads between plates, rippled, with a scorched rim; each plate has its own shade."""
    step = texture.seam_m * texture.resolution_px_m
    half = max(1, round(0.012 * texture.resolution_px_m))
    height, width = picture.shape
    tops, lefts = np.arange(0.0, height - 1.0, step), np.arange(0.0, width - 1.0, step)
    for top in tops:
        for left in lefts:
            shade = np.float32(random.normal(0.0, 7.0))
            picture[round(top) : round(top + step), round(left) : round(left + step)] += shade
    for axis, places in ((0, tops), (1, lefts)):
        across = picture if axis == 0 else picture.T
        length = across.shape[1]
        ripple = np.float32(18.0) * np.sign(np.sin(np.arange(length, dtype=np.float32) * np.float32(np.pi / half)))
        bead = ripple + random.normal(26.0, 8.0, (length,)).astype(np.float32)
        for start in (round(place) for place in places):
            across[start : start + half] -= np.float32(38.0)
            across[start + half : start + 3 * half] += bead
            across[start + 3 * half : start + 4 * half] -= np.float32(30.0)


def _ribs(picture: Picture, texture: Texture) -> None:
    """Upright frames: a bright flange 0.1 m wide between a lit flank and a deep shadow, as seen from the front."""
    step, resolution = texture.ribs_m * texture.resolution_px_m, texture.resolution_px_m
    columns = np.arange(picture.shape[1])
    place_m = ((columns - 0.5 * step) % step) / resolution
    profile = np.zeros(len(columns), np.float32)
    for begin_m, end_m, change in ((0.0, 0.02, 30.0), (0.02, 0.1, 22.0), (0.1, 0.12, -20.0), (0.12, 0.2, -48.0)):
        profile[(place_m >= begin_m) & (place_m < end_m)] = change
    shadow = (place_m >= 0.2) & (place_m < 0.32)
    profile[shadow] = -48.0 * (0.32 - place_m[shadow]) / 0.12
    picture += profile


def _stencil(cv2: Any, random: np.random.Generator, picture: Picture, texture: Texture) -> None:
    """Words in paint, here and there."""
    height, width = picture.shape
    size = 0.35 * texture.resolution_px_m / 22.0
    for number in range(max(1, round(texture.size_m[0] * texture.size_m[1] / 20.0))):
        spot = np.zeros((height, width), np.uint8)
        left, top = random.uniform(0.02, 0.7) * width, random.uniform(0.1, 0.95) * height
        text = f"{texture.label} {number + 1}"
        thick = max(1, round(0.05 * texture.resolution_px_m))
        cv2.putText(spot, text, (round(left), round(top)), cv2.FONT_HERSHEY_SIMPLEX, size, 255, thick, cv2.LINE_AA)
        picture += spot.astype(np.float32) * np.float32(0.33)


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
    cv2 = load_opencv()
    cell = MARKER_PIXELS_PER_CELL
    image = np.full((MARKER_CELLS * cell, MARKER_CELLS * cell), 255, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    image[cell:-cell, cell:-cell] = cv2.aruco.generateImageMarker(dictionary, marker.id, 6 * cell)
    return image
