"""What the clock host knows of all hosts, in the few bytes that a radio has for it."""

import math
from collections.abc import Iterator, Sequence
from typing import Final

from gloc3.messages.hosts import HostLine, HostNames, HostState, HostStatus, HostSummary, HostWords, ProcessLine

ROWS: Final = 5
"""So many hosts fit a frame of a radio."""
MOST_WORDS: Final = 120
UNKNOWN_MS: Final = 65_535
MOST_RESTARTS: Final = 65_535
MOST_LOAD: Final = 999
UP, LEFT = "up", "left"
_STATES: Final = list(HostState)


class HostBook:
    """The hosts of a platform, each as it was heard last.

    Args:
        names: of those in the platform's file, in its order.
        own: the clock host.
    """

    def __init__(self, names: Sequence[str], own: str) -> None:
        self._own = own
        self._known: dict[str, HostStatus | None] = dict.fromkeys(names)
        self._lost: set[str] = set()

    @property
    def is_reportable(self) -> bool:
        """Whether there is more than one process on one host."""
        return len(self._known) > 1 or any(status and len(status.processes) > 1 for status in self._known.values())

    @property
    def parts(self) -> int:
        """In how many messages all of them are told."""
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
    """What is away now says more than what is back again."""
    return process.phase != UP
