"""What is told again: what is due, and what has changed."""

import math
from collections.abc import Sequence

from gloc3.messages.envelope import Message


class News:
    """Remembers what was told when."""

    def __init__(self) -> None:
        self._at_s: dict[str, float] = {}
        self._last: dict[type, Message] = {}

    def is_due(self, what: str, period_s: float, now_s: float) -> bool:
        """Whether a period has gone by since this was last due."""
        if now_s - self._at_s.get(what, -math.inf) < period_s - 1e-6:
            return False
        self._at_s[what] = now_s
        return True

    def of(self, message: Message, *, is_due: bool) -> Sequence[Message]:
        """The message, if it is due or is not what was told last of its type."""
        if not is_due and self._last.get(type(message)) == message:
            return ()
        self._last[type(message)] = message
        return (message,)

    def forget(self, what: str) -> None:
        """Somebody knows nothing yet: everything is news, and this is due."""
        self._last.clear()
        self._at_s.pop(what, None)
