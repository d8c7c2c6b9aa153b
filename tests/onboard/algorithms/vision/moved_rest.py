"""Real pictures of a vehicle at rest, warped by their depth to those of one that moves: EuRoC's first stereo pairs.

The pairs are rectified, the depth is that of OpenCV's semi-global matching, and each eye's picture is taken from that
eye's own, so that noise, lens and disparity stay real ones.
"""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gloc3.camera.geometry import Array, matrix
from gloc3.camera.model import CameraModel
from gloc3_onboard.algorithms.vision.picture import Picture
from gloc3_onboard.datasets.stereo_set import read_stereo_set

FAR_M = 8.0


@cache
def rectified(folder: Path) -> tuple[CameraModel, CameraModel, list[float], list[tuple[Picture, Picture]]]:
    """The rectified cameras, times and pairs."""
    given = read_stereo_set(folder)
    left, right = given.left, given.right
    size = (left.width, left.height)
    ks = [
        np.array([[c.focal_px[0], 0, c.center_px[0]], [0, c.focal_px[1], c.center_px[1]], [0, 0, 1]])
        for c in (left, right)
    ]
    right_from_left = matrix(right.frd_from_rdf).T @ matrix(left.frd_from_rdf)
    shift = matrix(right.frd_from_rdf).T @ (np.array(left.position_frd_m) - np.array(right.position_frd_m))
    bends = [np.array(c.distortion) for c in (left, right)]
    r1, r2, p1, p2, *_ = cv2.stereoRectify(
        ks[0],
        bends[0],
        ks[1],
        bends[1],
        size,
        right_from_left,
        shift.reshape(3, 1),
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )
    maps = [
        cv2.initUndistortRectifyMap(k, bend, r, p[:, :3], size, cv2.CV_32FC1)
        for k, bend, r, p in zip(ks, bends, (r1, r2), (p1, p2), strict=True)
    ]
    pairs = []
    for record in given.pairs:
        sides = [np.frombuffer(image.data, np.uint8).reshape(size[::-1]) for image in record.load()]
        one, other = (cv2.remap(side, *each, cv2.INTER_CUBIC) for side, each in zip(sides, maps, strict=True))
        pairs.append((np.asarray(one, np.uint8), np.asarray(other, np.uint8)))
    focal, column, row = float(p1[0, 0]), float(p1[0, 2]), float(p1[1, 2])
    base = float(-p2[0, 3] / p2[0, 0])
    models = [
        CameraModel(
            width=size[0],
            height=size[1],
            focal_px=(focal, focal),
            center_px=(column, row),
            position_frd_m=(0.0, y, 0.0),
        )
        for y in (0.0, base)
    ]
    return models[0], models[1], [record.log_s for record in given.pairs], pairs


def depth_of(left: Picture, right: Picture, focal_px: float, base_m: float) -> Array:
    """Distance along the optical axis of each pixel of the left picture; holes take their surroundings'."""
    steps = 96
    matcher = cv2.StereoSGBM.create(0, steps, 5, 8 * 25, 32 * 25, 1, 31, 10, 100, 2, cv2.STEREO_SGBM_MODE_HH)
    wide = [cv2.copyMakeBorder(side, 0, 0, steps, 0, cv2.BORDER_REPLICATE) for side in (left, right)]
    disparity = matcher.compute(wide[0], wide[1])[:, steps:].astype(np.float32) / 16.0
    is_known = disparity > focal_px * base_m / FAR_M
    weight = is_known.astype(np.float32)
    filled = np.where(is_known, disparity, 0.0).astype(np.float32)
    for width in (15, 61, 241):
        near = cv2.blur(filled, (width, width)) / np.maximum(cv2.blur(weight, (width, width)), 1e-6)
        is_hole = (weight == 0.0) & (cv2.blur(weight, (width, width)) > 1e-3)
        filled, weight = np.where(is_hole, near, filled), np.where(is_hole, 1.0, weight).astype(np.float32)
    smooth = cv2.medianBlur(np.maximum(filled, focal_px * base_m / FAR_M).astype(np.float32), 5)
    return np.asarray(focal_px * base_m / smooth, np.float64)


def moved(picture: Picture, depth: Array, camera: CameraModel, eye_m: float, shift_m: Array) -> Picture:
    """What an eye, `eye_m` to the right of the left one, sees after a shift (right, down, ahead)."""
    height, width = depth.shape
    focal, (column, row) = camera.focal_px[0], camera.center_px
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    x, y = (columns - column) / focal * depth, (rows - row) / focal * depth
    seen_z = depth - shift_m[2]
    to_column = (x - eye_m - shift_m[0]) / seen_z * focal + column
    to_row = (y - shift_m[1]) / seen_z * focal + row
    from_column = (x - eye_m) / depth * focal + column
    offsets = np.stack([from_column - to_column, rows - to_row])
    from_columns, from_rows = _spread(to_column, to_row, seen_z, offsets)
    return np.asarray(
        cv2.remap(picture, from_columns, from_rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.uint8
    )


def _spread(columns: Array, rows: Array, depth: Array, offsets: Array) -> tuple[Any, Any]:
    """Where each pixel of the new picture comes from, by offsets that are known at scattered places.

    Near ones hide far ones, holes take their surroundings'.
    """
    shape = depth.shape
    c, r = np.floor(columns).astype(int), np.floor(rows).astype(int)
    inside = (c >= 0) & (c < shape[1] - 1) & (r >= 0) & (r < shape[0] - 1)
    c, r, z, offsets = c[inside], r[inside], depth[inside], offsets[:, inside]
    nearest = np.full(shape, np.inf)
    np.minimum.at(nearest, (r, c), z)
    is_seen = z <= cv2.erode(nearest, np.ones((3, 3)))[r, c] * 1.05
    right, down = columns[inside] - c, rows[inside] - r
    sums = np.zeros((3, shape[0] * shape[1]))
    for step, row_step in ((0, 0), (1, 0), (0, 1), (1, 1)):
        share = (right if step else 1.0 - right) * (down if row_step else 1.0 - down) * is_seen
        at = (r + row_step) * shape[1] + c + step
        for total, value in zip(sums, (share * offsets[0], share * offsets[1], share), strict=True):
            total += np.bincount(at, value, len(total))
    across, along, weight = sums.reshape(3, *shape)
    for width in (5, 25, 101):
        known = cv2.blur(weight, (width, width))
        is_hole = (weight < 1e-3) & (known > 1e-6)
        across, along = (
            np.where(is_hole, cv2.blur(v, (width, width)) / np.maximum(known, 1e-9), v) for v in (across, along)
        )
        weight = np.where(is_hole, 1.0, weight)
    grid = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    found = [
        (total / np.maximum(weight, 1e-9) + axis).astype(np.float32)
        for total, axis in zip((across, along), grid, strict=True)
    ]
    return found[0], found[1]


def drive(folder: Path, velocity_m_s: Array, every: int = 1) -> Iterator[tuple[float, Picture, Picture]]:
    """The pairs as of a vehicle that moves at a steady velocity (right, down, ahead)."""
    left, right, times_s, pairs = rectified(folder)
    base_m = right.position_frd_m[1]
    depth = depth_of(*pairs[0], left.focal_px[0], base_m)
    for t_s, (one, other) in list(zip(times_s, pairs, strict=True))[::every]:
        shift = velocity_m_s * (t_s - times_s[0])
        yield t_s, moved(one, depth, left, 0.0, shift), moved(other, depth, left, base_m, shift)
