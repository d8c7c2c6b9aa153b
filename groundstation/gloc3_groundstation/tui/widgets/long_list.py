"""A list of any length: only visible rows are requested, and the cursor stays with its row or at the end."""

from collections.abc import Sequence
from typing import Protocol

from textual.events import MouseScrollDown, MouseScrollUp
from textual.message import Message

from gloc3_groundstation.tui.widgets.panel import ListPanel


class Numbers(Protocol):
    """Rising numbers, of which some may be added at either end at any time."""

    def __len__(self) -> int:
        """How many there are."""

    def __getitem__(self, place: int, /) -> int:
        """The number at a place."""

    def place(self, number: int) -> int:
        """Where a number is, or the next higher one."""


class LongList(ListPanel):
    """Shows a window of a long list; its owner fills the window with `show_rows` from `window()`.

    The cursor follows the last row until it is moved up, and again when it is moved to the end.
    """

    class Scrolled(Message):
        """Other rows are to be shown."""

    def __init__(self, *, id: str, classes: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id, classes=classes)
        self._number = -1
        self._top = 0
        self._numbers: Numbers | None = None

    @property
    def follows(self) -> bool:
        """Whether the cursor stays at the end."""
        return self._number < 0

    @property
    def number(self) -> int:
        """The number under the cursor; -1 in an empty list."""
        place = self.cursor
        return self._numbers[place] if self._numbers is not None and place >= 0 else -1

    @property
    def cursor(self) -> int:
        """The place of the cursor; -1 in an empty list."""
        if self._numbers is None or not len(self._numbers):
            return -1
        last = len(self._numbers) - 1
        return last if self.follows else min(last, self._numbers.place(self._number))

    def window(self, numbers: Numbers) -> Sequence[int]:
        """The numbers that are to be seen, the one under the cursor among them."""
        before = self.cursor
        self._numbers = numbers
        place, height = self.cursor, max(1, self.scrollable_content_region.height)
        if not self.follows:
            self._top += place - before  # what is found above moves nothing
        top = min(max(self._top, place - height + 1), place, max(0, len(numbers) - height))
        self._top = max(0, top)
        return [numbers[n] for n in range(self._top, min(len(numbers), self._top + height))]

    def follow(self) -> None:
        """Goes to the end, and stays there."""
        self._number = -1
        self.post_message(self.Scrolled())

    def action_move(self, rows: int) -> None:
        """Moves the cursor by `rows` rows; ten mean a page."""
        if self._numbers is None or not len(self._numbers):
            return
        if abs(rows) == 10:
            rows = rows // 10 * max(1, self.size.height - 2)
        last = len(self._numbers) - 1
        place = max(0, min(last, self.cursor + rows)) if abs(rows) < 1_000_000 else 0 if rows < 0 else last
        self._number = -1 if place == last else self._numbers[place]
        self.post_message(self.Scrolled())

    def _on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        event.stop()
        self.action_move(-3)

    def _on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        event.stop()
        self.action_move(3)
