"""The requests of a station that wait for their reply: repeated never needlessly, executed never twice.

A request is known by `(sender, boot, sequence)`, counted for each platform. When its reply is late, the platform is
asked what became of it (`Query`); only if it never arrived it is sent again, under the same id. What is not known
when the time is up ends as *unknown*. When the link tells that it gave a request up, that ends as *refused* if it was
surely never delivered, and else is asked about at once.
"""

from dataclasses import dataclass
from typing import Final

from msgspec.structs import replace

from gloc3.messages.command_interface import AnyBody, CiReply, CiRequest, LoadMission, Outcome, Query, RequestTask

TIMEOUT_S: Final = 2.0
"""How long a reply may take before it is asked for."""
SLOWEST_BYTES_S: Final = 1000.0
"""A mission's text is given time for this rate, so that no question is asked while it is still on its way."""


@dataclass(slots=True)
class _Pending:
    platform: str
    request: CiRequest
    wait_s: float
    next_s: float
    deadline_s: float
    timeout_s: float
    times_sent: int = 1
    given_up: str = ""
    """Why the link gave it up, where it may have arrived all the same."""


class Requests:
    """The machine: told of requests, replies and the time; gives what to send and what has ended."""

    def __init__(self, sender: str, boot: int) -> None:
        self.sender: Final = sender
        self.boot: Final = boot
        self._sequences: dict[str, int] = {}
        self._pending: dict[tuple[str, int], _Pending] = {}
        self._queries: dict[tuple[str, int], tuple[str, int]] = {}
        self._outgoing: list[tuple[str, CiRequest]] = []
        self._ended: list[tuple[tuple[str, int], CiReply]] = []

    def request(self, platform: str, body: AnyBody, timeout_s: float, now_s: float) -> tuple[str, int]:
        """Sends a request; returns the key under which `ended()` will give its reply."""
        request = self._new(platform, body)
        patience_s = TIMEOUT_S
        if isinstance(body, LoadMission | RequestTask):
            patience_s += len(body.text.encode()) / SLOWEST_BYTES_S
        key = platform, request.sequence
        self._pending[key] = _Pending(platform, request, patience_s, now_s + patience_s, now_s + timeout_s, timeout_s)
        self._outgoing.append((platform, request))
        return key

    def unanswered(self, platform: str, body: AnyBody) -> CiRequest:
        """A request that nobody waits for."""
        return self._new(platform, body)

    def drop(self, key: tuple[str, int]) -> None:
        """Nobody waits for this reply any more."""
        self._end(key, None)

    def receive(self, platform: str, reply: CiReply, now_s: float) -> None:
        """Takes a reply in; one that is not for this station, or for nothing that waits, is ignored."""
        if reply.sender != self.sender or reply.boot != self.boot:
            return
        key = platform, reply.sequence
        if key in self._pending:
            self._end(key, reply)
            return
        requested = self._queries.pop(key, None)
        pending = self._pending.get(requested) if requested else None
        if requested is None or pending is None:
            return
        if reply.outcome is not Outcome.UNKNOWN:
            self._end(requested, replace(reply, sequence=pending.request.sequence))
            return
        pending.next_s = now_s + pending.wait_s
        pending.times_sent += 1
        self._outgoing.append((platform, pending.request))

    def undelivered(self, platform: str, request: CiRequest, reason: str, now_s: float, *, is_certain: bool) -> None:
        """The link has given a request up.

        Args:
            platform: to whom it went.
            request: what was given up; what is not waited for is ignored.
            reason: why.
            now_s: the time.
            is_certain: it was not handed over and will not be, on any link. Of a request that was sent more than once
                this says nothing of the other times.
        """
        pending = self._pending.get((platform, request.sequence))
        if pending is None or pending.request != request:
            return
        if is_certain and pending.times_sent == 1 and not pending.given_up:
            reply = self._ended_as(Outcome.REFUSED, request, f"not delivered: {reason}")
            self._end((platform, request.sequence), reply)
            return
        pending.given_up = reason
        pending.next_s = now_s

    def tick(self, now_s: float) -> None:
        """Asks for what is late, gives up what is too late."""
        for key, pending in list(self._pending.items()):
            if now_s >= pending.deadline_s:
                reason = f"{pending.platform} has not answered for {pending.timeout_s:g} s"
                if pending.given_up:
                    reason = f"it may have been delivered ({pending.given_up}), and {reason}"
                self._end(key, self._ended_as(Outcome.UNKNOWN, pending.request, reason))
            elif now_s >= pending.next_s:
                pending.next_s = now_s + TIMEOUT_S
                query = self._new(pending.platform, Query(boot=self.boot, sequence=pending.request.sequence))
                self._queries[pending.platform, query.sequence] = key
                self._outgoing.append((pending.platform, query))

    def next_tick_s(self) -> float | None:
        """When `tick` has something to do; None while nothing waits."""
        return min((min(p.next_s, p.deadline_s) for p in self._pending.values()), default=None)

    def outgoing(self) -> list[tuple[str, CiRequest]]:
        """Takes what is to be sent: platform and request."""
        used, self._outgoing = self._outgoing, []
        return used

    def ended(self) -> list[tuple[tuple[str, int], CiReply]]:
        """Takes the requests that have ended: their keys and replies."""
        used, self._ended = self._ended, []
        return used

    def _new(self, platform: str, body: AnyBody) -> CiRequest:
        sequence = self._sequences.get(platform, 0)
        self._sequences[platform] = sequence + 1
        return CiRequest(sender=self.sender, boot=self.boot, sequence=sequence, body=body)

    def _ended_as(self, outcome: Outcome, request: CiRequest, reason: str) -> CiReply:
        return CiReply(sender=self.sender, boot=self.boot, sequence=request.sequence, outcome=outcome, reason=reason)

    def _end(self, key: tuple[str, int], reply: CiReply | None) -> None:
        self._pending.pop(key, None)
        self._queries = {query: requested for query, requested in self._queries.items() if requested != key}
        if reply is not None:
            self._ended.append((key, reply))
