"""Which topics a log has, and at which rate: by their rows, the platform file, and requests while recording."""

from collections.abc import Mapping
from typing import Annotated, Protocol

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.messages.topics import TopicRow, TopicTable, matches

TopicChoice = bool | Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]
"""Whether a topic is recorded: all of it, nothing, or at most so many messages a second."""


class TopicLog(Protocol):
    """The log of a process, as far as others may change what it records."""

    def select(self, chosen: Mapping[str, TopicChoice]) -> Mapping[str, TopicChoice]:
        """Changes what is recorded of some topics; returns all that is recorded differently from the topics' rows.

        Raises:
            Refused: a pattern fits no topic.
        """

    @property
    def mb_per_min(self) -> float:
        """How fast it has grown in the last minute, in 10^6 bytes a minute; 0 where that is not known."""


def merged(
    before: Mapping[str, TopicChoice], chosen: Mapping[str, TopicChoice], topics: TopicTable
) -> dict[str, TopicChoice]:
    """Earlier choices and new ones, the new ones last.

    Raises:
        Refused: a pattern fits no topic.
    """
    known = [name for name, _ in topics]
    for pattern in chosen:
        if not any(matches(pattern, name) or matches(name, pattern) for name in known):
            raise Refused(f"no topic fits {pattern!r}; {nearest(pattern, known)}")
    return {name: choice for name, choice in before.items() if name not in chosen} | dict(chosen)


def period_s(topic: str, row: TopicRow | None, chosen: Mapping[str, TopicChoice]) -> float | None:
    """Shortest time between two recorded messages of a topic, s; 0 for all messages, None for none.

    Args:
        topic: its name, without the platform's.
        row: its row; a topic without one is recorded.
        chosen: patterns with what is recorded of their topics; an exact name counts most, then the last that fits.
    """
    choice: TopicChoice | None = chosen.get(topic)
    if choice is None:
        fitting = [choice for pattern, choice in chosen.items() if matches(pattern, topic)]
        choice = fitting[-1] if fitting else row is None or row.is_logged
    if isinstance(choice, bool):
        return 0.0 if choice else None
    return 1.0 / choice
