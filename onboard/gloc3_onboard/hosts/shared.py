"""The exchange that a host's main process opens: local where it is alone, else joined with its children and other hosts."""

import asyncio
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import blake2s
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gloc3.clock import utc_now
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Severity
from gloc3.messages.topics import TopicTable
from gloc3.platform.places import child_processes, clock_host
from gloc3.platform.platform import Platform

if TYPE_CHECKING:
    from gloc3.network.file import Membership
    from gloc3.network.revocations import RevocationList


class SharedExchange(NamedTuple):
    """The exchange of a main process."""

    exchange: Exchange
    endpoint: str
    """Where its children find it; empty where it has none."""
    topics: TopicTable
    member: "Membership | None" = None
    """Of the network; None for none."""


def alone() -> SharedExchange:
    """The exchange of a platform that is one process."""
    topics = TopicTable.installed()
    return SharedExchange(LocalExchange(topics), "", topics)


@contextmanager
def open_shared(
    platform: Platform,
    host: str,
    out: Path,
    loop: asyncio.AbstractEventLoop,
    troubled: Callable[[str, str], None],
    member: "Membership | None" = None,
) -> Iterator[SharedExchange]:
    """The exchange of a host's main process, for the duration of the block.

    Args:
        platform: the platform.
        host: name of the host.
        out: folder of log and state, which no two processes may share.
        loop: the process's event loop.
        troubled: called about rejected messages.
        member: network membership; None opens only a socket for the children.

    Raises:
        Refused: the socket folder belongs to another user.
        Gloc3Error: another process is already running in this role.
    """
    has_children = bool(child_processes(platform, host))
    if not has_children and member is None:
        yield alone()
        return
    from gloc3.exchange.zenoh import open_exchange
    from gloc3.exchange.zenoh_session import UNIX, ZenohEndpoints

    topics = TopicTable.installed()
    endpoint = f"{UNIX}/{socket_folder() / socket_name(out, host)}" if has_children else ""
    sockets = (endpoint,) if endpoint else ()
    node = ZenohEndpoints(name=host, listen=sockets) if member is None else member.node(*sockets)
    settings = None if member is None else member.settings()
    with open_exchange(node, loop, topics, troubled, settings) as exchange:
        yield SharedExchange(exchange, endpoint, topics, member)


def socket_folder() -> Path:
    """A private folder for sockets; its path is short, as sockets require.

    Raises:
        Refused: it belongs to another user.
    """
    folder = Path(tempfile.gettempdir()) / f"gloc3-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise Refused(f"{folder} must be a folder that only this user may enter; remove it")
    return folder


def socket_name(out: Path, host: str) -> str:
    """The name of the socket of a host's main process, the same in each of its lives."""
    return blake2s(f"{out.resolve()}\0{host}".encode(), digest_size=8).hexdigest()


def check_member(platform: Platform, host: str, member: "Membership | None") -> None:
    """Checks that a network file is this host's, and that there is one where there are other hosts.

    Raises:
        Refused: it is another member's; or there is none, and the platform has other hosts.
    """
    name = f"{platform.platform}.{host}"
    if member is None and host != clock_host(platform):
        raise Refused(f"host {host} reaches the others by a network: --network FILE (gloc3 network init makes one)")
    if member is not None and member.file.member != name:
        raise Refused(f"{member.path}: it is {member.file.member}'s, and this is {name}")


async def reread(
    platform: Platform,
    host: str,
    network: Path,
    loop: asyncio.AbstractEventLoop,
    newest: "RevocationList | None" = None,
) -> "Membership":
    """Reloads a network file without blocking the loop.

    Args:
        platform: the platform.
        host: name of the host.
        network: the file.
        loop: the process's event loop.
        newest: the newest list of revoked members that is known.

    Raises:
        InputError: the file has errors.
        Refused: the file is another member's.
    """
    from gloc3.network.file import read_network

    member = await loop.run_in_executor(None, read_network, network, utc_now(), newest)
    check_member(platform, host, member)
    return member


async def renew(exchange: Exchange, endpoint: str, member: "Membership") -> None:
    """Opens the connections to others again, as a membership wants them.

    Raises:
        Gloc3Error: no session could be opened.
    """
    from gloc3.exchange.zenoh import ZenohExchange

    assert isinstance(exchange, ZenohExchange)
    await exchange.renew(member.node(*filter(None, [endpoint])), member.settings())


def report_strangers(exchange: Exchange, report: Callable[[Severity, str], None]) -> None:
    """Has connections and messages that come too often reported as events, for the operators."""
    from gloc3.exchange.zenoh import ZenohExchange

    assert isinstance(exchange, ZenohExchange)
    others = exchange.troubled

    def handle(kind: str, text: str) -> None:
        if kind in ("refused", "too_many"):
            report(Severity.WARNING, text)
        else:
            others(kind, text)

    exchange.troubled = handle
