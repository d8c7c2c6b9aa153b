"""Inputs of a vehicle's onboard side: sensors, storage, links' ends, and the components that a process hosts."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.component.context import HostContext
from gloc3.component.deployment import ComponentRow
from gloc3.component.settings import load_settings
from gloc3.errors import Finding, InputError, Refused
from gloc3.mavlink.signing import Signing
from gloc3.mavlink.transport.endpoints import Endpoint
from gloc3.messages.perception import OccupancyMap
from gloc3.network.rights import Rights
from gloc3.platform.platform import Platform
from gloc3.store import DocumentFile, Records
from gloc3.terrain import Terrain, read_map
from gloc3_onboard.command_server.log_shelf import LogStoreBase
from gloc3_onboard.command_server.site import Usage
from gloc3_onboard.companion.routing import Keep
from gloc3_onboard.process.event_narration import Report
from gloc3_onboard.process.journal import SystemdJournal
from gloc3_onboard.process.runner import Create, HostMember
from gloc3_onboard.process.vitals import Vitals
from gloc3_onboard.sensors.devices import Rig
from gloc3_onboard.sensors.registry import SourceHost, make_sources, source_urls
from gloc3_onboard.sensors.rig import PlatformRig

KNOWN_MAP: Final = "known_map"
"""The device with the map that a platform knows at the start."""


class Sensors(NamedTuple):
    """The devices of a process that samplers read."""

    devices: Mapping[str, Any]
    urls: Mapping[str, str]
    """Their sources, by device; of a simulated device a word for it. Those that are not listed are not watched."""
    rig: Rig
    """The calibrations of the cameras."""


def open_sensors(
    platform: Platform,
    used: Sequence[str],
    requested: Sequence[str],
    host: SourceHost,
    warn: Callable[[str], None] = lambda _: None,
) -> Sensors:
    """The real sensors of a process, from the URLs of its platform.

    Args:
        platform: the platform file.
        used: devices named by this process's rows.
        requested: sources that override the file's, as NAME=URL.
        host: context for creating sources.
        warn: called about doubtful calibrations.

    Raises:
        InputError: a calibration or the known map cannot be used.
        Refused: a source is wrong.
    """
    rig = PlatformRig(platform, host.folder)
    for warning in rig.warnings:
        warn(str(warning))
    host = host._replace(time_shift_s=partial(_time_shift_s, rig))
    urls = source_urls(platform, used, requested)
    return Sensors({**make_sources(urls, host), KNOWN_MAP: known_map(platform, host.folder)}, urls, rig)


def _time_shift_s(rig: Rig, camera: str) -> float:
    model = rig.model(camera)
    return model.time_shift_s if model is not None else 0.0


def known_map(platform: Platform, folder: Path) -> OccupancyMap | None:
    """The map that a platform knows at the start; None for none.

    Args:
        platform: the platform file.
        folder: of the platform file.

    Raises:
        InputError: it cannot be used, or does not fit the settings of the component that begins with it.
    """
    if not platform.known_map:
        return None
    from gloc3_onboard.components.processors.map import MapProcessor, MapSettings, stack_with

    map_class = f"{MapProcessor.__module__}:{MapProcessor.__name__}"
    path = folder / platform.known_map
    known = read_map(path)
    for row in platform.components:
        if row.class_name == map_class:
            try:
                stack_with(known, load_settings(MapSettings, row.settings, row.name))
            except Refused as refusal:
                message, _, hint = str(refusal).partition("; ")
                raise InputError([Finding(file=str(path), message=message, hint=hint)]) from refusal
    return known


def devices_of(rows: Sequence[ComponentRow]) -> list[str]:
    """The devices that rows name, sorted."""
    return sorted({device for row in rows for device in row.devices.values()})


class Hosting(msgspec.Struct, frozen=True, kw_only=True):
    """The components that a process hosts, and their factory."""

    rows: Sequence[ComponentRow] | None = None
    """None for all of the platform."""
    create: Create = ComponentRow.create
    placeholders: Sequence[HostMember] = ()
    """The components of child processes."""


class Storage(msgspec.Struct, frozen=True, kw_only=True):
    """Storage of what must survive a vehicle's process."""

    journal: Records
    """Of the requests of stations."""
    progress: Records
    """Of missions, and home."""
    reports: Records
    """Reports sent to stations."""
    memory: Records
    """What components remember."""
    log_store: LogStoreBase
    """The logs that stations may fetch."""
    pictures: Any
    """The device `pictures`."""
    computer_start: str = ""
    """Tells this start of the computer from every other."""
    worker: Executor | None = None
    """Checks missions; None to check them at once."""
    usage: DocumentFile[Usage] | None = None
    """The vehicle's hours; None where they are not kept."""


class VehicleInputs(msgspec.Struct, frozen=True, kw_only=True):
    """Inputs of a vehicle's side, besides its links, sensors and storage."""

    platform: Platform
    context: HostContext
    rights: Rights
    """Of the members of the network."""
    report: Report = lambda _severity, _text: None
    """Called with messages for the person at the terminal."""
    journal: SystemdJournal | None = None
    """systemd's journal, which takes the components' events instead; None for none."""
    keep: Keep | None = None
    """Receives each MAVLink frame, for a log."""
    vitals: Callable[[], Vitals] = Vitals
    """Reads the computer's load."""
    sign: Callable[[str, int], Signing | None] = lambda _url, _number: None
    """Signs the link of a URL and number, 0 being the autopilot's; None for a link without a key."""
    member_of: Callable[[str, int], str] = lambda _url, _number: ""
    """Member of the network for whom the signing key of a link stands; empty for none."""
    system_id: int = 1
    accepts_plans: bool = False
    """Plans that other stations send to the autopilot become missions, and do not reach it."""
    terrain: Terrain | None = None
    """Heights of the ground, for missions; None without tiles."""
    video_url: Callable[[str], str] = lambda _camera: ""
    """URL of a camera's video; empty for none."""


class Attachment(NamedTuple):
    """A link without its endpoint: pass received frames to `receive`, and the endpoint to `open`."""

    receive: Callable[[bytes], None]
    open: Callable[[Endpoint], None]
