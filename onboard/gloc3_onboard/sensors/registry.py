"""The kinds of sensors and of their sources: found in three rooms and installed packages, created from URLs.

A package adds its own by an entry point of the group `gloc3.sensors`, which names a module with `SENSORS` or `SOURCES`.
"""

import asyncio
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import parse_qsl

from gloc3.errors import Misuse, Refused, nearest
from gloc3.installed import installed_points
from gloc3.messages.vehicle import Image
from gloc3.platform.platform import Platform
from gloc3_onboard.autopilot.sensors import AutopilotSensors
from gloc3_onboard.sensors import camera_sources, lidar_sources, sources
from gloc3_onboard.sensors.devices import HeightSensor
from gloc3_onboard.sensors.replay import LogTime, Recorded
from gloc3_onboard.sensors.source_url import Options, SourceUrl, device_problem, option_problem

ENTRY_POINTS: Final = "gloc3.sensors"
NOWHERE: Final = "none://"
"""The source of a device that is not plugged in."""


class SourceHost(NamedTuple):
    """Inputs of sources."""

    loop: asyncio.AbstractEventLoop
    folder: Path
    """To which files are relative."""
    t_s_of_boot: Callable[[float], float | None]
    """Maps the vehicle's time since boot to ours."""
    sensors: AutopilotSensors | None = None
    height: HeightSensor | None = None
    """The autopilot's own; None in a process without its link."""
    time_shift_s: Callable[[str], float] = lambda _camera: 0.0
    """What a camera's calibration adds to its stamps, s."""


class SensorKind(NamedTuple):
    """Kinds of sensors."""

    name: str
    """The end of such devices' names: `front_laser` is a `laser`."""
    replay: Callable[[asyncio.AbstractEventLoop, LogTime, Callable[[], Sequence[Recorded[Any]]]], Any]
    """Makes the device that plays recorded data."""
    recorded: Callable[[Path, str, str], Sequence[Recorded[Any]]]
    """The data of such a device in our own logs: of the log, the part of it (empty for the usual one), and the device."""
    poll: Callable[[Any], Sequence[Image]] = lambda _: ()
    """Reads a device, which raises `Gloc3Error` if it is lost; returns the images of a camera."""
    cameras: Callable[[str], tuple[str, ...]] = lambda _: ()
    """The names of a device's cameras."""


class SourceRequest(NamedTuple):
    """One device that is to be made."""

    device: str
    url: SourceUrl
    sensor: SensorKind
    host: SourceHost
    urls: Mapping[str, SourceUrl]
    """The sources of all devices."""
    shared: dict[tuple[str, str], Any]
    """What several devices have in common, by scheme and place: the time of a log, a camera of several streams."""

    @property
    def path(self) -> Path:
        """The file that the source names."""
        return self.url.path(self.host.folder)

    @property
    def now_s(self) -> Callable[[], float]:
        """Our time."""
        return self.host.loop.time

    def replayed(self, index: Callable[[], Sequence[Recorded[Any]]]) -> Any:
        """The device that plays recorded data, which is read when it is opened; devices of one log stay together."""
        time: LogTime = self.shared.setdefault(
            (self.url.scheme, str(self.path)), LogTime(self.url.number("skip_s", 0.0))
        )
        return self.sensor.replay(self.host.loop, time, index)

    def other(self, device: str) -> Any:
        """Another device, made for this one."""
        return _made(self._replace(device=device, url=self.urls[device], sensor=_sensor(device)))


class SourceKind(NamedTuple):
    """One scheme of URLs."""

    scheme: str
    sensors: tuple[str, ...]
    """What it can be the source of; none for every kind of sensor."""
    example: str
    make: Callable[[SourceRequest], Any]
    """Makes the device.

    Raises:
        Refused: the URL names what cannot be.
    """
    options: Options = {}
    takes_place: bool = True
    takes_part: bool = False
    """Whether a part after `#` is allowed."""
    is_verbatim: bool = False
    """Whether everything after `://` is the place."""
    is_file: bool = False
    """Whether its place is a file or folder."""
    group: str = ""
    """The group of users that may open its device file; empty where it has none."""
    problem: Callable[[], str] = lambda: ""
    """Reason why this kind cannot be opened on this computer; empty if it can."""
    device_files: Callable[[SourceUrl], Sequence[Path]] = lambda url: [url.device_file] if url.device_file else []
    """The device files that it opens."""

    @property
    def brings(self) -> tuple[str, ...]:
        """The kinds of sensors that it can be the source of."""
        return self.sensors or tuple(sensor_kinds())


def sensor_kinds() -> Mapping[str, SensorKind]:
    """The kinds of sensors by name."""
    return _rows()[0]


def source_kinds() -> Mapping[str, SourceKind]:
    """The kinds of sources by scheme."""
    return _rows()[1]


@cache
def _rows() -> tuple[Mapping[str, SensorKind], Mapping[str, SourceKind]]:
    rooms = (camera_sources, lidar_sources, sources)
    modules = [
        import_module(f"{room.__name__}.{one.name}") for room in rooms for one in pkgutil.iter_modules(room.__path__)
    ]
    modules += [point.load() for point in installed_points(ENTRY_POINTS)]
    sensors: dict[str, SensorKind] = {}
    schemes: dict[str, SourceKind] = {}
    for module in modules:
        for sensor in getattr(module, "SENSORS", ()):
            if sensors.setdefault(sensor.name, sensor) is not sensor:
                raise Misuse(f"two modules define a sensor called {sensor.name!r}")
        for source in getattr(module, "SOURCES", ()):
            if schemes.setdefault(source.scheme, source) is not source:
                raise Misuse(f"two modules define a source called {source.scheme!r}")
    return sensors, schemes


def sensor_of(device: str) -> SensorKind | None:
    """Kind of sensor of a device name: `front_laser` is a laser; None if it is no sensor."""
    fitting = [name for name in sensor_kinds() if device == name or device.endswith(f"_{name}")]
    return sensor_kinds()[max(fitting, key=len)] if fitting else None


def _sensor(device: str) -> SensorKind:
    sensor = sensor_of(device)
    if sensor is None:
        raise Refused(f"device {device!r} is not a sensor: sensor names end in {', '.join(sensor_kinds())}")
    return sensor


def parse_source(device: str, text: str) -> SourceUrl:
    """Takes a source apart.

    Args:
        device: for which it is, by name.
        text: the URL.

    Raises:
        Refused: it is none, or none for this device; with the reason and an example.
    """
    sensor, kinds = _sensor(device), source_kinds()
    name, colon, rest = text.partition("://")
    fitting = {scheme: kind for scheme, kind in kinds.items() if sensor.name in kind.brings}
    if not colon or name not in kinds:
        example = next(kind.example for kind in fitting.values() if kind.takes_place)
        hint = nearest(name, list(fitting)) if colon else f"write SCHEME://PLACE, such as {example}"
        raise Refused(f"{device}: {text!r} is not a source; {hint}")
    kind = kinds[name]
    if sensor.name not in kind.brings:
        raise Refused(f"{device}: {name}:// provides {' or '.join(kind.brings)}, but this is a {sensor.name}")
    if kind.is_verbatim:
        url = SourceUrl(text, name, rest, {}, "")
    else:
        rest, _, part = rest.partition("#")
        place, _, query = rest.partition("?")
        url = SourceUrl(text, name, place, dict(parse_qsl(query, keep_blank_values=True)), part)
    if url.part and not kind.takes_part:
        raise Refused(f"{device}: {text!r}: {name}:// allows nothing after #, as in {kind.example}")
    for option, value in url.options.items():
        if option not in kind.options:
            raise Refused(f"{device}: {text!r}: it has no option {option!r}; {nearest(option, sorted(kind.options))}")
        if problem := option_problem(kind.options, option, value):
            raise Refused(f"{device}: {text!r}: {problem}")
    if not kind.takes_place and url.place:
        raise Refused(f"{device}: {text!r} has no address: {kind.example}")
    if kind.takes_place and not url.place:
        raise Refused(f"{device}: {text!r} names nothing behind ://; {kind.example}")
    return url


def library_problem(module: str, extra: str) -> Callable[[], str]:
    """A check of a kind of source: whether a library of an extra is installed."""
    text = f"it needs the library {module}, which is not installed: pip install 'gloc3[{extra}]'"
    return lambda: "" if find_spec(module) is not None else text


def make_sources(urls: Mapping[str, str], host: SourceHost) -> dict[str, Any]:
    """The devices by name.

    Args:
        urls: sources of all devices of a platform, by device.
        host: context for creating them.

    Raises:
        Refused: a source is wrong.
    """
    parsed = {name: parse_source(name, text) for name, text in sorted(urls.items())}
    shared: dict[tuple[str, str], Any] = {}
    return {name: _made(SourceRequest(name, url, _sensor(name), host, parsed, shared)) for name, url in parsed.items()}


def _made(request: SourceRequest) -> Any:
    kind = source_kinds()[request.url.scheme]
    device = kind.make(request)
    names = () if kind.is_file or kind.scheme in _WITHOUT_SHIFT else request.sensor.cameras(request.device)
    shift_s = next(map(request.host.time_shift_s, names), 0.0)  # the pictures of a pair are of one time
    return _ShiftedCamera(device, shift_s) if shift_s else device


_WITHOUT_SHIFT: Final = ("none", "pair")
"""Schemes of cameras that have no stamps of their own; those of a pair's cameras are shifted already."""


class _ShiftedCamera:
    """A camera of any kind whose stamps are corrected as its calibration says; logs hold corrected times already.

    Args:
        device: the camera.
        shift_s: added to its stamps.
    """

    def __init__(self, device: Any, shift_s: float) -> None:
        self._device, self._shift_s = device, shift_s
        self.open, self.close, self.on_new_data = device.open, device.close, device.on_new_data

    def frame(self) -> Any:
        """The latest frame of a camera."""
        return self._shifted(self._device.frame())

    def pair(self) -> Any:
        """The latest frames of a pair."""
        return self._shifted(self._device.pair())

    def depth(self) -> Any:
        """The latest frame of a depth camera."""
        return self._shifted(self._device.depth())

    def _shifted(self, stamped: Any) -> Any:
        return stamped and stamped._replace(t_s=stamped.t_s + self._shift_s)


def source_urls(platform: Platform, used: Sequence[str], overrides: Sequence[str]) -> dict[str, str]:
    """Source of each sensor: the requested one, else the platform file's, else none.

    Raises:
        Refused: a request is not NAME=URL, or the platform has no such device.
    """
    sensors = {name for name in (*used, *platform.devices) if sensor_of(name) is not None}
    urls = {name: platform.devices.get(name, NOWHERE) for name in sorted(sensors)}
    for text in overrides:
        name, equals, url = text.partition("=")
        if not equals:
            raise Refused(f"--device {text!r} must be NAME=URL, such as ground_camera=v4l2:///dev/video0")
        if name not in urls:
            raise Refused(f"--device {text!r}: {platform.platform} has no sensor {name!r}; {nearest(name, [*urls])}")
        scheme, separator, place = url.partition("://")
        urls[name] = f"{scheme}{separator}{_from_here(scheme, place)}"
    return urls


def is_interactive(platform: Platform, used: Sequence[str], text: str) -> bool:
    """Whether a requested source, as NAME=URL, is for this process or for no device of the platform."""
    name = text.partition("=")[0]
    return name in used or not any(name in row.devices.values() for row in platform.components)


def _from_here(scheme: str, place: str) -> str:
    """On a command line files are relative to where it was typed, in a platform file to that file."""
    kind = source_kinds().get(scheme)
    is_relative = kind is not None and kind.is_file and not place.startswith("/")
    return str(Path.cwd() / place) if is_relative else place


def place_problem(url: SourceUrl, folder: Path) -> str:
    """Reason why a source will not open and what to do, found without opening it; empty if none is known.

    Args:
        url: the source.
        folder: base of relative file names.
    """
    kind = source_kinds()[url.scheme]
    if problem := kind.problem():
        return problem
    for path in kind.device_files(url) if kind.group else ():
        if problem := device_problem(path, kind.group):
            return problem
    if kind.is_file:
        path = url.path(folder)
        if not (path.parent.is_dir() if "%" in path.name else path.exists()):
            return f"{url.place} is not there; files are relative to the platform file"
    return ""
