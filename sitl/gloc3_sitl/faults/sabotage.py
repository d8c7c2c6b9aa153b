"""Fault injection into the onboard process: slow cycles, crashes, corrupted messages."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import Any, Final

from gloc3.component.component import Component
from gloc3.component.deployment import ComponentRow
from gloc3.component.ports import Inbox, Result
from gloc3.errors import Gloc3Error
from gloc3.exchange import LocalExchange
from gloc3.exchange.base import Unsubscribe
from gloc3.messages.envelope import Envelope

Tap = Callable[[Envelope[Any]], Sequence[Envelope[Any]]]
"""Intercepts a message on a topic; returns the messages that replace it."""

CycleCost = Callable[[str, float], float]
"""What a cycle of a component costs at a time, in seconds."""


class InjectedFault(Gloc3Error):
    """The error of an injected crash."""


class TappedExchange(LocalExchange):
    """Local middleware with taps on its topics; all receivers, the recorder included, get the taps' output."""

    def __init__(self) -> None:
        super().__init__()
        self._taps: dict[str, list[Tap]] = {}

    def tap(self, topic: str, tap: Tap) -> Unsubscribe:
        """Adds a tap to a topic (with the platform's name), after the existing ones."""
        self._taps.setdefault(topic, []).append(tap)

        def remove() -> None:
            self._taps[topic].remove(tap)
            if not self._taps[topic]:
                del self._taps[topic]

        return remove

    def publish(self, envelope: Envelope[Any]) -> None:
        """Publishes the output of the topic's taps."""
        taps = self._taps.get(envelope.topic)
        if taps is None:
            super().publish(envelope)
            return
        passing: Sequence[Envelope[Any]] = (envelope,)
        for tap in taps:
            passing = [after for before in passing for after in tap(before)]
        for one in passing:
            super().publish(one)

    def deliver(self, envelope: Envelope[Any]) -> None:
        """Publishes a message without the taps."""
        super().publish(envelope)


class FaultInjector:
    """Sets the cost and the crashes of cycles, also after a restart of the onboard process.

    Args:
        loop: event loop whose clock is used.
        cost_s: cost of cycles without a fault; None for 0.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, cost_s: CycleCost | None = None) -> None:
        self._loop: Final = loop
        self._base_s = cost_s
        self._costs_s: dict[str, list[float]] = {}
        self.replaced: Final[dict[str, ComponentRow]] = {}
        """Rows that components are made of from now on, in place of the platform's."""
        self._leaks_s: dict[str, list[list[float]]] = {}
        """Component to its leaks: by how much more a cycle takes, and how much it takes by now."""
        self._crashes: dict[str, list[bool]] = {}
        """Component to its crashes: True for one that is over after a cycle."""

    # --- what faults switch on ---

    def slow(self, component: str, cost_s: float) -> Unsubscribe:
        """Makes each cycle take this much longer; infinite for cycles that never end."""
        self._costs_s.setdefault(component, []).append(cost_s)
        return lambda: self._costs_s[component].remove(cost_s)

    def hang(self, component: str) -> Unsubscribe:
        """Makes cycles never end."""
        return self.slow(component, inf)

    def leak(self, component: str, more_s: float) -> Unsubscribe:
        """Makes each cycle take this much longer than the one before, until the component is made anew."""
        self._leaks_s.setdefault(component, []).append([more_s, 0.0])
        leak = self._leaks_s[component][-1]
        return lambda: self._leaks_s[component].remove(leak)

    def crash(self, component: str, *, is_once: bool) -> Unsubscribe:
        """Makes the next cycle raise an error, or every one."""
        crashes = self._crashes.setdefault(component, [])
        crashes.append(is_once)

        def end() -> None:
            if is_once in crashes:
                crashes.remove(is_once)

        return end

    # --- what the harness asks ---

    def cost_s(self, component: str, now_s: float) -> float:
        """Returns the duration of a cycle: the fault model of the hosts."""
        base_s = self._base_s(component, now_s) if self._base_s is not None else 0.0
        if not self._leaks_s and not self._costs_s:
            return base_s
        for leak in self._leaks_s.get(component, ()):
            leak[1] += leak[0]
            base_s += leak[1]
        costs_s = self._costs_s.get(component)
        return base_s + sum(costs_s) if costs_s else base_s

    def create(self, row: ComponentRow, devices: Mapping[str, Any]) -> Component[Any]:
        """Creates a component whose cycles can be crashed."""
        component = self.replaced.get(row.name, row).create(devices)
        for leak in self._leaks_s.get(row.name, ()):
            leak[1] = 0.0
        work = component.work

        def with_faults(now_s: float, inbox: Inbox) -> Sequence[Result]:
            crashes = self._crashes.get(row.name)
            if crashes:
                if crashes[0]:
                    crashes.pop(0)
                raise InjectedFault(f"injected crash of {row.name}")
            return work(now_s, inbox)

        component.work = with_faults  # type: ignore[method-assign] # this one object is wrapped, not its class
        return component
