"""Host monitor on the clock host: reports losses and returns to command interface and stations."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from gloc3.component.context import HostContext
from gloc3.exchange import Publisher
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.hosts import (
    HOST_PRESENCE,
    HOSTS,
    HostLine,
    HostNames,
    HostPresence,
    HostState,
    HostStatus,
    HostSummary,
    HostWords,
    ProcessLine,
)
from gloc3.messages.readiness import SensorCondition

ROWS: Final = 5
"""So many hosts fit a frame of a radio."""
MOST_WORDS: Final = 120
UNKNOWN_MS: Final = 65_535
MOST_RESTARTS: Final = 65_535
MOST_LOAD: Final = 999
UP, LEFT = "up", "left"
_STATES: Final = list(HostState)
SUMMARY_S: Final = 2.0
"""Period of the host summaries for stations, s."""
NAMES_S: Final = 20.0
"""Period at which rarely changing data are repeated for late joiners, s."""
RENEWAL_S: Final = 5.0
"""Allowed absence of a host that announced the reload of its network file, s."""
OFFSET_S: Final = 0.1
"""Smallest reported change of a clock offset, s."""


class HostBook:
    """Latest state of each host of a platform.

    Args:
        names: hosts in the order of the platform file.
        own: the clock host.
    """

    def __init__(self, names: Sequence[str], own: str) -> None:
        self._own = own
        self._known: dict[str, HostStatus | None] = dict.fromkeys(names)
        self._lost: set[str] = set()

    @property
    def is_reportable(self) -> bool:
        """Whether a host has more than one process."""
        return len(self._known) > 1 or any(status and len(status.processes) > 1 for status in self._known.values())

    @property
    def parts(self) -> int:
        """Number of messages needed to report all hosts."""
        return max(1, math.ceil(len(self._known) / ROWS))

    def update(self, status: HostStatus) -> None:
        """What a host says of itself."""
        self._known[status.host] = status

    def presence(self, host: str, *, is_here: bool) -> None:
        """A host came or went."""
        self._known.setdefault(host, None)
        self._lost.discard(host) if is_here else self._lost.add(host)

    def summaries(self) -> Iterator[HostSummary]:
        """All of them, in parts that fit a frame."""
        lines = [self._line(index, *entry) for index, entry in enumerate(self._known.items())]
        for first in range(0, len(lines), ROWS):
            yield HostSummary(lines=lines[first : first + ROWS])

    def names(self) -> HostNames:
        """What seldom changes."""
        return HostNames(hosts=[_words(name, status) for name, status in self._known.items()])

    def _line(self, index: int, name: str, status: HostStatus | None) -> HostLine:
        state = _STATES.index(self._state(name, status))
        if status is None:
            return HostLine(index, state, 0, 0, 0, 0, UNKNOWN_MS)
        up = sum(process.phase == UP for process in status.processes)
        left = sum(process.phase == LEFT for process in status.processes)
        is_lost = name in self._lost
        return HostLine(
            index,
            state,
            0 if is_lost else up,
            0 if is_lost else len(status.processes) - up - left,
            min(MOST_RESTARTS, sum(process.restarts for process in status.processes)),
            min(MOST_LOAD, round(100.0 * status.load)),
            _bound_ms(status),
        )

    def _state(self, name: str, status: HostStatus | None) -> HostState:
        own = self._known.get(self._own)
        if name in self._lost:
            return HostState.LOST
        if status is None:
            return HostState.EXPECTED
        return HostState.DIFFERENT if own is not None and own.protocol != status.protocol else HostState.HERE


def _bound_ms(status: HostStatus) -> int:
    bound_ms = 1e3 * status.clock_bound_s
    return min(UNKNOWN_MS, math.ceil(bound_ms)) if math.isfinite(bound_ms) else UNKNOWN_MS


def _words(name: str, status: HostStatus | None) -> HostWords:
    if status is None:
        return HostWords(name)
    ended = [process for process in status.processes if process.last_words]
    last = max(ended, key=_phase_rank, default=None)
    words = "" if last is None else f"{last.name or 'main'}: {last.last_words}"[:MOST_WORDS]
    return HostWords(name, status.version, round(status.clock_offset_s, 2), words)


def _phase_rank(process: ProcessLine) -> bool:
    """Sort key: absent processes before returned ones."""
    return process.phase != UP


class HostWatch:
    """Monitors the liveliness tokens of the other hosts.

    Args:
        context: of the clock host's main process.
        host: its name.
        names: all hosts in the platform file.
        report: called with messages for people.
    """

    def __init__(
        self, context: HostContext, host: str, names: Sequence[str], report: Callable[[Severity, str], None]
    ) -> None:
        self._context, self._own, self._report = context, host, report
        self._publisher = Publisher(context.exchange, context.platform, "host_watch", context.random.getrandbits(32))
        self._topic = f"{context.platform}/{HOST_PRESENCE}"
        self._here: dict[str, bool] = {}
        """Last reported presence."""
        self._renews_until_s: dict[str, float] = {}
        self._away: set[str] = set()
        """Hosts with an announced absence."""
        self._boots: dict[str, int] = {}
        """Of the processes that spoke for the hosts last."""
        self._statuses: dict[str, HostStatus] = {}
        """Of the other hosts that are here."""
        self._book = HostBook(names, host)
        self._reported_names: HostNames | None = None
        self._reported_names_s = 0.0
        self._parts: list[HostSummary] = []
        """Summaries still to publish; one at a time, since a slow link keeps only the latest."""
        self._timer = context.loop.call_later(SUMMARY_S, self._summarize)
        hosts = f"{context.platform}/{HOSTS}/*"
        self._ends = [
            context.exchange.watch(hosts, self._changed),
            context.exchange.subscribe(hosts, self._receive_status),
        ]

    def close(self) -> None:
        """Tells nothing any more."""
        self._timer.cancel()
        for end in self._ends:
            end()

    def expect_renewal(self) -> None:
        """This host reads its network file again: all others are out of sight for a moment."""
        until_s = self._context.loop.time() + RENEWAL_S
        self._renews_until_s = {host: until_s for host, is_here in self._here.items() if is_here}

    def sensors(self) -> list[SensorCondition]:
        """Latest reported condition of the other hosts' sensors."""
        return [sensor for status in self._statuses.values() for sensor in status.sensors]

    def log_problems(self) -> list[str]:
        """Why logs of the other hosts that are here are not written any more, each in words."""
        return [
            f"{'/'.join(filter(None, (status.host, process.name)))}: {process.log_problem}"
            for status in self._statuses.values()
            for process in status.processes
            if process.log_problem
        ]

    def _receive_status(self, envelope: Envelope[Any]) -> None:
        status = envelope.payload
        if isinstance(status, HostStatus):
            self._book.update(status)
        if isinstance(status, HostStatus) and status.host != self._own:
            self._note_boot(status.host, envelope.source.boot)
            self._statuses[status.host] = status
            if status.is_renewing:
                self._renews_until_s[status.host] = self._context.loop.time() + RENEWAL_S
            if self._here.get(status.host):
                self._publish(HostPresence(host=status.host, is_here=True, status=status))

    def _note_boot(self, host: str, boot: int) -> None:
        """Handles a process that restarted before its end was noticed: it was lost, with all its state."""
        known, self._boots[host] = self._boots.get(host, boot), boot
        if boot != known and self._here.get(host):
            self._set_presence(host, is_here=False)
            self._set_presence(host, is_here=True)

    def _changed(self, token: str, is_here: bool) -> None:
        host, loop = token.rpartition("/")[2], self._context.loop
        left_s = self._renews_until_s.get(host, 0.0) - loop.time()
        self._away.discard(host)
        if is_here or left_s <= 0.0 or not self._here.get(host):
            self._set_presence(host, is_here=is_here)
        else:
            self._away.add(host)
            loop.call_later(left_s, self._miss, host)

    def _miss(self, host: str) -> None:
        """Handles a host whose announced absence has expired."""
        if host in self._away:
            self._away.discard(host)
            self._set_presence(host, is_here=False)

    def _set_presence(self, host: str, *, is_here: bool) -> None:
        if host == self._own or self._here.get(host, False) == is_here:
            return
        self._here[host] = is_here
        self._book.presence(host, is_here=is_here)
        if not is_here:
            self._statuses.pop(host, None)
        self._report(Severity.NOTICE if is_here else Severity.ERROR, f"host {host} is {'here' if is_here else 'lost'}")
        self._publish(HostPresence(host=host, is_here=is_here))

    def _summarize(self) -> None:
        """Publishes summaries for stations, if there are any."""
        now_s = self._context.loop.time()
        self._timer = self._context.loop.call_later(SUMMARY_S / self._book.parts, self._summarize)
        if not self._book.is_reportable:
            return
        names = self._book.names()
        if (
            self._reported_names is None
            or now_s > self._reported_names_s + NAMES_S
            or _is_new(self._reported_names, names)
        ):
            self._reported_names, self._reported_names_s = names, now_s
            self._publisher.publish(f"{self._context.platform}/ci/host_names", names, now_s)
        self._parts = self._parts or list(self._book.summaries())
        self._publisher.publish(f"{self._context.platform}/ci/hosts", self._parts.pop(0), now_s)

    def _publish(self, presence: HostPresence) -> None:
        self._publisher.publish(self._topic, presence, self._context.loop.time())


def _is_new(before: HostNames, now: HostNames) -> bool:
    """Whether a change is visible to people."""
    pairs = list(zip(before.hosts, now.hosts, strict=False))
    return len(before.hosts) != len(now.hosts) or any(
        (one.name, one.version, one.last_words) != (other.name, other.version, other.last_words)
        or abs(one.clock_offset_s - other.clock_offset_s) > OFFSET_S
        for one, other in pairs
    )
