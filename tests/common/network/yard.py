"""A network with a platform of two computers, an operator and an observer, on free ports."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from gloc3.clock import Clock
from gloc3.exchange.base import Exchange
from gloc3.exchange.zenoh import ZenohExchange, open_exchange
from gloc3.messages.topics import TopicTable
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.file import Membership, read_network
from gloc3.network.stations import BridgeContext, BridgeMembers, StationBridge

NOW = datetime.now(UTC)
LONG = timedelta(days=30)
MEMBERS = {
    "pelican.main": MemberRole.PLATFORM,
    "pelican.vision": MemberRole.PLATFORM,
    "alice": MemberRole.OPERATOR,
    "bob": MemberRole.OBSERVER,
}


def free_port() -> int:
    """A port that was free just now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def members_of(membership: Membership) -> BridgeMembers:
    """The members as the bridge has them."""
    return BridgeMembers(membership.file.roles, membership.verifier())


class Yard:
    """The folder of a network."""

    def __init__(self, folder: Path, address: str = "", *, over: str = "") -> None:
        self.folder = folder
        self.address = over + (address or f"127.0.0.1:{free_port()}")
        register.found(folder, "yard", NOW, LONG)
        for name, role in MEMBERS.items():
            self.add(name, role)

    def add(self, name: str, role: MemberRole, valid: timedelta = LONG, *, is_renewed: bool = False) -> None:
        """Takes a member in."""
        listen = [self.address] if name == "pelican.main" else []
        entry = register.NetworkMember(role=role, certificate="", until="", listen=listen)
        register.add(self.folder, name, entry, datetime.now(UTC), valid, is_renewed=is_renewed)

    def membership(self, name: str, now: datetime = NOW) -> Membership:
        """A member's network file."""
        return read_network(self.folder / name / "network.yaml", now)

    def bridge(
        self, exchange: Exchange, forged: Callable[[str, str], None], platform: str = "pelican"
    ) -> StationBridge:
        """The platform's end of its stations."""
        loop, membership = asyncio.get_running_loop(), self.membership(f"{platform}.main")
        context = BridgeContext(platform, loop, Clock(loop), TopicTable.installed())
        return StationBridge(exchange, context, members_of(membership), 2, forged)

    @contextmanager
    def open(self, name: str, membership: Membership | None = None, **entries: Any) -> Iterator[ZenohExchange]:
        """A member's exchanger."""
        own = membership or self.membership(name)
        loop = asyncio.get_running_loop()
        with open_exchange(own.node(), loop, TopicTable.installed(), settings=own.settings(), **entries) as exchange:
            yield exchange
