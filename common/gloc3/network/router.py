"""The router role: a process that forwards messages between the members that connect to it, and to its own uplink."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from random import SystemRandom
from typing import Final

import msgspec

from gloc3.cli.counting import counted
from gloc3.cli.narration import narrate
from gloc3.clock import utc_now
from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange.zenoh import ZenohExchange
from gloc3.exchange.zenoh_session import open_node, watch_links
from gloc3.messages.envelope import Severity
from gloc3.messages.topics import TopicTable
from gloc3.network.access import MemberRole
from gloc3.network.file import Membership, read_network
from gloc3.network.regions import RegionReporter
from gloc3.network.revocations import RevocationList
from gloc3.network.spreading import PASSED_ON_S, RevocationSpreader

UPLINK_S: Final = 3.0
"""A router that has been without its uplink for so long tries the next address, s."""


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


class UplinkWatch:
    """Says when a router has no uplink, and another address is to be tried. One address is used at a time.

    Zenoh would give messages twice to a router with two uplinks.

    Args:
        loop: its time.
        uplinks: the members at the addresses.
        missing: called once when none of them has been connected for a while; None where there is no other address.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, uplinks: Sequence[str], missing: Callable[[], object] | None
    ) -> None:
        self._loop, self._uplinks, self._missing = loop, uplinks, missing
        self._timer: asyncio.TimerHandle | None = None
        self._note(is_here=False)

    def changed(self, member: str, *, is_here: bool) -> None:
        """A member has connected or left."""
        if member in self._uplinks:
            self._note(is_here=is_here)

    def close(self) -> None:
        """Watches no more; connections that end afterwards count no more."""
        self._missing = None
        self._note(is_here=False)

    def _note(self, *, is_here: bool) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._missing is not None and not is_here:
            self._timer = self._loop.call_later(UPLINK_S, self._missing)


@contextmanager
def routing(
    membership: Membership,
    changed: Callable[[str, bool], None],
    reload: Callable[[], object],
    uplink: int = 0,
) -> Iterator[RevocationSpreader]:
    """Forwards for the duration of the block, on the running loop.

    Args:
        membership: the router's.
        changed: called in a thread of Zenoh's with the name of a member that has connected (True) or left (False).
        reload: called when the members that may connect are others, by a newer list of revoked members.
        uplink: number of the address that it connects to, of those in its file.

    Raises:
        Gloc3Error: an address cannot be opened.
    """
    loop, random, own = asyncio.get_running_loop(), SystemRandom(), membership.file
    node = membership.node()
    node = msgspec.structs.replace(node, connect=node.connect[uplink : uplink + 1], client_of=tuple(own.uplinks))
    opened = open_node(node, membership.settings())
    exchange = ZenohExchange(opened, loop, TopicTable.installed(), lambda _, text: _warn(text), is_sharing=False)

    def adopt(_: Membership, *, is_anyone_out: bool) -> None:
        if is_anyone_out:
            loop.call_later(PASSED_ON_S, reload)

    try:
        watch_links(opened.session, changed)
        spreader = RevocationSpreader(exchange, loop, random, membership, adopt, _warn)
        reporter = RegionReporter(exchange, loop, own.member, own.region, random.getrandbits(32))
        yield spreader
        reporter.close()
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
    membership, uplink = read_router(file), 0
    while not ends.is_set():
        reload.clear()
        own, lost = membership.file, asyncio.Event()
        uplink %= max(len(own.connect), 1)

        def miss(lost: asyncio.Event = lost) -> None:
            lost.set()
            reload.set()

        watch = UplinkWatch(loop, own.uplinks, miss if len(own.connect) > 1 else None)
        members = {entry.common_name: entry.member for entry in own.others}
        changed = partial(_report, loop, members, watch)
        with routing(membership, changed, reload.set, uplink) as spreader:
            where = f"listens at {', '.join(own.listen)} for {counted(len(own.others), 'member')}"
            above = f", uplink {' or '.join(own.uplinks)} at {own.connect[uplink]}" if own.connect else ""
            if warning := membership.expiry(utc_now()):
                _warn(warning)
            narrate(f"router: {own.member} of {own.network} {where}{above}")
            while await reload.wait() and not ends.is_set():
                if lost.is_set():
                    _warn(f"no uplink at {own.connect[uplink]}: the next address is tried")
                    uplink, membership = uplink + 1, membership.under(spreader.newest)
                    break
                try:
                    membership = read_router(file, spreader.newest)
                    break
                except Gloc3Error as error:
                    narrate(f"router: {error}: the network is unchanged", Severity.ERROR)
                    reload.clear()
        watch.close()
    narrate("router: ended")


def _warn(text: str) -> None:
    narrate(f"router: {text}", Severity.WARNING)


def _report(
    loop: asyncio.AbstractEventLoop, members: Mapping[str, str], watch: UplinkWatch, name: str, is_here: bool
) -> None:
    """Reports in the loop that a member has connected or left."""

    def report() -> None:
        member = members.get(name, name)
        watch.changed(member, is_here=is_here)
        narrate(f"router: {member} {'is connected' if is_here else 'has left'}")

    with suppress(RuntimeError):  # at its end the loop takes nothing any more
        loop.call_soon_threadsafe(report)
