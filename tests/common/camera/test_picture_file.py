"""Picture files with their tags, as read by ExifRead, which OpenDroneMap uses, and by an XML parser."""

import io
import xml.etree.ElementTree as ET
from math import cos, degrees, radians, sin
from typing import Any

import exifread
import numpy as np
import pytest
from msgspec.structs import replace

from gloc3.camera.model import CameraModel, Lens
from gloc3.camera.opencv import load_opencv
from gloc3.camera.picture_file import JPEG, PNG, PhotoTags, encode_picture
from gloc3.errors import Misuse
from gloc3.messages.frames import Vector3, from_euler

DOWN = CameraModel(
    width=640,
    height=480,
    focal_px=(400.0, 400.0),
    center_px=(319.5, 239.5),
    lens=Lens.RADTAN,
    distortion=(-0.11, 0.035, 0.0004, -0.0003),
    position_frd_m=(0.5, 0.0, 0.1),
    frd_from_rdf=from_euler(0.0, 0.0, radians(90.0)),
    make="Basler",
    product="daA1280 & 4 mm",
    pixel_um=3.75,
)
AHEAD = replace(DOWN, frd_from_rdf=(0.5, 0.5, 0.5, 0.5))
ORIGIN = (-33.8568, 151.2153, 58.0)
COLOURS = np.zeros((480, 640, 3), np.uint8)
COLOURS[:, :320] = (40, 90, 200)
"""Blue, green and red of rust."""


def tags(model: CameraModel | None = DOWN, euler_deg: Vector3 = (0.0, 0.0, 0.0), **fields: Any) -> PhotoTags:
    given: dict[str, Any] = {
        "camera": "ground",
        "ned_from_frd": from_euler(*map(radians, euler_deg)),
        "position_ned_m": (100.0, -50.0, -60.0),
        "origin_geo": ORIGIN,
        "position_std_m": (0.02, 0.03, 0.05),
        "utc_s": 1_790_000_000.0254,
        "model": model,
        **fields,
    }
    return PhotoTags(**given)


def exif(data: bytes) -> dict[str, Any]:
    found: dict[str, Any] = exifread.process_file(io.BytesIO(data), details=False)
    return found


def degrees_of(tag: Any) -> float:
    whole, minutes, seconds = map(float, tag.values)
    return whole + minutes / 60.0 + seconds / 3600.0


def xmp(data: bytes) -> dict[str, str]:
    text = data[data.index(b"<x:xmpmeta") : data.index(b"</x:xmpmeta>") + len(b"</x:xmpmeta>")]
    (description,) = ET.fromstring(text.decode()).iter("{http://www.w3.org/1999/02/22-rdf-syntax-ns#}Description")
    return {name.rpartition("}")[2]: value for name, value in description.attrib.items()}


@pytest.mark.parametrize("suffix", [JPEG, PNG])
def test_another_reader_finds_time_place_camera_and_focal_length(suffix: str) -> None:
    found = exif(encode_picture(COLOURS, tags(), suffix))
    texts = {name: str(tag) for name, tag in found.items()}
    assert texts["Image Make"] == "Basler"
    assert texts["Image Model"] == "daA1280 & 4 mm"
    assert texts["EXIF DateTimeOriginal"] == "2026:09:21 14:13:20"
    assert texts["EXIF SubSecTimeOriginal"] == "025400"
    assert texts["EXIF OffsetTimeOriginal"] == "+00:00"
    assert texts["GPS GPSDate"] == "2026:09:21"
    assert float(found["EXIF FocalLength"].values[0]) == pytest.approx(1.5)
    assert texts["EXIF FocalLengthIn35mmFilm"] == "22"
    assert (texts["GPS GPSLatitudeRef"], texts["GPS GPSLongitudeRef"]) == ("S", "E")
    north_deg, east_deg = degrees(100.5 / 6_371_000.0), degrees(-50.0 / (6_378_000.0 * cos(radians(33.8568))))
    assert -degrees_of(found["GPS GPSLatitude"]) == pytest.approx(ORIGIN[0] + north_deg, abs=1e-5)
    assert degrees_of(found["GPS GPSLongitude"]) == pytest.approx(ORIGIN[1] + east_deg, abs=1e-5)
    assert float(found["GPS GPSAltitude"].values[0]) == pytest.approx(117.9, abs=0.01)
    assert texts["GPS GPSImgDirectionRef"] == "T"


def test_below_the_sea_west_of_greenwich_and_north_of_the_equator() -> None:
    found = exif(encode_picture(COLOURS, tags(origin_geo=(5.0, -0.5, 1.0), position_ned_m=(0.0, 0.0, 21.0))))
    assert (str(found["GPS GPSLatitudeRef"]), str(found["GPS GPSLongitudeRef"])) == ("N", "W")
    assert degrees_of(found["GPS GPSLongitude"]) == pytest.approx(0.5, abs=1e-6)
    assert int(found["GPS GPSAltitudeRef"].values[0]) == 1
    assert float(found["GPS GPSAltitude"].values[0]) == pytest.approx(20.1)


def test_what_is_unknown_is_left_out() -> None:
    found = exif(encode_picture(COLOURS, tags(None, origin_geo=None, utc_s=None)))
    assert not [name for name in found if name.startswith("GPS") or "DateTime" in name or "Focal" in name]
    assert (str(found["Image Make"]), str(found["Image Model"])) == ("GLOC3", "ground")
    found = exif(encode_picture(COLOURS, tags(replace(DOWN, pixel_um=None, make="", product=""))))
    assert "EXIF FocalLength" not in found
    assert str(found["EXIF FocalLengthIn35mmFilm"]) == "22"


@pytest.mark.parametrize(
    ("model", "euler_deg", "angles_deg", "direction_deg"),
    [
        (DOWN, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0),
        (DOWN, (0.0, 0.0, 120.0), (120.0, 0.0, 0.0), 120.0),
        (DOWN, (4.0, 7.0, -30.0), (-30.0, 7.0, 4.0), 330.0),
        (AHEAD, (0.0, 0.0, 120.0), (120.0, 90.0, 0.0), 120.0),
        (AHEAD, (0.0, -30.0, 45.0), (45.0, 60.0, 0.0), 45.0),
        (AHEAD, (0.0, 15.0, 45.0), (-135.0, 75.0, 180.0), 45.0),
    ],
)
def test_the_attitude_is_the_cameras_by_the_convention_of_photogrammetry(
    model: CameraModel, euler_deg: Vector3, angles_deg: Vector3, direction_deg: float
) -> None:
    data = encode_picture(COLOURS, tags(model, euler_deg))
    found = [float(xmp(data)[name]) for name in ("Yaw", "Pitch", "Roll")]
    direction = float(exif(data)["GPS GPSImgDirection"].values[0])
    assert np.allclose(rotation_of(*found), rotation_of(*angles_deg), atol=1e-4)
    assert direction == pytest.approx(direction_deg, abs=1.0)


def rotation_of(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Any:
    """Yaw about down, then pitch, then roll, written out."""
    (cy, sy), (cp, sp), (cr, sr) = ((cos(radians(a)), sin(radians(a))) for a in (yaw_deg, pitch_deg, roll_deg))
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return yaw @ pitch @ roll


def test_the_lens_is_given_in_millimetres_on_the_sensor() -> None:
    found = xmp(encode_picture(COLOURS, tags()))
    assert found["ModelType"] == "perspective"
    assert float(found["PerspectiveFocalLength"]) == pytest.approx(1.5)
    assert found["PrincipalPoint"] == "1.200000,0.900000"
    assert found["PerspectiveDistortion"] == "-0.11,0.035,0,0.0004,-0.0003"
    assert (found["GPSXYAccuracy"], found["GPSZAccuracy"]) == ("0.0300", "0.0500")
    fisheye = replace(DOWN, lens=Lens.EQUIDISTANT, distortion=(0.1, 0.0, 0.0, 0.0))
    assert xmp(encode_picture(COLOURS, tags(fisheye)))["ModelType"] == "fisheye"


def test_colours_and_greys_are_kept() -> None:
    cv2 = load_opencv()
    for pixels, mode in ((COLOURS, cv2.IMREAD_COLOR), (COLOURS[:, :, 2], cv2.IMREAD_GRAYSCALE)):
        png, jpeg = (
            cv2.imdecode(np.frombuffer(encode_picture(pixels, tags(), suffix), np.uint8), mode)
            for suffix in (PNG, JPEG)
        )
        assert np.array_equal(png, pixels)
        assert np.abs(jpeg[:, :310].astype(int) - pixels[:, :310]).max() < 6


def test_another_format_is_a_mistake_of_the_caller() -> None:
    with pytest.raises(Misuse, match="neither"):
        encode_picture(COLOURS, tags(), ".gif")
