"""Outlets: route the results of a component to its topics, and check their types."""

import math
from typing import Any, Final

import msgspec

from gloc3.component.component import Component
from gloc3.component.deployment import ComponentRow
from gloc3.component.ports import Actuation, Output, PortReport, Result
from gloc3.errors import Misuse
from gloc3.messages.envelope import Message
from gloc3.messages.topics import TopicTable

KEY: Final = "{key}"


class PortOutlet:
    """An output of one hosted component, bound to its topics."""

    __slots__ = ("frame", "is_keyed", "message", "port", "reported_s", "topics")

    def __init__(self, port: Output[Any], topics: tuple[str, ...]) -> None:
        self.port = port.name
        self.message: type[Message] = port.message
        self.frame = port.frame
        self.topics = topics
        self.is_keyed = any(KEY in topic for topic in topics)
        self.reported_s = -math.inf
        """When something was reported last."""

    def accepts(self, key: object) -> bool:
        """Whether a key fits: one level of a topic, or any number of levels at the end of a topic."""
        if not self.is_keyed or not isinstance(key, str):
            return key == ""
        is_at_end = all(topic.endswith(KEY) for topic in self.topics)
        return "" not in key.split("/") and (is_at_end or "/" not in key)


class Routed(msgspec.Struct, frozen=True, gc=False):
    """A result that has been checked and has an outlet."""

    outlet: PortOutlet
    message: Message
    t_s: float
    key: str = ""


class Outlets:
    """The outputs of one hosted component.

    Args:
        row: its row of the deployment.
        component: its class.
        platform: the platform's name.
        topics: when each topic counts as silent.
    """

    def __init__(self, row: ComponentRow, component: type[Component[Any]], platform: str, topics: TopicTable) -> None:
        self._class_name = component.__name__
        self._by_port = {
            name: PortOutlet(port, tuple(f"{platform}/{topic}" for topic in row.topics(name)))
            for name, port in component.outputs.items()
        }
        outlets = list(self._by_port.values())
        types = [outlet.message for outlet in outlets]
        self._by_type = {
            outlet.message: outlet for outlet in outlets if types.count(outlet.message) == 1 and not outlet.is_keyed
        }

        self._speaking = [
            (outlet, topic.partition("/")[2], known)
            for outlet in outlets
            for topic in outlet.topics
            if not outlet.is_keyed and (known := topics.row(topic)) is not None and known.rate_hz
        ]
        """Outlets of topics that are expected to publish continuously."""

    def silent(self, now_s: float, since_s: float, rate_hz: float) -> list[str]:
        """Topics, without the platform's name, on which nothing was reported for too long.

        Args:
            now_s: seconds since boot of the clock host.
            since_s: since when it could have reported.
            rate_hz: cycle rate, the upper limit of a topic's rate; 0 where it is unknown.
        """
        return [
            topic
            for outlet, topic, row in self._speaking
            if now_s - max(outlet.reported_s, since_s)
            > row.silent_after / (min(row.rate_hz, rate_hz) if rate_hz else row.rate_hz)
        ]

    def route(self, result: Result, cycle_s: float) -> Routed | Actuation:
        """Finds the outlet of something that `work()` returned.

        Raises:
            Misuse: it is no result, or fits no output of the class.
        """
        outlet = self._by_type.get(type(result))  # type: ignore[arg-type] # anything may come from an author
        if outlet is not None:
            return Routed(outlet, result, cycle_s)  # type: ignore[arg-type] # its type is that of a port
        if isinstance(result, Actuation):
            return result
        if isinstance(result, PortReport):
            return self._route_report(result, cycle_s)
        raise Misuse(f"{self._class_name} reported {type(result).__name__}, which fits no single output of its class")

    def _route_report(self, report: PortReport, cycle_s: float) -> Routed:
        outlet = self._by_port.get(report.port)
        if outlet is None:
            raise Misuse(f"{self._class_name} has no output {report.port!r}")
        if type(report.message) is not outlet.message:
            found = type(report.message).__name__
            raise Misuse(f"{self._class_name}.{outlet.port} takes {outlet.message.__name__}, not {found}")
        t_s = cycle_s if report.t_s is None else report.t_s
        if not isinstance(t_s, float | int) or not math.isfinite(t_s):
            raise Misuse(f"{self._class_name}.{outlet.port}: {t_s!r} is no time of validity")
        if not outlet.accepts(report.key):
            raise Misuse(f"{self._class_name}.{outlet.port}: {report.key!r} is no key for {', '.join(outlet.topics)}")
        return Routed(outlet, report.message, t_s, report.key)
