"""One cycle of a component, as its worker runs it: `work()`, the writes that it decided, and the items to log."""

from collections.abc import Callable
from typing import Any

from gloc3.component.component import ActuatorDriver, Component
from gloc3.component.data_logger import read_items
from gloc3.component.error_handler import Failure
from gloc3.component.gate import Gate
from gloc3.component.guard import guard
from gloc3.component.method_job import make_safe
from gloc3.component.outlets import Outlets, Routed
from gloc3.component.ports import Actuation, Inbox
from gloc3.errors import Misuse


class CycleJob:
    """The cycles of a component from one start to the next stop; one at a time, so that the object serves them all."""

    __slots__ = (
        "_component",
        "_gate",
        "_outlets",
        "_stopwatch",
        "cost_s",
        "error",
        "failures",
        "inbox",
        "is_quiet",
        "items",
        "logged",
        "now_s",
        "results",
    )

    def __init__(
        self, component: Component[Any], outlets: Outlets, gate: Gate, stopwatch: Callable[[], float] | None
    ) -> None:
        """The cycles of a component.

        Args:
            component: whose cycles.
            outlets: where its results go.
            gate: what the component's jobs pass.
            stopwatch: measures what a cycle costs; None where the cost is a model's.
        """
        self._component = component
        self._outlets = outlets
        self._gate = gate
        self._stopwatch = stopwatch
        self.now_s = 0.0
        """When the cycle begins."""
        self.inbox = Inbox({}, {})
        self.is_quiet = False
        self.items: tuple[str, ...] = ()
        """What the data logger records."""
        self.results: list[Routed] = []
        self.logged: dict[str, Any] | None = None
        self.error: BaseException | None = None
        self.failures: list[Failure] = []
        self.cost_s = 0.0
        """What the cycle cost; set beforehand where a model says it."""

    def run(self) -> "CycleJob":
        """On the worker."""
        stopwatch = self._stopwatch
        begin_s = 0.0 if stopwatch is None else stopwatch()
        self.failures = []
        _, self.error = guard(self._work)
        if self.error is not None:
            if not self.is_quiet and not self._gate.is_shut:
                make_safe(self._component, self.failures)
            self._gate.is_shut = True
        if stopwatch is not None:
            self.cost_s = stopwatch() - begin_s
        return self

    def _work(self) -> None:
        self.results = results = []
        self.logged = None
        component, now_s, route = self._component, self.now_s, self._outlets.route
        writes: list[Actuation] = []
        for result in component.work(now_s, self.inbox):
            routed = route(result, now_s)
            if isinstance(routed, Routed):
                results.append(routed)
            else:
                writes.append(routed)
        if writes:
            self._actuate(writes)
        if self.items:
            self.logged = read_items(component, self.items, self.failures)

    def _actuate(self, writes: list[Actuation]) -> None:
        component = self._component
        if not isinstance(component, ActuatorDriver):
            raise Misuse(f"{type(component).__name__} is no actuator driver: it cannot write to a device")
        for write in writes:
            if not self.is_quiet and not self._gate.is_shut:
                component.actuate(write.write)
