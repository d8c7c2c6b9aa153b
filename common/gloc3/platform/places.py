"""Places of a platform's components: the host, and the process there, in which each runs."""

from collections import Counter
from typing import Final, NamedTuple

from gloc3.component.deployment import ComponentRow
from gloc3.errors import Refused, nearest
from gloc3.platform.platform import Platform

ONLY_HOST: Final = "main"
"""The host of a platform that names none."""
TIED_DEVICES: Final = ("autopilot", "computer", "site")
"""Devices that only the main process of the clock host has: the autopilot's link, the server's files, the links' state."""
_TIED_SOURCE: Final = "autopilot:"


class ProcessPlace(NamedTuple):
    """A process of a host."""

    host: str
    process: str = ""
    """Empty for the host's main process."""

    def __str__(self) -> str:
        return f"{self.host}/{self.process}" if self.process else self.host


def host_names(platform: Platform) -> list[str]:
    """Hosts of a platform; the first is that of components whose row names none."""
    return list(platform.hosts) or [ONLY_HOST]


def place_of(platform: Platform, row: ComponentRow) -> ProcessPlace:
    """Where a component runs."""
    return ProcessPlace(row.host or host_names(platform)[0], row.process)


def clock_host(platform: Platform) -> str:
    """Host whose clock is the platform's time: that of the components which use the autopilot's link."""
    votes = Counter(place_of(platform, row).host for row in platform.components if tied_device(platform, row))
    return votes.most_common(1)[0][0] if votes else host_names(platform)[0]


def rows_at(platform: Platform, place: ProcessPlace) -> list[ComponentRow]:
    """The components of a process, in the order of the file."""
    return [row for row in platform.components if place_of(platform, row) == place]


def child_processes(platform: Platform, host: str) -> list[str]:
    """The processes of a host beside its main one, in the order of the file."""
    places = [place_of(platform, row) for row in platform.components]
    return list(dict.fromkeys(place.process for place in places if place.host == host and place.process))


def is_in_one_process(platform: Platform) -> bool:
    """Whether nothing of the platform runs outside one process."""
    return len(platform.hosts) <= 1 and not any(row.process for row in platform.components)


def choose_host(platform: Platform, wanted: str | None) -> str:
    """Selects the host of a process; without a name, the only one.

    Raises:
        Refused: there is no host of that name, or none is given and there are several.
    """
    names = host_names(platform)
    if wanted is None and len(names) > 1:
        raise Refused(f"{platform.platform} has the hosts {', '.join(names)}: choose one, such as --host {names[0]}")
    if wanted is not None and wanted not in names:
        raise Refused(f"{platform.platform} has no host {wanted!r}; {nearest(wanted, names)}")
    return wanted or names[0]


def tied_device(platform: Platform, row: ComponentRow) -> str:
    """A device of the row that only the clock host's main process has; empty if there is none."""
    for device in row.devices.values():
        if device in TIED_DEVICES or platform.devices.get(device, "").startswith(_TIED_SOURCE):
            return device
    return ""
