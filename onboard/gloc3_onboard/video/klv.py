"""Pose of a camera beside its video: a local set of MISB ST 0601 (KLV), one for each picture."""

from math import atan, degrees
from typing import Final

from gloc3.camera.model import CameraModel
from gloc3.messages.frames import GeoPoint, Quaternion, TangentPlane, Vector3, multiply, rotate, to_euler
from gloc3.messages.vehicle import Pose

KEY: Final = bytes.fromhex("060E2B34020B01010E01030101000000")
VERSION: Final = 19
"""Of ST 0601."""
_RDF_FROM_FRD: Final[Quaternion] = (0.5, -0.5, -0.5, -0.5)
_ALTITUDE_M: Final = (-900.0, 19_000.0)


def local_set(time_us: int, pose: Pose, camera: str, model: CameraModel | None, *, is_fixed: bool) -> bytes:
    """Place and attitude of the vehicle and its camera, with a checksum.

    Args:
        time_us: UTC in microseconds since 1970.
        pose: the vehicle's; without an origin on Earth there is no place.
        camera: its name.
        model: its calibration; None if unknown.
        is_fixed: whether the camera is fixed to the body, so that its attitude follows from the model.
    """
    items = [_item(2, time_us.to_bytes(8, "big")), _item(65, bytes([VERSION]))]
    roll, pitch, yaw = (degrees(angle) for angle in to_euler(pose.ned_from_frd))
    items += [_item(5, unsigned(yaw % 360.0, 0.0, 360.0, 2)), _item(90, signed(pitch, 90.0, 4))]
    if abs(roll) <= 90.0:
        items.append(_item(91, signed(roll, 90.0, 4)))
    items.append(_item(11, camera.encode()))
    if pose.origin_geo is not None:
        place = _place(pose, model.position_frd_m if model is not None and is_fixed else (0.0, 0.0, 0.0))
        items += [_item(13, signed(place.latitude_deg, 90.0, 4)), _item(14, signed(place.longitude_deg, 180.0, 4))]
        items.append(_item(15, unsigned(place.altitude_m, *_ALTITUDE_M, 2)))
    if model is not None:
        wide, high = (
            degrees(2.0 * atan(size / 2.0 / focal))
            for size, focal in zip((model.width, model.height), model.focal_px, strict=True)
        )
        items += [_item(16, unsigned(wide, 0.0, 180.0, 2)), _item(17, unsigned(high, 0.0, 180.0, 2))]
    if model is not None and is_fixed:
        turn, up, around = (degrees(a) for a in to_euler(multiply(model.frd_from_rdf, _RDF_FROM_FRD)))
        items += [_item(18, unsigned(around % 360.0, 0.0, 360.0, 4)), _item(19, signed(up, 180.0, 4))]
        items.append(_item(20, unsigned(turn % 360.0, 0.0, 360.0, 4)))
    body = b"".join(items)
    head = KEY + _length(len(body) + 4) + body + bytes((1, 2))
    return head + checksum(head).to_bytes(2, "big")


def signed(value: float, most: float, size: int) -> bytes:
    """A value from -`most` to `most` as a whole number of so many bytes; others are limited."""
    top = (1 << 8 * size - 1) - 1
    return round(min(max(value, -most), most) / most * top).to_bytes(size, "big", signed=True)


def unsigned(value: float, least: float, most: float, size: int) -> bytes:
    """A value between two bounds as a whole number of so many bytes; others are limited."""
    top = (1 << 8 * size) - 1
    return round((min(max(value, least), most) - least) / (most - least) * top).to_bytes(size, "big")


def checksum(data: bytes) -> int:
    """Sum of the data in words of 16 bits."""
    return sum(byte << 8 if index % 2 == 0 else byte for index, byte in enumerate(data)) & 0xFFFF


def _item(tag: int, value: bytes) -> bytes:
    return bytes((tag,)) + _length(len(value)) + value


def _length(size: int) -> bytes:
    """Length in BER: the short form, or one more byte."""
    return bytes((size,)) if size < 128 else bytes((0x81, size))


def _place(pose: Pose, lever_frd_m: Vector3) -> GeoPoint:
    """Place of the camera."""
    assert pose.origin_geo is not None
    lever = rotate(pose.ned_from_frd, lever_frd_m)
    north, east, down = (a + b for a, b in zip(pose.position_ned_m, lever, strict=True))
    return TangentPlane(GeoPoint(*pose.origin_geo)).geo_from_ned((north, east, down))
