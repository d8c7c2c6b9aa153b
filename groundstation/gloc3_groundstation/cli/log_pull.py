"""`gloc3 log pull`: fetches the logs of platforms, over MAVLink FTP or the network of platforms and stations."""

import asyncio
import secrets
from collections.abc import Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import msgspec
from cyclopts import Parameter

from gloc3.cli.counting import counted
from gloc3.cli.narration import ERROR, narrate
from gloc3.errors import Gloc3Error, NoContact, Refused
from gloc3.messages.command_interface import LogOnboard
from gloc3.messages.envelope import Severity
from gloc3_groundstation.cli.fleet_session import ALL, STATION_ID, open_fleet
from gloc3_groundstation.services.saving import part_of
from gloc3_groundstation.store.download_progress import amount

if TYPE_CHECKING:
    from gloc3_groundstation.assembly import GroundStation
    from gloc3_groundstation.store.log_pull import LogPuller
from gloc3_groundstation.store.download_progress import DownloadProgress

TRAFFIC: Final = ".tlog"
AT_ONCE: Final = 4
"""Vehicles from which logs are fetched at the same time."""
REPORT_PERIOD_S: Final = 2.0


class PullProgress:
    """Narrates the progress of a log download."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._title = ""
        self.begin("")

    def begin(self, title: str) -> None:
        """The next log."""
        self._title, self._pace, self._reported_s = title, DownloadProgress(), float("-inf")

    def update(self, _: str, here: int, size: int) -> None:
        """Some of it has come."""
        words = self._pace.words(here, size, self._loop.time())
        if here and self._loop.time() - self._reported_s >= REPORT_PERIOD_S:
            self._reported_s = self._loop.time()
            narrate(f"{self._title}: {words}")

    def pause(self, text: str) -> None:
        """Prints a text during a download, such as the loss of the connection."""
        self._pace.reset()
        narrate(text)


def pull(
    source: str,
    /,
    *logs: str,
    platform: Annotated[list[str] | None, Parameter(negative=())] = None,
    out: Path = Path(),
    keep: Annotated[bool, Parameter(negative="")] = False,
    frames: Annotated[bool, Parameter(negative="")] = False,
    no_cut: Annotated[bool, Parameter(negative="")] = False,
    list_only: Annotated[bool, Parameter(name="--list", negative="")] = False,
    wait: float = 60.0,
    station_id: int = STATION_ID,
    signing_key: Path | None = None,
) -> int:
    """Fetch logs from vehicles; partial downloads are kept, and the same command resumes them.

    The vehicle calculates the SHA-256 digest of each log. When the downloaded log has the same digest, it is renamed to
    its final name in OUT/PLATFORM, and deleted on the vehicle; until then it is OUT/PLATFORM/LOG.BYTES.part. While the
    link is lost the command waits, and resumes when the vehicle is back in contact. A read-only station downloads and
    deletes nothing.

    For example:

    - `gloc3 log pull udpin://0.0.0.0:14550 --list`: the vehicle's logs, and how much of each is downloaded
    - `gloc3 log pull udpin://0.0.0.0:14550`: all logs of the first vehicle in contact, over MAVLink FTP
    - `gloc3 log pull network-ops.yaml --platform auv`: over the network, as the station of that file
    - `gloc3 log pull network-ops.yaml --platform all --keep`: of every vehicle of the network, several at a time
    - `gloc3 log pull serial:///dev/ttyUSB0:57600 log-3.mcap --keep`: one log, by radio, without deleting it

    Args:
        source: The MAVLink URL of a link to the vehicle, or the network file of a station.
        logs: Their names; none for all.
        platform: The vehicle's name; otherwise the first one in contact. May be given again, for several vehicles; "all"
            is every vehicle of the network file, or every one that is heard on the link.
        out: The folder in which the folder PLATFORM with the logs is created.
        keep: Leave them on the vehicle.
        frames: Fetch the MAVLink frames of the runs (.tlog), too.
        no_cut: Do not end the log that is being written; otherwise it is ended, and the next begun.
        list_only: List the logs and fetch none.
        wait: Give up without contact to the vehicle within this time, s.
        station_id: The MAVLink system of this station.
        signing_key: A file with the MAVLink signing key of the link.
    """
    if not 0.0 < wait < float("inf"):
        raise Refused("--wait must be above 0 seconds")
    if not 200 <= station_id <= 255:
        raise Refused("--station-id must be from 200 to 255")
    if "://" not in source and not Path(source).expanduser().is_file():
        raise Refused(
            f"{source!r} is no link, such as udpin://0.0.0.0:14550 or serial:///dev/ttyUSB0:57600, and no network file"
        )
    if out.exists() and not out.is_dir():
        raise Refused(f"--out {out} is a file, not a folder")
    if list_only and (logs or keep):
        raise Refused("--list names all logs and fetches none; leave it out to fetch")
    vehicles = platform or []
    is_many = len(vehicles) > 1 or ALL in vehicles
    wanted = PullRequest(
        names=logs,
        is_kept=keep,
        has_frames=frames,
        is_uncut=no_cut or list_only,
        is_list=list_only,
        out=out,
        is_many=is_many,
    )
    if is_many:
        names = [] if ALL in vehicles else vehicles
        return asyncio.run(_pull_many(source, names, wanted, wait, station_id, signing_key))
    return asyncio.run(_pull(source, vehicles[0] if vehicles else None, wanted, wait, station_id, signing_key))


class PullRequest(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a log download."""

    names: tuple[str, ...] = ()
    """Which; none for all."""
    is_kept: bool = False
    """Onboard, when they are here."""
    has_frames: bool = False
    """The MAVLink frames, too."""
    is_uncut: bool = False
    """The log that is being written is not ended."""
    is_list: bool = False
    """They are listed, and none is fetched."""
    out: Path
    is_many: bool = False
    """Of several vehicles: lines name the vehicle."""

    def label(self, platform: str, log: str) -> str:
        """What a log is called in lines."""
        return f"{platform}/{log}" if self.is_many else log


async def _pull(
    source: str, platform: str | None, wanted: PullRequest, wait_s: float, system: int, key_file: Path | None
) -> int:
    from gloc3.mavlink.signing_key import read_signing_key
    from gloc3_groundstation.assembly import GroundStation, StationSetup, read_membership
    from gloc3_groundstation.desk import flights

    is_link = "://" in source
    network = read_membership(None if is_link else Path(source))
    key = None if key_file is None else read_signing_key(key_file.expanduser())
    setup = StationSetup(boot=secrets.randbits(32), system=system, signing_key=key, network=network)
    async with AsyncExitStack() as stack:
        ground = GroundStation(setup, report=narrate)
        stack.push_async_callback(ground.close)
        await ground.open([source] if is_link else [])
        station, links = ground.station, ground.links
        try:
            async with asyncio.timeout(wait_s):
                name = await flights.await_platform(station, platform)
        except TimeoutError:
            who, others = platform or "a vehicle", ", ".join(known.name for known in station.fleet)
            hint = f"; heard: {others}" if others else "; is it running, and does its link lead here?"
            raise NoContact(f"{who} did not respond within {wait_s:g} s at {links.describe()}{hint}") from None
        return await _fetch_of(ground, name, wanted)


async def _pull_many(
    source: str, names: Sequence[str], wanted: PullRequest, wait_s: float, system: int, key_file: Path | None
) -> int:
    """Fetches from several vehicles at once; one that fails stops none of the others."""
    from gloc3.mavlink.signing_key import read_signing_key

    key = None if key_file is None else read_signing_key(key_file.expanduser())
    async with open_fleet(source, names, wait_s, system, key) as fleet:
        turn = asyncio.Semaphore(AT_ONCE)

        async def fetch_in_turn(name: str) -> int:
            async with turn:
                try:
                    return await _fetch_of(fleet.ground, name, wanted)
                except Gloc3Error as error:
                    narrate(f"{name}: {error}", ERROR)
                    return 1

        codes = await asyncio.gather(*map(fetch_in_turn, fleet.here))
        return max([*codes, *(1 for _ in fleet.missing)])


async def _fetch_of(ground: "GroundStation", name: str, wanted: PullRequest) -> int:
    """Fetches from a vehicle in contact, over the way on which it is."""
    from gloc3_groundstation.store.log_pull import ChunkCarrier, LogPuller, ftp_carrier

    station, progress = ground.station, PullProgress(ground.loop)
    found = [(link, at) for _, link in ground.links.routes() for each, at in link.platforms() if each == name]
    async with AsyncExitStack() as stack:
        carrier = (
            await stack.enter_async_context(ftp_carrier(*found[0]))
            if found
            else ChunkCarrier(station, ground.exchange, name)
        )
        return await fetch(LogPuller(station, name, carrier, progress.update, progress.pause), name, wanted, progress)


async def fetch(puller: "LogPuller", name: str, wanted: PullRequest, progress: PullProgress) -> int:
    """Downloads the requested logs of a vehicle in contact."""
    from gloc3_groundstation.station.command_client import Declined

    if not wanted.is_uncut:
        try:
            await puller.cut()
        except Declined as error:
            narrate(f"{wanted.label(name, 'the current log')} was not closed: {error}", Severity.WARNING)
    listed, folder = await puller.list(), wanted.out / name
    if wanted.is_list:
        for log in listed:
            print(_listed(log, folder, wanted.label(name, log.name)))  # noqa: T201
        return 0
    chosen = _chosen(name, listed, wanted)
    folder.mkdir(parents=True, exist_ok=True)
    failed = 0
    for number, log in enumerate(chosen, 1):
        label = wanted.label(name, log.name)
        progress.begin(f"{label} ({number} of {len(chosen)})" if len(chosen) > 1 else label)
        if share := _share(log, folder):
            narrate(f"{label}: resumes at {share:.0f} % of {amount(log.size)}")
        try:
            pulled = await puller.pull(log, folder, is_kept=wanted.is_kept)
        except asyncio.CancelledError:
            share = _share(log, folder)
            here = f"{share:.0f} % is here and kept; " if share else ""
            narrate(f"{label}: {here}the same command resumes it")
            raise
        except Gloc3Error as error:
            failed += 1
            narrate(f"{label}: {error}", ERROR)
            continue
        drops = f", link lost {counted(pulled.drops, 'time')}" if pulled.drops else ""
        left = "deleted onboard" if pulled.is_deleted else "left onboard"
        narrate(f"{label}: {amount(pulled.size)}, digest equal, {left}{drops}")
        print(pulled.path)  # noqa: T201
    if not chosen:
        narrate(f"{name} has no finished logs")
    return 1 if failed else 0


def _chosen(platform: str, listed: list[LogOnboard], wanted: PullRequest) -> list[LogOnboard]:
    """The logs that are fetched.

    Raises:
        Gloc3Error: one was named that is not there, or still being written.
    """
    known = {log.name: log for log in listed}
    for name in wanted.names:
        if name not in known:
            raise Gloc3Error(f"{platform} has no log {name!r}; it has {', '.join(known) or 'none'}")
        if known[name].is_open:
            raise Gloc3Error(f"{name} is still being written; without --no-cut it is closed first")
    finished = [log for log in listed if not log.is_open]
    if wanted.names:
        return [log for log in finished if log.name in wanted.names]
    return [log for log in finished if wanted.has_frames or not log.name.endswith(TRAFFIC)]


def _listed(log: LogOnboard, folder: Path, label: str) -> str:
    """A line of the list."""
    share = _share(log, folder)
    state = "is being written" if log.is_open else f"{share:.0f} % here" if share else ""
    return f"{label:24} {amount(log.size):>10}  {state}".rstrip()


def _share(log: LogOnboard, folder: Path) -> float:
    """How much of a log an attempt has left here, in percent."""
    part = part_of(folder / log.name, log.size)
    return 100.0 * part.stat().st_size / log.size if log.size and part.exists() else 0.0
