"""The one form in which a device's source is written: `SCHEME://PLACE?OPTION=VALUE&…#PART`."""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import parse_qsl

from gloc3.errors import Refused, nearest


class Sensor(StrEnum):
    """What a device senses; told by the end of its name."""

    STEREO = "stereo_camera"
    CAMERA = "camera"
    LASER = "laser"
    IMU = "imu"
    HEIGHT = "height"
    DVL = "dvl"


def sensor_of(device: str) -> Sensor | None:
    """What the device of this name senses: `front_laser` is a laser; None for what is no sensor."""
    for sensor in Sensor:
        if device == sensor or device.endswith(f"_{sensor}"):
            return sensor
    return None


class Number(NamedTuple):
    """An option that is a number."""

    low: float
    high: float
    is_whole: bool = False


WIDTH: Final = Number(16, 16_384, True)
RATE: Final = Number(0.1, 1000.0)
SHORT: Final = Number(0.0, 1.0)
VIDEO: Final[Mapping[str, Number | None]] = {
    "width": WIDTH,
    "height": WIDTH,
    "rate_hz": RATE,
    "exposure_s": Number(1e-6, 10.0),
    "gain": Number(0.0, 1e4),
    "format": None,
    "delay_s": SHORT,
}
BAUD: Final = Number(1200, 4_000_000, True)
REPLAY: Final[Mapping[str, Number | None]] = {"skip_s": Number(0.0, 1e6)}
DOPPLER: Final = {"yaw_deg": Number(-360.0, 360.0)}
MOUNT: Final = {"yaw_deg": Number(-360.0, 360.0), "is_flipped": Number(0, 1, True)}


class Scheme(NamedTuple):
    """One kind of source."""

    sensors: tuple[Sensor, ...]
    example: str
    options: Mapping[str, Number | None] = {}
    """Names; None for those that are text."""
    parts: bool = False
    """Whether something may stand behind `#`."""


_EYES: Final = (Sensor.CAMERA, Sensor.STEREO)
SCHEMES: Final[Mapping[str, Scheme]] = {
    "none": Scheme(tuple(Sensor), "none://"),
    "v4l2": Scheme(_EYES, "v4l2:///dev/video0?width=640&height=480&rate_hz=15", VIDEO),
    "gst": Scheme(_EYES, "gst://v4l2src ! videoconvert ! appsink"),
    "rtsp": Scheme(_EYES, "rtsp://192.168.1.20:554/stream", {"delay_s": SHORT}),
    "video": Scheme(_EYES, "video://flight.mp4, or video://pictures/%05d.png?rate_hz=15", {"rate_hz": RATE}),
    "pair": Scheme((Sensor.STEREO,), "pair://left_camera,right_camera?within_s=0.005", {"within_s": SHORT}),
    "tcp": Scheme((*_EYES, Sensor.LASER), "tcp://127.0.0.1:5600", parts=True),
    "rplidar": Scheme((Sensor.LASER,), "rplidar:///dev/ttyUSB0", {"baud": BAUD, "max_m": Number(1, 100), **MOUNT}),
    "hokuyo": Scheme((Sensor.LASER,), "hokuyo:///dev/ttyACM0, or hokuyo://192.168.0.10:10940", {"baud": BAUD, **MOUNT}),
    "a50": Scheme((Sensor.DVL,), "a50://192.168.194.95:16171", {**DOPPLER}),
    "pd6": Scheme((Sensor.DVL,), "pd6:///dev/ttyUSB0, or pd6://192.168.0.20:1033", {"baud": BAUD, **DOPPLER}),
    "autopilot": Scheme((Sensor.LASER, Sensor.IMU, Sensor.HEIGHT), "autopilot://", {"rate_hz": RATE}, parts=True),
    "euroc": Scheme((*_EYES, Sensor.IMU), "euroc://V1_01_easy#cam0", REPLAY, parts=True),
    "kitti": Scheme(_EYES, "kitti://sequences/00#image_0", {**REPLAY, "rate_hz": RATE}, parts=True),
    "carmen": Scheme((Sensor.LASER,), "carmen://aces.log", {**REPLAY, "max_m": Number(0.5, 1000.0)}),
    "mcap": Scheme(tuple(Sensor), "mcap://log.mcap#laser", REPLAY, parts=True),
}
"""Every scheme that there is."""
PLACELESS: Final = ("none", "autopilot")


class SourceUrl(NamedTuple):
    """A source, taken apart and checked."""

    text: str
    scheme: str
    place: str
    """What stands between `://` and `?`: a file, an address, a pipeline."""
    options: Mapping[str, str]
    part: str
    """What stands behind `#`."""

    def number(self, name: str, default: float) -> float:
        """An option that is a number."""
        return float(self.options.get(name, default))

    def path(self, folder: Path) -> Path:
        """The place as a file, relative to a folder."""
        return folder / self.place


def parse_source(device: str, text: str) -> SourceUrl:
    """Takes a source apart.

    Args:
        device: for which it is, by name.
        text: the URL.

    Raises:
        Refused: it is none, or none for this device; with the reason and an example.
    """
    sensor = sensor_of(device)
    if sensor is None:
        raise Refused(f"device {device!r} is no sensor: its name ends in {', '.join(Sensor)}")
    name, colon, rest = text.partition("://")
    fitting = [scheme for scheme, row in SCHEMES.items() if sensor in row.sensors]
    if not colon or name not in SCHEMES:
        hint = nearest(name, fitting) if colon else f"write SCHEME://PLACE, such as {SCHEMES[fitting[1]].example}"
        raise Refused(f"{device}: {text!r} is no source; {hint}")
    row = SCHEMES[name]
    if sensor not in row.sensors:
        raise Refused(f"{device}: {name}:// brings {' or '.join(row.sensors)}, and this is a {sensor}")
    if name == "gst":
        return _with_place(device, SourceUrl(text, name, rest, {}, ""))
    rest, _, part = rest.partition("#")
    place, _, query = rest.partition("?")
    if part and not row.parts:
        raise Refused(f"{device}: {text!r}: {name}:// takes nothing behind #, as in {row.example}")
    options = dict(parse_qsl(query, keep_blank_values=True))
    for option, value in options.items():
        problem = _option_problem(row, option, value)
        if problem:
            raise Refused(f"{device}: {text!r}: {problem}")
    return _with_place(device, SourceUrl(text, name, place, options, part))


def _with_place(device: str, url: SourceUrl) -> SourceUrl:
    example = SCHEMES[url.scheme].example
    if url.scheme in PLACELESS and url.place:
        raise Refused(f"{device}: {url.text!r} takes no place: {example}")
    if url.scheme not in PLACELESS and not url.place:
        raise Refused(f"{device}: {url.text!r} names nothing behind ://; {example}")
    return url


def _option_problem(row: Scheme, name: str, text: str) -> str:
    if name not in row.options:
        return f"it has no option {name!r}; {nearest(name, sorted(row.options))}"
    bounds = row.options[name]
    if bounds is None:
        return "" if text else f"{name} is empty"
    try:
        value = float(text)
    except ValueError:
        return f"{name}={text} is no number"
    if bounds.is_whole and not value.is_integer():
        return f"{name}={text} must be a whole number"
    if not bounds.low <= value <= bounds.high:
        return f"{name}={text} must be from {bounds.low:g} to {bounds.high:g}"
    return ""


def address_of(device: str, url: SourceUrl) -> tuple[str, int]:
    """Host and port of a place that is an address.

    Raises:
        Refused: it is none.
    """
    host, _, port = url.place.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise Refused(f"{device}: {url.text!r}: write an address as {SCHEMES['tcp'].example}")
    return host, int(port)
