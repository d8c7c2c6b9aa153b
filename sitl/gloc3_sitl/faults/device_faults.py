"""Faults of cameras and scanners: how they corrupt frames and scans, new or already taken."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final, NamedTuple, TypeVar
from zlib import crc32

import msgspec
import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3
from gloc3.messages.perception import BottomVelocity, DepthImage, EstimatorPose, LaserScan, PointCloud
from gloc3.messages.vehicle import Image
from gloc3_sitl.physics.truth import Truth

SIZES: Final[Mapping[str, float]] = {"late": 0.2, "old": 0.2, "scaled": 0.05, "step": 0.2}
"""Default sizes of faults: seconds, seconds, a share, metres."""


class FaultyFrame(NamedTuple):
    """A frame with its time, as a camera sampler reads it."""

    t_s: float
    image: Image


class PairExposure(NamedTuple):
    """The frames of a stereo pair, as its sampler reads them."""

    t_s: float
    left: Image
    right: Image


class FaultyDepth(NamedTuple):
    """A depth picture with its time, as a depth camera's sampler reads it."""

    t_s: float
    depth: DepthImage


class FaultyScan(NamedTuple):
    """A scan with its time, as a laser sampler reads it."""

    t_s: float
    scan: LaserScan


class FaultyCloud(NamedTuple):
    """A turn of a 3D scanner with its time, as its sampler reads it."""

    t_s: float
    cloud: PointCloud


class Bottom(NamedTuple):
    """A velocity over the floor with its time, as a DVL sampler reads it."""

    t_s: float
    bottom: BottomVelocity


class FaultyReading(NamedTuple):
    """A probe's value with its time, as its sampler reads it."""

    t_s: float
    value: float


class Estimated(NamedTuple):
    """A pose of another estimator with its time, as its sampler reads it."""

    t_s: float
    pose: EstimatorPose


class DeviceFault(NamedTuple):
    """A fault of a device."""

    word: str
    """A key of `ALL`, or of `CAMERA`, `DEPTH` or `LASER`."""
    size: float | None = None
    """Seconds of `late` and `old`, share of `scaled`, metres of `step`."""


T = TypeVar("T", FaultyFrame, PairExposure, FaultyDepth, FaultyScan, FaultyCloud, Bottom, FaultyReading, Estimated)

ALL: Final = ("lost", "stuck", "late", "old", "scaled", "step")
"""In this order: no data; repeated data with new times; late data; late data with new times; measured motion too long
by a share; position displaced to the north."""


def size_of(fault: DeviceFault) -> float:
    """Returns the size of a fault, by default from `SIZES`."""
    return SIZES[fault.word] if fault.size is None else fault.size


def late_by_s(fault: DeviceFault | None) -> float:
    """Returns the delay of a device."""
    return size_of(fault) if fault is not None and fault.word in ("late", "old") else 0.0


def seen_from(truth: Truth, fault: DeviceFault | None, begin: Truth) -> Truth:
    """Returns the truth as seen by a scaled or displaced device.

    Args:
        truth: the vehicle's state.
        fault: the fault of the device.
        begin: the vehicle's state when the fault began.
    """
    if fault is None or fault.word not in ("scaled", "step"):
        return truth
    size = size_of(fault)
    north = east = down = 0.0
    if fault.word == "step":
        north = size
    else:
        pairs = zip(truth.position_ned_m, begin.position_ned_m, strict=True)
        north, east, down = (size * (now - was) for now, was in pairs)
    return _moved(truth, (north, east, down))


def _moved(truth: Truth, by_ned_m: Vector3) -> Truth:
    here = GeoPoint(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
    latitude_deg, longitude_deg, altitude_m = TangentPlane(here).geo_from_ned(by_ned_m)
    return msgspec.structs.replace(truth, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude_m)


def is_silent(fault: DeviceFault | None) -> bool:
    """Whether the device delivers no data."""
    return fault is not None and fault.word == "lost"


def is_stuck(fault: DeviceFault | None) -> bool:
    """Whether the device repeats its last data."""
    return fault is not None and fault.word == "stuck"


def corrupted(used: T, fault: DeviceFault | None) -> T:
    """Returns the data as the fault corrupts it."""
    if isinstance(used, FaultyReading):
        factor = 1.0 + size_of(fault) if fault is not None and fault.word == "scaled" else 1.0
        return used._replace(value=used.value * factor)
    if isinstance(used, Estimated):
        return used
    if isinstance(used, FaultyDepth):
        return used._replace(depth=_corrupted_depth(used.depth, fault, used.t_s))
    if isinstance(used, FaultyCloud):
        return used._replace(cloud=_corrupted_cloud(used.cloud, fault))
    if isinstance(used, Bottom):
        return used._replace(bottom=_corrupted_bottom(used.bottom, fault))
    if fault is None or (fault.word in ALL and not (isinstance(used, FaultyScan) and fault.word == "scaled")):
        return used
    if isinstance(used, FaultyScan):
        return used._replace(scan=_corrupted_scan(used.scan, fault, used.t_s))
    corrupt = partial(CAMERA[fault.word], t_s=used.t_s)
    if isinstance(used, PairExposure):
        return used._replace(left=corrupt(used.left), right=corrupt(used.right))
    return used._replace(image=corrupt(used.image))


def _corrupted_bottom(bottom: BottomVelocity, fault: DeviceFault | None) -> BottomVelocity:
    if fault is None or fault.word != "scaled":
        return bottom
    u, v, w = bottom.velocity_frd_m_s
    factor = 1.0 + size_of(fault)
    return msgspec.structs.replace(bottom, velocity_frd_m_s=(u * factor, v * factor, w * factor))


def _filled(image: Image, t_s: float, grey: int) -> Image:
    del t_s
    return msgspec.structs.replace(image, data=bytes([grey]) * (image.width * image.height), bgr=b"")


def _torn(image: Image, t_s: float) -> Image:
    """Only the upper part has come."""
    del t_s
    return msgspec.structs.replace(image, data=image.data[: len(image.data) * 2 // 3], bgr=b"")


def _small(image: Image, t_s: float) -> Image:
    """Every other pixel: a camera in a wrong mode."""
    del t_s
    pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)[::2, ::2]
    return msgspec.structs.replace(image, width=pixels.shape[1], height=pixels.shape[0], data=pixels.tobytes(), bgr=b"")


def _garbage(image: Image, t_s: float) -> Image:
    """Any value at any pixel."""
    random = _random(image.camera, t_s)
    return msgspec.structs.replace(image, data=random.bytes(image.width * image.height), bgr=b"")


CAMERA: Final[Mapping[str, Callable[..., Image]]] = {
    "black": partial(_filled, grey=0),
    "white": partial(_filled, grey=255),
    "torn": _torn,
    "small": _small,
    "garbage": _garbage,
}
"""Faults of cameras."""

DEPTH: Final = ("zero", "torn", "garbage")
"""Faults of depth cameras: no pixel has a depth, the lower part is missing, or anything. A scaled one's are too long."""


def _corrupted_depth(depth: DepthImage, fault: DeviceFault | None, t_s: float) -> DepthImage:
    spoils: Mapping[str, Callable[[], bytes]] = {
        "zero": lambda: bytes(len(depth.data)),
        "torn": lambda: depth.data[: len(depth.data) * 2 // 3],
        "garbage": lambda: _random(depth.camera, t_s).bytes(len(depth.data)),
        "scaled": lambda: _lengthened(depth, 1.0 + size_of(fault) if fault is not None else 1.0),
    }
    if fault is None or fault.word not in spoils:
        return depth
    return msgspec.structs.replace(depth, data=spoils[fault.word]())


def _lengthened(depth: DepthImage, factor: float) -> bytes:
    units = np.rint(np.frombuffer(depth.data, "<u2") * factor)
    return np.where(units * depth.scale_m <= depth.range_max_m, units, 0).astype("<u2").tobytes()


LASER: Final = ("zero", "far", "nan", "garbage")
"""Faults of scanners: all ranges are 0, the greatest, no number, or anything. A scaled one's are too long by a share."""


def _corrupted_scan(scan: LaserScan, fault: DeviceFault, t_s: float) -> LaserScan:
    ranges = np.frombuffer(scan.ranges_m, "<f4")
    spoils: Mapping[str, Callable[[], NDArray[np.floating]]] = {
        "zero": lambda: np.zeros(len(ranges)),
        "far": lambda: np.full(len(ranges), scan.range_max_m),
        "nan": lambda: np.full(len(ranges), np.nan),
        "scaled": lambda: np.minimum(ranges * (1.0 + size_of(fault)), scan.range_max_m),
        "garbage": lambda: _random(scan.scanner, t_s).uniform(0.0, scan.range_max_m, len(ranges)),
    }
    return msgspec.structs.replace(scan, ranges_m=spoils[fault.word]().astype("<f4").tobytes())


def _corrupted_cloud(cloud: PointCloud, fault: DeviceFault | None) -> PointCloud:
    if fault is None or fault.word != "scaled":
        return cloud
    origin = np.tile(np.array(cloud.origin_frd_m), len(cloud.data) // 12)
    points = origin + (1.0 + size_of(fault)) * (np.frombuffer(cloud.data, "<f4") - origin)
    return msgspec.structs.replace(cloud, data=points.astype("<f4").tobytes())


def _random(name: str, t_s: float) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64([crc32(name.encode()), max(0, round(t_s * 1e6))]))
