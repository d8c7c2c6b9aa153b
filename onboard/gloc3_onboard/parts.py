"""The parts of an onboard process by name, and which of them a flight in virtual time does without."""

from collections.abc import Callable, Mapping
from typing import Final, TypeVar

P = TypeVar("P")

NOT_IN_FLIGHTS: Final[Mapping[str, str]] = {
    "run log": "rotates files by their size on a real disk; a flight writes one log, without measured times",
    "disk readers": "threads; a flight reads its logs at once",
    "picture writer": "a thread; a flight writes its pictures at once",
    "host agent": "leads child processes of the operating system, and reports the computer's load",
    "clock server": "answers other computers, which a flight does not have",
    "host watch": "follows other computers, which a flight does not have",
    "network events": "belong to the Zenoh network",
    "station bridge": "needs a Zenoh network with certificates",
    "signing memory": "keeps files of signed links; a flight's links have no keys",
    "terminal": "writes to stderr",
}
"""The parts of the onboard process that a flight in virtual time does without, with the reason."""


class Parts:
    """Named parts, closed in the reverse order of their making."""

    def __init__(self) -> None:
        self._kinds: dict[str, str] = {}
        self._ends: list[Callable[[], object]] = []

    def add(self, name: str, part: P, end: Callable[[], object] | None = None) -> P:
        """Lists a part, which `end` closes."""
        self._kinds[name] = type(part).__name__
        if end is not None:
            self._ends.append(end)
        return part

    def listed(self) -> dict[str, str]:
        """The name of the class of each part, by the part's name."""
        return dict(self._kinds)

    def close(self) -> None:
        """Closes all of them."""
        while self._ends:
            self._ends.pop()()
