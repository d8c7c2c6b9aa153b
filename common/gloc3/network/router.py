"""The router role: a process that forwards messages between the members that connect to it, and to its own uplink."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

from gloc3.cli.counting import counted
from gloc3.cli.narration import narrate
from gloc3.clock import utc_now
from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange.zenoh_session import forwarding
from gloc3.messages.envelope import Severity
from gloc3.network.access import MemberRole
from gloc3.network.file import Membership, read_network


def read_router(file: Path) -> Membership:
    """The network file of a router.

    Raises:
        InputError: the file has errors.
        Refused: it is another member's.
    """
    membership = read_network(file, utc_now())
    if membership.file.own.role is not MemberRole.ROUTER:
        raise Refused(f"{file} is of {membership.file.member}, {membership.file.own.role}: it needs a router's")
    return membership


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
        changed = partial(_report, loop, members)
        with forwarding(membership.node(), membership.settings(), changed):
            where, uplink = ", ".join(own.listen), "".join(f", uplink {name}" for name in own.uplinks)
            count = counted(len(own.others), "member")
            if warning := membership.expiry(utc_now()):
                narrate(f"router: {warning}", Severity.WARNING)
            narrate(f"router: {own.member} of {own.network} listens at {where} for {count}{uplink}")
            while await reload.wait() and not ends.is_set():
                try:
                    membership = read_router(file)
                    break
                except Gloc3Error as error:
                    narrate(f"router: {error}: the network is unchanged", Severity.ERROR)
                    reload.clear()
    narrate("router: ended")


def _report(loop: asyncio.AbstractEventLoop, members: Mapping[str, str], name: str, is_here: bool) -> None:
    """Reports in the loop that a member has connected or left."""
    text = f"router: {members.get(name, name)} {'is connected' if is_here else 'has left'}"
    with suppress(RuntimeError):  # at its end the loop takes nothing any more
        loop.call_soon_threadsafe(narrate, text)
