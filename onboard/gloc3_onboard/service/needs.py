"""Needs of a `gloc3 onboard` service on its computer: files that it reads, and devices that it opens."""

import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import quote

from gloc3.errors import Refused
from gloc3.mavlink.transport.endpoints import parse_url
from gloc3.platform.places import choose_host, clock_host, place_of
from gloc3.platform.platform import Platform
from gloc3_onboard.cli.onboard_options import DEFAULT_STATION, OnboardOptions
from gloc3_onboard.sensors.registry import parse_source, source_kinds, source_urls
from gloc3_onboard.sensors.source_url import SERIAL_GROUP, VIDEO_GROUP

HOMES: Final = (Path("/home"), Path("/root"), Path("/run/user"))
"""Folders hidden from the service, except for the paths it needs there."""
PRIVATE: Final = (Path("/tmp"), Path("/var/tmp"))
"""Folders of which the service has private ones."""


class DeviceNodeKind(NamedTuple):
    """A kind of device node, which may come and go with its plug."""

    allowed: str
    """As `DeviceAllow` names the whole class."""
    module: str
    """Kernel module that provides the device."""
    group: str


KINDS: Final = {
    "ttyACM": DeviceNodeKind("char-ttyACM", "cdc_acm", SERIAL_GROUP),
    "ttyUSB": DeviceNodeKind("char-ttyUSB", "usbserial", SERIAL_GROUP),
    "video": DeviceNodeKind("char-video4linux", "videodev", VIDEO_GROUP),
}
"""Kinds of device nodes, by name without its number."""
OF_THE_BOARD: Final = frozenset({"ttyAMA", "ttyTHS", "ttyS", "ttyO", "ttymxc", "ttyLP", "ttySC", "serial"})
"""Serial ports of the computer itself, by name without its number: there, or not built in."""


class DeviceNode(NamedTuple):
    """A device that the service opens."""

    role: str
    """What it is for: `autopilot`, `station`, or the platform's name of the sensor."""
    path: Path
    group: str

    @property
    def kinds(self) -> list[DeviceNodeKind]:
        """Possible kinds, by name, or by group while unplugged; none for a device of the board."""
        name = re.sub(r"\d+$", "", self.path.resolve().name)
        if name in KINDS:
            return [KINDS[name]]
        return (
            []
            if self.path.exists() or name in OF_THE_BOARD
            else [kind for kind in KINDS.values() if kind.group == self.group]
        )


def nodes(platform: Platform, options: OnboardOptions) -> list[DeviceNode]:
    """Devices to open: those of the host's components and, on the clock host, those of the links.

    Raises:
        Refused: a URL is wrong, or the platform has no such host.
    """
    host, found = choose_host(platform, options.host), []
    links = [("autopilot", options.autopilot)]
    links += [
        ("station" if number == 1 else f"station_{number}", url)
        for number, url in enumerate(options.station or [DEFAULT_STATION], 1)
    ]
    for role, url in links if host == clock_host(platform) else ():
        if device := parse_url(url).device:
            found.append(DeviceNode(role, Path(device), SERIAL_GROUP))
    rows = [row for row in platform.components if place_of(platform, row).host == host]
    used = sorted({device for row in rows for device in row.devices.values()})
    for name, text in source_urls(platform, used, options.device).items():
        if name not in used:
            continue
        source = parse_source(name, text)
        kind = source_kinds()[source.scheme]
        found += [DeviceNode(name, path, kind.group) for path in kind.device_files(source) if kind.group]
    return found


def arguments(options: OnboardOptions) -> Iterator[str]:
    """The options as words of a command line that means the same from every folder; those of their default are left out."""
    standard = OnboardOptions()
    for one in fields(OnboardOptions):
        value, name = getattr(options, one.name), "--" + one.name.replace("_", "-")
        if value == getattr(standard, one.name):
            continue
        if value is True:
            yield name
        else:
            for each in value if isinstance(value, list) else [value]:
                yield f"{name}={_absolute(each)}"


def _absolute(value: object) -> str:
    if isinstance(value, Path):
        return str(value.expanduser().absolute())
    text = str(value)
    if "key=" in text and (key := parse_url(text).key):
        address, _, rest = text.partition("?")
        others = [option for option in rest.split("&") if not option.startswith("key=")]
        return f"{address}?{'&'.join([*others, 'key=' + quote(str(Path(key).expanduser().absolute()))])}"
    return text


def keys(options: OnboardOptions) -> list[Path]:
    """Key files, readable by the service's user only."""
    named = [parse_url(url).key for url in (options.autopilot, *options.station)]
    found = [Path(name).expanduser().absolute() for name in named if name]
    return found + ([] if options.signing_key is None else [options.signing_key.expanduser().absolute()])


def homes(files: Iterable[Path]) -> tuple[Path, ...]:
    """The folders in people's homes that the service has to see: those of its files, and of the program itself.

    Raises:
        Refused: a file is where the service cannot see it, or where it would see a whole home.
    """
    wanted: set[Path] = set()
    for file in files:
        if any(file.is_relative_to(place) for place in PRIVATE):
            raise Refused(f"{file}: a service has its own {file.parts[1]}; put the file elsewhere, such as /etc/gloc3")
        home = _home_of(file)
        if home is None:
            continue
        if file.parent in (home, *(() if home == Path("/root") else (home / file.relative_to(home).parts[0],))):
            raise Refused(f"{file}: the service would see all of {file.parent}; put the file into a folder of its own")
        wanted.add(file.parent)
    program = {Path(sys.prefix), Path(sys.base_prefix), *(Path(place) for place in sys.path if place)}
    wanted |= {path for path in program if _home_of(path) is not None and path.exists()}
    return tuple(path for path in sorted(wanted) if not any(path != one and path.is_relative_to(one) for one in wanted))


def _home_of(path: Path) -> Path | None:
    return next((home for home in HOMES if path.is_relative_to(home)), None)


def allowed(devices: Sequence[DeviceNode]) -> tuple[str, ...]:
    """Entries of `DeviceAllow`: classes for pluggable devices, paths for those of the board."""
    return tuple(
        dict.fromkeys(name for node in devices for name in ([kind.allowed for kind in node.kinds] or [str(node.path)]))
    )


def modules(devices: Sequence[DeviceNode]) -> tuple[str, ...]:
    """The kernel's modules of these classes."""
    return tuple(dict.fromkeys(kind.module for node in devices for kind in node.kinds))
