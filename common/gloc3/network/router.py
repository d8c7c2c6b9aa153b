"""The router role: a process that forwards messages between the members that connect to it, and to its own uplink."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from random import SystemRandom

from gloc3.cli.counting import counted
from gloc3.cli.narration import narrate
from gloc3.clock import utc_now
from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange.zenoh import ZenohExchange
from gloc3.exchange.zenoh_session import new_session, watch_links
from gloc3.messages.envelope import Severity
from gloc3.messages.topics import TopicTable
from gloc3.network.access import MemberRole
from gloc3.network.file import Membership, read_network
from gloc3.network.revocations import RevocationList
from gloc3.network.spreading import PASSED_ON_S, RevocationSpreader


def read_router(file: Path, newest: RevocationList | None = None) -> Membership:
    """The network file of a router.

    Args:
        file: the file.
        newest: the newest list of revoked members that is known.

    Raises:
        InputError: the file has errors.
        Refused: it is another member's.
    """
    membership = read_network(file, utc_now(), newest)
    if membership.file.own.role is not MemberRole.ROUTER:
        raise Refused(f"{file} is of {membership.file.member}, {membership.file.own.role}: it needs a router's")
    return membership


@contextmanager
def routing(
    membership: Membership, changed: Callable[[str, bool], None], reload: Callable[[], object]
) -> Iterator[RevocationSpreader]:
    """Forwards for the duration of the block, on the running loop.

    Args:
        membership: the router's.
        changed: called in a thread of Zenoh's with the name of a member that has connected (True) or left (False).
        reload: called when the members that may connect are others, by a newer list of revoked members.

    Raises:
        Gloc3Error: an address cannot be opened.
    """
    loop = asyncio.get_running_loop()
    session = new_session(membership.node(), membership.settings())
    exchange = ZenohExchange(session, loop, TopicTable.installed(), is_sharing=False)

    def adopt(_: Membership, *, is_anyone_out: bool) -> None:
        if is_anyone_out:
            loop.call_later(PASSED_ON_S, reload)

    try:
        watch_links(session, changed)
        spreader = RevocationSpreader(exchange, loop, SystemRandom(), membership, adopt, _warn)
        yield spreader
        spreader.close()
    finally:
        exchange.close()


async def run_router(file: Path) -> None:
    """Forwards until SIGINT or SIGTERM; SIGHUP has it read its file again.

    Raises:
        Gloc3Error: an address cannot be opened.
        InputError: the file has errors.
        Refused: it is another member's.
    """
    loop, ends, reload = asyncio.get_running_loop(), asyncio.Event(), asyncio.Event()

    def end() -> None:
        ends.set()
        reload.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end)
    loop.add_signal_handler(signal.SIGHUP, reload.set)
    membership = read_router(file)
    while not ends.is_set():
        reload.clear()
        own = membership.file
        members = {entry.common_name: entry.member for entry in own.others}
        with routing(membership, partial(_report, loop, members), reload.set) as spreader:
            where, uplink = ", ".join(own.listen), "".join(f", uplink {name}" for name in own.uplinks)
            count = counted(len(own.others), "member")
            if warning := membership.expiry(utc_now()):
                _warn(warning)
            narrate(f"router: {own.member} of {own.network} listens at {where} for {count}{uplink}")
            while await reload.wait() and not ends.is_set():
                try:
                    membership = read_router(file, spreader.newest)
                    break
                except Gloc3Error as error:
                    narrate(f"router: {error}: the network is unchanged", Severity.ERROR)
                    reload.clear()
    narrate("router: ended")


def _warn(text: str) -> None:
    narrate(f"router: {text}", Severity.WARNING)


def _report(loop: asyncio.AbstractEventLoop, members: Mapping[str, str], name: str, is_here: bool) -> None:
    """Reports in the loop that a member has connected or left."""
    text = f"router: {members.get(name, name)} {'is connected' if is_here else 'has left'}"
    with suppress(RuntimeError):  # at its end the loop takes nothing any more
        loop.call_soon_threadsafe(narrate, text)
