"""What goes wrong with cameras and scanners: what their faults make of what they took."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final, NamedTuple, TypeVar
from zlib import crc32

import msgspec
import numpy as np
from numpy.typing import NDArray

from gloc3.perception import LaserScan
from gloc3.vehicle import Image

LATE_S: Final = 0.2
"""Of a device that is late, when no size is given."""
SCALE: Final = 0.05
"""By which share the ranges of a scaled scanner are too long, when no size is given."""


class Exposure(NamedTuple):
    """A frame with its time, as a camera sampler reads it."""

    t_s: float
    image: Image


class PairExposure(NamedTuple):
    """The frames of a stereo pair, as its sampler reads them."""

    t_s: float
    left: Image
    right: Image


class Turn(NamedTuple):
    """A scan with its time, as a laser sampler reads it."""

    t_s: float
    scan: LaserScan


class DeviceFault(NamedTuple):
    """What is wrong with a device."""

    word: str
    """A key of `ALL`, or of `CAMERA` or `LASER`."""
    size: float | None = None
    """Seconds of `late`, share of `scaled`."""


T = TypeVar("T", Exposure, PairExposure, Turn)

ALL: Final = ("lost", "stuck", "late")
"""Nothing comes; the same comes again with new times; all comes late."""


def late_by_s(fault: DeviceFault | None) -> float:
    """How late a device is."""
    if fault is None or fault.word != "late":
        return 0.0
    return LATE_S if fault.size is None else fault.size


def is_silent(fault: DeviceFault | None) -> bool:
    """Whether nothing comes."""
    return fault is not None and fault.word == "lost"


def is_stuck(fault: DeviceFault | None) -> bool:
    """Whether the last comes again and again."""
    return fault is not None and fault.word == "stuck"


def spoilt(taken: T, fault: DeviceFault | None) -> T:
    """What a fault makes of what was taken."""
    if fault is None or fault.word in ALL:
        return taken
    if isinstance(taken, Turn):
        return taken._replace(scan=_spoilt_scan(taken.scan, fault, taken.t_s))
    spoil = partial(CAMERA[fault.word], t_s=taken.t_s)
    if isinstance(taken, PairExposure):
        return taken._replace(left=spoil(taken.left), right=spoil(taken.right))
    return taken._replace(image=spoil(taken.image))


def _filled(image: Image, t_s: float, grey: int) -> Image:
    del t_s
    return msgspec.structs.replace(image, data=bytes([grey]) * (image.width * image.height))


def _torn(image: Image, t_s: float) -> Image:
    """Only the upper part has come."""
    del t_s
    return msgspec.structs.replace(image, data=image.data[: len(image.data) * 2 // 3])


def _small(image: Image, t_s: float) -> Image:
    """Every other pixel: a camera in a wrong mode."""
    del t_s
    pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)[::2, ::2]
    return msgspec.structs.replace(image, width=pixels.shape[1], height=pixels.shape[0], data=pixels.tobytes())


def _garbage(image: Image, t_s: float) -> Image:
    """Any value at any pixel."""
    random = _random(image.camera, t_s)
    return msgspec.structs.replace(image, data=random.bytes(image.width * image.height))


CAMERA: Final[Mapping[str, Callable[..., Image]]] = {
    "black": partial(_filled, grey=0),
    "white": partial(_filled, grey=255),
    "torn": _torn,
    "small": _small,
    "garbage": _garbage,
}
"""Faults of cameras."""

LASER: Final = ("zero", "far", "nan", "scaled", "garbage")
"""Faults of scanners: all ranges are 0, the greatest, no number, too long by a share, or anything."""


def _spoilt_scan(scan: LaserScan, fault: DeviceFault, t_s: float) -> LaserScan:
    ranges = np.frombuffer(scan.ranges_m, "<f4")
    spoils: Mapping[str, Callable[[], NDArray[np.floating]]] = {
        "zero": lambda: np.zeros(len(ranges)),
        "far": lambda: np.full(len(ranges), scan.range_max_m),
        "nan": lambda: np.full(len(ranges), np.nan),
        "scaled": lambda: np.minimum(ranges * (1.0 + (SCALE if fault.size is None else fault.size)), scan.range_max_m),
        "garbage": lambda: _random(scan.scanner, t_s).uniform(0.0, scan.range_max_m, len(ranges)),
    }
    return msgspec.structs.replace(scan, ranges_m=spoils[fault.word]().astype("<f4").tobytes())


def _random(name: str, t_s: float) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64([crc32(name.encode()), max(0, round(t_s * 1e6))]))
