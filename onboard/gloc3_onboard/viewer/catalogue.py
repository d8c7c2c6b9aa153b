"""Viewable topics of a platform, from its deployment and the table of topics."""

from functools import cached_property
from typing import Final

from gloc3.component.deployment import ComponentRow
from gloc3.errors import Gloc3Error, Refused, nearest
from gloc3.messages.topics import TopicTable, matches
from gloc3.messages.watch import WATCH, TopicEntry
from gloc3.platform.platform import Platform

OFFERED_OF_EACH: Final = ("status", "event", "reply", "function", "function_reply", "internal")
"""Viewable topics of every component, omitted from the list."""


class Catalogue:
    """Topics that the components of a platform publish."""

    def __init__(self, platform: Platform, topics: TopicTable) -> None:
        self._topics = topics
        self._rows = {row.name: row for row in platform.components}

    @cached_property
    def entries(self) -> tuple[TopicEntry, ...]:
        """What is listed: every output of a component, and the internal state of those that log it."""
        return tuple(self._list())

    def check(self, topic: str) -> str:
        """Returns the topic if it is viewable.

        Raises:
            Refused: not viewable; the reason names the nearest topic.
        """
        names = [entry.name for entry in self.entries]
        is_of_component = any(
            matches(f"components/{name}/{what}", topic) for name in self._rows for what in OFFERED_OF_EACH
        )
        row = self._topics.row(f"platform/{topic}")
        is_alone = row is not None and any(name == topic for name, _ in self._topics)
        if topic.startswith(WATCH) or row is None or not (topic in names or is_of_component or is_alone):
            raise Refused(f"there is no topic {topic!r}; {nearest(topic, names)}")
        return topic

    def type_of(self, topic: str) -> type:
        """The type of a viewable topic."""
        row = self._topics.row(f"platform/{topic}")
        assert row is not None
        return row.message

    def _list(self) -> list[TopicEntry]:
        found: dict[str, TopicEntry] = {}
        for component in self._rows.values():
            for topic in self._outputs(component):
                row = self._topics.row(f"platform/{topic}")
                if row is not None and not topic.startswith(WATCH):
                    entry = TopicEntry(topic, row.message.__name__, row.rate_hz, component.name)
                    found.setdefault(topic, entry)
            if component.log:
                name = f"components/{component.name}/internal"
                found[name] = TopicEntry(name, "InternalState", component.rate_hz or 0.0, component.name)
        return list(found.values())

    @staticmethod
    def _outputs(component: ComponentRow) -> list[str]:
        try:
            ports = component.load_class().outputs
        except Gloc3Error:  # its host tells that it cannot be loaded
            return []
        return [topic for port in ports for topic in component.topics(port) if "{key}" not in topic]
