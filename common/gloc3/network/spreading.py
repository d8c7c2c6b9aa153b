"""Spreads the newest list of revoked members among all members, and has each keep it.

The members gossip by the Trickle algorithm (RFC 6206): each says from time to time which list it has, seldom while all
have the same, and at once where one has another. Any number of connected members together send some messages a minute.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from random import Random, SystemRandom
from threading import Lock
from typing import Any, Final, Protocol

from gloc3.clock import utc_now
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange, Publisher
from gloc3.messages.envelope import Envelope, Revocations
from gloc3.messages.topics import TopicTable
from gloc3.network.file import Membership
from gloc3.network.revocations import RevocationList, write_list

MEMBERS: Final = "members"
SHORTEST_S: Final = 1.0
LONGEST_S: Final = 64.0
"""A member speaks once in an interval that is short after news, and doubles up to the longest, s."""
ENOUGH: Final = 2
"""A member that has heard so many others with the same list in the interval is silent."""
FORGED_S: Final = 0.1
"""After a list that was not signed by the authority no other is verified for this time, s."""
WARNED_S: Final = 86_400.0
"""So long before a list ends it is reported, s."""


POLL_S: Final = 0.1
SETTLED_S: Final = 2.0
"""So long a push waits for members that it has not seen yet, s."""
PASSED_ON_S: Final = 0.5
"""So long connections stay open after a newer list, so that it is passed on before, s."""


class ListAdopted(Protocol):
    """Called with the membership under a newer list, and whether a member was accepted that is not any more."""

    def __call__(self, membership: Membership, /, *, is_anyone_out: bool) -> None:
        """Applies it."""


def topic_of(member: str) -> str:
    """Where a member says which list it has; also its liveliness token, followed by the list's number."""
    return f"{MEMBERS}/{member}/revocations"


class RevocationSpreader:
    """A member's part in spreading the newest list.

    Args:
        exchange: reaches other members.
        loop: its time.
        random: spreads the members' messages over time.
        membership: this member.
        adopted: applies a newer list.
        report: called with text for users.
    """

    def __init__(
        self,
        exchange: Exchange,
        loop: asyncio.AbstractEventLoop,
        random: Random,
        membership: Membership,
        adopted: ListAdopted,
        report: Callable[[str], None],
    ) -> None:
        self._exchange, self._loop, self._random = exchange, loop, random
        self._membership, self._adopted, self._report = membership, adopted, report
        self._topic = topic_of(membership.file.member)
        self._publisher = Publisher(exchange, MEMBERS, membership.file.member, random.getrandbits(32))
        self._interval_s, self._same, self._forged_s = SHORTEST_S, 0, float("-inf")
        self._warned = ""
        self._timers: list[asyncio.TimerHandle] = []
        self._writing = Lock()
        self._withdraw = exchange.declare_alive(f"{self._topic}/{self.number}")
        self._undo = exchange.subscribe(topic_of("*"), self._receive)
        self._begin(SHORTEST_S)

    @property
    def newest(self) -> RevocationList | None:
        """The newest list that is known."""
        return self._membership.revocations

    @property
    def number(self) -> int:
        """Its number; 0 for none."""
        return 0 if self.newest is None else self.newest.number

    def renew(self, membership: Membership) -> None:
        """Takes the membership after its files were read again."""
        self._membership = membership
        self._declare()

    def close(self) -> None:
        """Neither speaks nor listens any more."""
        self._cancel()
        self._undo()
        self._withdraw()

    def _cancel(self) -> None:
        for timer in self._timers:
            timer.cancel()

    def _begin(self, interval_s: float) -> None:
        self._cancel()
        self._interval_s, self._same = interval_s, 0
        speaks_s = self._random.uniform(0.5, 1.0) * interval_s
        following_s = min(2.0 * interval_s, LONGEST_S)
        self._timers = [
            self._loop.call_later(speaks_s, self._speak),
            self._loop.call_later(interval_s, self._begin, following_s),
        ]
        self._warn()

    def _speak(self) -> None:
        if self._same < ENOUGH:
            data = b"" if self.newest is None else self.newest.data
            self._publisher.publish(self._topic, Revocations(number=self.number, data=data), self._loop.time())

    def _receive(self, envelope: Envelope[Any]) -> None:
        payload = envelope.payload
        if envelope.topic == self._topic or not isinstance(payload, Revocations):
            return
        if payload.number == self.number:
            self._same += 1
        elif payload.number > self.number:
            self._examine(payload)
        elif self._interval_s > SHORTEST_S:
            self._begin(SHORTEST_S)

    def _examine(self, payload: Revocations) -> None:
        """Adopts a newer list, if the authority has signed it."""
        if self._loop.time() < self._forged_s + FORGED_S:
            return
        try:
            found = self._membership.verified(payload.data)
            if found.number != payload.number:
                raise Refused(f"a list of revoked members has another number than {payload.number}")
        except Refused as error:
            self._forged_s = self._loop.time()
            if self._warned != str(error):
                self._warned = str(error)
                self._report(str(error))
            return
        before = self._membership
        self._membership = before.under(found)
        out = [entry.member for entry in before.file.accepts if entry.certificate in found.certificates]
        self._loop.run_in_executor(None, self._keep)
        self._declare()
        self._report(f"{found}: it revokes {', '.join(out) or 'nobody who is known here'}")
        self._adopted(self._membership, is_anyone_out=bool(out))

    def _declare(self) -> None:
        self._withdraw()
        self._withdraw = self._exchange.declare_alive(f"{self._topic}/{self.number}")
        self._begin(SHORTEST_S)

    def _keep(self) -> None:
        """In a thread: writes the list beside the network file."""
        membership = self._membership
        assert membership.revocations is not None
        try:
            with self._writing:
                write_list(membership.list_path, membership.revocations)
        except OSError as error:
            text = f"{membership.list_path} cannot be written: {error.strerror or error}; a restart forgets the list"
            self._loop.call_soon_threadsafe(self._report, text)

    def _warn(self) -> None:
        """Reports a list that ends soon, or has ended."""
        if self.newest is None:
            return
        left_s = self.newest.end_s - utc_now().timestamp()
        if left_s > min(WARNED_S, 0.25 * (self.newest.end_s - self.newest.signed_s)):
            return
        state = "has ended" if left_s <= 0.0 else "ends soon"
        text = f"list {self.newest.number} of revoked members {state}: gloc3 network confirm, and push it"
        if self._warned != text:
            self._warned = text
            self._report(text)


async def push(membership: Membership, within_s: float) -> dict[str, int]:
    """Joins the network as a member, and says which list of revoked members it has until all others have it.

    Args:
        membership: the member, whose own process does not run meanwhile.
        within_s: longest time.

    Returns:
        By member in sight: the number of its list.

    Raises:
        Gloc3Error: an address cannot be opened.
        Refused: there is no list.
    """
    from gloc3.exchange.zenoh import open_exchange

    if membership.revocations is None:
        raise Refused("there is no list of revoked members: gloc3 network confirm makes one")
    loop, found, number = asyncio.get_running_loop(), dict[str, int](), membership.revocations.number

    def note(token: str, is_here: bool) -> None:
        _, member, _, listed = token.split("/")
        if is_here and member != membership.file.member:
            found[member] = int(listed)

    with open_exchange(membership.node(), loop, TopicTable.installed(), settings=membership.settings()) as network:
        undo = network.watch(f"{topic_of('*')}/*", note)
        spreader = RevocationSpreader(network, loop, SystemRandom(), membership, _ignore, lambda _: None)
        end_s = loop.time() + within_s
        while loop.time() < end_s and not (found and all(listed >= number for listed in found.values())):
            await asyncio.sleep(POLL_S)
        await asyncio.sleep(min(SETTLED_S, within_s))
        spreader.close()
        undo()
    return found


def _ignore(_: Membership, *, is_anyone_out: bool) -> None:
    """Whoever pushes has nothing to apply."""
