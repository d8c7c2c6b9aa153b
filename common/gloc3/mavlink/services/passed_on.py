"""What compiled lines pass on without the router: whose frames these are, so that one that comes back is known."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from gloc3.mavlink.services.fast_line import FastLine

_STILL: Final = 1 << 62


class PassedOn:
    """The compiled lines of a router, each of one link, and the senders whose frames they pass on, or did lately.

    A frame that such a line has passed on is not in the router's own memory. It can only matter for frames that say they
    are of the same sender and come by another link; of these it is asked.
    """

    def __init__(self) -> None:
        self._links: dict[FastLine, object] = {}
        self._until: dict[int, dict[FastLine, int]] = {}
        """By sender and line, the last turn in which the line may have passed on something."""
        self._ended: dict[FastLine, int] = {}
        """Lines that are closed, and the turn in which they were."""
        self.turn_number = 0

    def add(self, line: FastLine, link: object) -> None:
        """There is one more line, of a link."""
        self._links[line] = link

    def remove(self, line: FastLine) -> None:
        """A line passes nothing on any more."""
        self._revoke((line,))
        self._ended[line] = self.turn_number

    def begin(self, sender: int, line: FastLine) -> None:
        """A line passes on, from now on, what a sender says."""
        self._until.setdefault(sender, {})[line] = _STILL

    def revoke(self) -> None:
        """All lines give everything back, until they are asked anew."""
        self._revoke(self._links)

    def _revoke(self, given_back: Collection[FastLine]) -> None:
        for line in given_back:
            line.revoke()
        for lines in self._until.values():
            for line, until in lines.items():
                if line in given_back:
                    lines[line] = min(until, self.turn_number)

    def turn(self) -> None:
        """What came before the last turn is forgotten."""
        self.turn_number += 1
        for line in self._links:
            line.forget()
        for sender, lines in tuple(self._until.items()):
            for line in [line for line, until in lines.items() if until < self.turn_number - 1]:
                del lines[line]
            if not lines:
                del self._until[sender]
        for line in [line for line, turn in self._ended.items() if turn < self.turn_number - 1]:
            del self._ended[line], self._links[line]

    def elsewhere(self, sender: int, link: object) -> list[FastLine]:
        """Lines of other links that have lately passed on something of a sender."""
        lines = self._until.get(sender)
        return [] if lines is None else [line for line in lines if self._links[line] is not link]

    def has(self, frame: bytes, sender: int, link: object) -> bool:
        """Whether this very frame was passed on lately, from another link."""
        return any(line.holds(frame) for line in self.elsewhere(sender, link))
