"""Pictures as JPEG and PNG files with EXIF and XMP, as photogrammetry programs read them.

EXIF has the time, camera, focal length and position. XMP has the attitude and the lens in Pix4D's schema, which
OpenDroneMap and Agisoft Metashape read, too.
"""

import io
from datetime import UTC, datetime
from html import escape
from math import atan2, degrees, hypot, pi, sqrt
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from gloc3.camera.model import CameraModel, Lens
from gloc3.errors import Misuse
from gloc3.messages.frames import GeoPoint, Quaternion, TangentPlane, Vector3, multiply, rotate, to_euler

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

JPEG: Final = ".jpg"
PNG: Final = ".png"
SOFTWARE: Final = "GLOC3"
FILM_WIDTH_MM: Final = 36.0
"""Width of a 35 mm picture, to which an equivalent focal length refers."""
_RDF_FROM_PLATE: Final[Quaternion] = (sqrt(0.5), 0.0, 0.0, -sqrt(0.5))
"""From axes (top of the picture, right, along the view), which are a body's axes for a camera that looks down."""
_UPRIGHT_SINE: Final = 0.99999
"""Sine of the pitch above which yaw and roll are not separable."""
_LEVEL: Final = 0.5
"""Horizontal part of the viewing direction below which the picture's top is its direction."""
_EXIF, _GPS = 0x8769, 0x8825
_XMP_PNG: Final = "XML:com.adobe.xmp"


class PhotoTags(NamedTuple):
    """When, where and with which camera a picture was taken."""

    camera: str
    """The camera's name on the platform."""
    ned_from_frd: Quaternion
    """Attitude of the vehicle."""
    position_ned_m: Vector3
    """Position of the vehicle."""
    origin_geo: tuple[float, float, float] | None = None
    """Origin of that position; without one, a picture has no position in its tags."""
    position_std_m: Vector3 = (0.0, 0.0, 0.0)
    """Standard deviation of the position; 0 if unknown."""
    utc_s: float | None = None
    """Time in seconds since 1970; None if unknown."""
    model: CameraModel | None = None
    """The calibration."""


def camera_position(tags: PhotoTags) -> GeoPoint | None:
    """Position of the optical centre on Earth; None without an origin."""
    if tags.origin_geo is None:
        return None
    lever = rotate(tags.ned_from_frd, tags.model.position_frd_m) if tags.model is not None else (0.0, 0.0, 0.0)
    north, east, down = (a + b for a, b in zip(tags.position_ned_m, lever, strict=True))
    return TangentPlane(GeoPoint(*tags.origin_geo)).geo_from_ned((north, east, down))


def camera_angles_deg(tags: PhotoTags) -> tuple[float, float, float] | None:
    """Yaw, pitch and roll of the camera in Pix4D's convention, degrees; None for an unknown mounting.

    At 0, 0, 0 the camera looks down and the top of its picture points north; at pitch 90 it looks ahead.
    """
    if tags.model is None:
        return None
    plate = multiply(multiply(tags.ned_from_frd, tags.model.frd_from_rdf), _RDF_FROM_PLATE)
    roll, pitch, yaw = to_euler(plate)
    top = rotate(plate, (1.0, 0.0, 0.0))
    if abs(top[2]) > _UPRIGHT_SINE:
        sign = 1.0 if top[2] < 0.0 else -1.0
        ahead = rotate(plate, (0.0, 0.0, 1.0))
        yaw, pitch, roll = atan2(sign * ahead[1], sign * ahead[0]), sign * pi / 2.0, 0.0
    return degrees(yaw), degrees(pitch), degrees(roll)


def view_direction_deg(tags: PhotoTags) -> float:
    """Direction of the view from north, clockwise, 0 to 360; of the top of the picture if it looks down or up."""
    seen = multiply(tags.ned_from_frd, tags.model.frd_from_rdf if tags.model is not None else (0.5, 0.5, 0.5, 0.5))
    north, east, _ = rotate(seen, (0.0, 0.0, 1.0))
    if hypot(north, east) < _LEVEL:
        north, east, _ = rotate(seen, (0.0, -1.0, 0.0))
    return round(degrees(atan2(east, north)), 2) % 360.0


def encode_picture(pixels: "NDArray[np.uint8]", tags: PhotoTags, suffix: str = JPEG, quality: int = 95) -> bytes:
    """Encodes a picture.

    Args:
        pixels: grey values of shape `(rows, columns)`, or blue, green and red of shape `(rows, columns, 3)`.
        tags: its metadata.
        suffix: `.jpg` or `.png`.
        quality: of JPEG, 1 to 100.

    Raises:
        Misuse: the suffix is another.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    height, width = pixels.shape[:2]
    data = pixels.tobytes()
    picture = (
        Image.frombytes("L", (width, height), data)
        if pixels.ndim == 2
        else Image.frombytes("RGB", (width, height), data, "raw", "BGR")
    )
    exif, xmp, file = _exif(tags, width, height), _xmp(tags), io.BytesIO()
    if suffix == JPEG:
        picture.save(file, "JPEG", quality=quality, exif=exif, xmp=xmp.encode())
    elif suffix == PNG:
        info = PngInfo()
        info.add_itxt(_XMP_PNG, xmp)
        picture.save(file, "PNG", compress_level=1, exif=exif, pnginfo=info)
    else:
        raise Misuse(f"{suffix} is neither {JPEG} nor {PNG}")
    return file.getvalue()


def _exif(tags: PhotoTags, width: int, height: int) -> Any:
    from PIL import Image
    from PIL.ExifTags import Base

    exif = Image.Exif()
    model = tags.model
    exif[Base.Make] = (model.make if model is not None else "") or SOFTWARE
    exif[Base.Model] = (model.product if model is not None else "") or tags.camera
    exif[Base.ImageDescription] = tags.camera
    exif[Base.Software] = SOFTWARE
    exif[Base.Orientation] = exif[Base.YCbCrPositioning] = 1
    exif[Base.XResolution] = exif[Base.YResolution] = _ratio(72, 1)
    exif[Base.ResolutionUnit] = 2
    own = exif.get_ifd(_EXIF)
    own[Base.ExifVersion], own[Base.FlashPixVersion] = b"0232", b"0100"
    own[Base.ColorSpace] = 1  # sRGB
    own[Base.ExifImageWidth], own[Base.ExifImageHeight] = width, height
    if model is not None:
        focal_px = model.focal_px[0]
        own[Base.FocalLengthIn35mmFilm] = max(1, round(focal_px / model.width * FILM_WIDTH_MM))
        if model.pixel_um is not None:
            own[Base.FocalLength] = _ratio(focal_px * model.pixel_um * 1e-3, 10_000)
            own[Base.FocalPlaneXResolution] = own[Base.FocalPlaneYResolution] = _ratio(1e4 / model.pixel_um, 1000)
            own[Base.FocalPlaneResolutionUnit] = 3  # a centimetre
    gps = exif.get_ifd(_GPS)
    if tags.utc_s is not None:
        _add_time(exif, own, gps, tags.utc_s)
    place = camera_position(tags)
    if place is not None:
        _add_place(gps, place, view_direction_deg(tags))
    return exif


def _add_time(exif: Any, own: Any, gps: Any, utc_s: float) -> None:
    from PIL.ExifTags import GPS, Base

    whole_s, micros = divmod(round(utc_s * 1e6), 1_000_000)
    moment = datetime.fromtimestamp(whole_s, UTC)
    text, below = f"{moment:%Y:%m:%d %H:%M:%S}", f"{micros:06d}"
    exif[Base.DateTime] = own[Base.DateTimeOriginal] = own[Base.DateTimeDigitized] = text
    own[Base.SubsecTime] = own[Base.SubsecTimeOriginal] = own[Base.SubsecTimeDigitized] = below
    own[Base.OffsetTime] = own[Base.OffsetTimeOriginal] = own[Base.OffsetTimeDigitized] = "+00:00"
    gps[GPS.GPSDateStamp] = f"{moment:%Y:%m:%d}"
    gps[GPS.GPSTimeStamp] = (
        _ratio(moment.hour, 1),
        _ratio(moment.minute, 1),
        _ratio(moment.second + micros * 1e-6, 1_000_000),
    )


def _add_place(gps: Any, place: GeoPoint, direction_deg: float) -> None:
    from PIL.ExifTags import GPS

    gps[GPS.GPSVersionID] = b"\x02\x03\x00\x00"
    gps[GPS.GPSLatitudeRef], gps[GPS.GPSLatitude] = ("SN"[place.latitude_deg >= 0.0], _sexagesimal(place.latitude_deg))
    gps[GPS.GPSLongitudeRef] = "WE"[place.longitude_deg >= 0.0]
    gps[GPS.GPSLongitude] = _sexagesimal(place.longitude_deg)
    gps[GPS.GPSAltitudeRef] = b"\x00" if place.altitude_m >= 0.0 else b"\x01"
    gps[GPS.GPSAltitude] = _ratio(abs(place.altitude_m), 1000)
    gps[GPS.GPSMapDatum] = "WGS-84"
    gps[GPS.GPSImgDirectionRef] = "T"
    gps[GPS.GPSImgDirection] = _ratio(direction_deg, 100)


def _ratio(value: float, denominator: int) -> Any:
    from PIL.TiffImagePlugin import IFDRational

    return IFDRational(round(value * denominator), denominator)


def _sexagesimal(angle_deg: float) -> tuple[Any, Any, Any]:
    """Degrees, minutes and seconds; the seconds to a hundred-thousandth, which is 0.3 mm on Earth."""
    steps = round(abs(angle_deg) * 3600 * 100_000)
    minutes, rest = divmod(steps, 60 * 100_000)
    whole, minutes = divmod(minutes, 60)
    return _ratio(whole, 1), _ratio(minutes, 1), _ratio(rest / 100_000, 100_000)


def _xmp(tags: PhotoTags) -> str:
    fields: dict[str, str] = {}
    angles = camera_angles_deg(tags)
    if angles is not None:
        fields |= {
            f"Camera:{name}": f"{round(angle, 4) + 0.0:.4f}"
            for name, angle in zip(("Yaw", "Pitch", "Roll"), angles, strict=True)
        }
    if tags.origin_geo is not None and any(tags.position_std_m):
        north, east, down = tags.position_std_m
        fields |= {"Camera:GPSXYAccuracy": f"{max(north, east):.4f}", "Camera:GPSZAccuracy": f"{down:.4f}"}
    if tags.model is not None:
        fields |= _lens_fields(tags.model)
    listed = "".join(f'\n   {name}="{escape(value)}"' for name, value in fields.items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n'
        ' <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        '  <rdf:Description rdf:about=""\n'
        f'   xmlns:Camera="http://pix4d.com/camera/1.0/"{listed}/>\n'
        " </rdf:RDF>\n"
        "</x:xmpmeta>\n"
        '<?xpacket end="w"?>'
    )


def _lens_fields(model: CameraModel) -> dict[str, str]:
    """The lens in Pix4D's schema: lengths in millimetres on the sensor, so only where the pixels' size is known."""
    if model.lens is Lens.EQUIDISTANT:
        return {"Camera:ModelType": "fisheye"}
    fields = {"Camera:ModelType": "perspective"}
    if model.pixel_um is not None:
        pixel_mm = model.pixel_um * 1e-3
        column, row = model.center_px
        k1, k2, p1, p2, k3 = (*model.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        fields |= {
            "Camera:PerspectiveFocalLength": f"{model.focal_px[0] * pixel_mm:.6f}",
            "Camera:PrincipalPoint": f"{(column + 0.5) * pixel_mm:.6f},{(row + 0.5) * pixel_mm:.6f}",
            "Camera:PerspectiveDistortion": ",".join(f"{value:.8g}" for value in (k1, k2, k3, p1, p2)),
        }
    return fields
