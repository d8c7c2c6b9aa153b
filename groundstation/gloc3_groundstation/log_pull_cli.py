"""`gloc3 log pull`: fetches the logs of a platform, over MAVLink FTP or the network of platforms and stations."""

import asyncio
import secrets
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from gloc3.errors import Gloc3Error, Refused
from gloc3.narrate import ERROR, narrate

TELL_EVERY_S: Final = 2.0
TRAFFIC: Final = ".tlog"
STATION_ID: Final = 254
"""Another one than that of a ground station which runs at the same time."""


def pull(
    source: str,
    /,
    *logs: str,
    platform: str | None = None,
    out: Path = Path(),
    keep: Annotated[bool, Parameter(negative="")] = False,
    frames: Annotated[bool, Parameter(negative="")] = False,
    no_cut: Annotated[bool, Parameter(negative="")] = False,
    wait: float = 60.0,
    station_id: int = STATION_ID,
    signing_key: Path | None = None,
) -> int:
    """Fetch logs from a vehicle; what has come is kept, and the same command goes on after a break or Ctrl-C.

    The vehicle calculates the SHA-256 digest of each log. When what has come has the same, the log takes its name in
    OUT/PLATFORM, and is deleted on the vehicle.

    For example:

    - `gloc3 log pull udpin://0.0.0.0:14550`: all logs of the first vehicle that is heard, over MAVLink FTP
    - `gloc3 log pull network-ops.yaml --platform auv`: over the network, as the station of that file
    - `gloc3 log pull serial:///dev/ttyUSB0:57600 log-3.mcap --keep`: one log, by radio, and it stays there

    Args:
        source: The MAVLink URL of a link to the vehicle, or the network file of a station.
        logs: Their names; none for all.
        platform: The vehicle's name; otherwise the first that is heard.
        out: The folder for the folder PLATFORM with the logs.
        keep: Leave them on the vehicle.
        frames: Fetch the MAVLink frames of the runs (.tlog), too.
        no_cut: Leave the log alone that is being written; otherwise it is ended, and the next begun.
        wait: Give up when the vehicle is not heard within so many seconds.
        station_id: The MAVLink system of this station.
        signing_key: A file with the MAVLink signing key of the link.
    """
    if not 0.0 < wait < float("inf"):
        raise Refused("--wait must be above 0 seconds")
    if not 200 <= station_id <= 255:
        raise Refused("--station-id must be from 200 to 255")
    return asyncio.run(_pull(source, logs, platform, out, keep, frames, no_cut, wait, station_id, signing_key))


async def _pull(
    source: str,
    names: tuple[str, ...],
    wanted: str | None,
    out: Path,
    is_kept: bool,
    has_frames: bool,
    is_uncut: bool,
    wait_s: float,
    system: int,
    key_file: Path | None,
) -> int:
    from gloc3.clock import utc_now
    from gloc3.exchange import LocalExchange
    from gloc3.link.signing_key import read_signing_key
    from gloc3.network.file import read_network
    from gloc3.topics import TopicTable
    from gloc3_groundstation import flights
    from gloc3_groundstation.links import Links
    from gloc3_groundstation.log_pull import ChunkCarrier, LogPuller, ftp_carrier
    from gloc3_groundstation.network_way import role_of
    from gloc3_groundstation.station import Station

    is_link = "://" in source
    network = None if is_link else read_network(Path(source).expanduser(), utc_now())
    key = None if key_file is None else read_signing_key(key_file.expanduser())
    loop, topics, boot, links = asyncio.get_running_loop(), TopicTable.installed(), secrets.randbits(32), Links()
    exchange = LocalExchange(topics)
    async with AsyncExitStack() as stack:
        station = Station(exchange, loop, str(system) if network is None else network.file.member, boot)
        stack.callback(station.close)
        if network is not None:
            station.client.role = role_of(network)
        stack.push_async_callback(links.close)
        await links.open(
            [source] if is_link else [],
            exchange=exchange,
            topics=topics,
            system=system,
            boot=boot,
            told=narrate,
            undelivered=station.client.undelivered,
            tap=lambda _: None,
            signing_key=key,
            network=network,
        )
        try:
            async with asyncio.timeout(wait_s):
                name = await flights.await_platform(station, wanted)
        except TimeoutError:
            raise Gloc3Error(
                f"{wanted or 'a vehicle'} was not heard within {wait_s:g} s at {links.describe()}"
            ) from None
        found = [(link, at) for _, link in links.ways() for each, at in link.platforms() if each == name]
        progress = _Progress(loop)
        carrier = (
            await stack.enter_async_context(ftp_carrier(*found[0])) if found else ChunkCarrier(station, exchange, name)
        )
        puller = LogPuller(station, name, carrier, progress.tell, narrate)
        if not is_uncut:
            await puller.cut()
        listed = await puller.list()
        missing = [one for one in names if one not in [log.name for log in listed]]
        if missing:
            here = ", ".join(log.name for log in listed) or "none"
            raise Gloc3Error(f"{name} has no log {missing[0]!r}; it has {here}")
        chosen = [
            log
            for log in listed
            if (log.name in names if names else has_frames or not log.name.endswith(TRAFFIC)) and not log.is_open
        ]
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        failed = 0
        for log in chosen:
            try:
                pulled = await puller.pull(log, folder, is_kept=is_kept)
            except asyncio.CancelledError:
                narrate(f"{log.name}: what has come is kept; the same command goes on there")
                raise
            except Gloc3Error as error:
                failed += 1
                narrate(f"{log.name}: {error}", ERROR)
                continue
            drops = f", the way was lost {pulled.drops} times" if pulled.drops else ""
            left = "deleted onboard" if pulled.is_deleted else "left onboard"
            narrate(f"{log.name}: {pulled.size} bytes, digest equal, {left}{drops}")
            print(pulled.path)  # noqa: T201
        if not chosen:
            narrate(f"{name} has no finished logs")
        return 1 if failed else 0


class _Progress:
    """Tells how far a log has come, now and then."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._told_s = float("-inf")

    def tell(self, name: str, here: int, size: int) -> None:
        """Some of it has come."""
        if self._loop.time() - self._told_s >= TELL_EVERY_S and size:
            self._told_s = self._loop.time()
            narrate(f"{name}: {100.0 * here / size:.0f} % of {size / 1e6:.1f} MB")
