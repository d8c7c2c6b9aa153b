"""Jobs of a host's worker: a sequence of methods, one function, or a cycle; each guarded and gated."""

import threading
from collections.abc import Callable, Sequence
from typing import Any, Final, Self

import msgspec

from gloc3.component.component import ActuatorDriver, Component, FunctionEntry, SensorSampler
from gloc3.component.data_logger import read_items
from gloc3.component.error_handler import CountedError
from gloc3.component.outlets import Outlets, Routed
from gloc3.component.ports import Actuation, Inbox
from gloc3.component.workers import guard
from gloc3.errors import Misuse, Refused
from gloc3.messages.envelope import Message

CHECK_LEAVING: Final = "check_leaving"
MAKE_SAFE: Final = "make_safe"


class Gate:
    """Open while the jobs of a component may go on: shut by the first that fails, or from outside when one is stuck.

    Jobs check it before every call of an author's method. So jobs queued behind a failed one do not run, and a thread
    that returns from a stuck call writes nothing to a device. A shut gate is never opened again.
    """

    __slots__ = ("is_shut",)

    def __init__(self) -> None:
        self.is_shut = False


class ComponentJob:
    """Runs an author's code on the worker: an error ends the job, makes a live device safe, and shuts the gate.

    Args:
        component: owner of the methods.
        gate: gate of the component's jobs.
        is_device_live: whether a driver has written to its device and has not made it safe since.
    """

    def __init__(self, component: Component[Any], gate: Gate, *, is_device_live: bool = False) -> None:
        self.component = component
        self.error: BaseException | None = None
        self.failures: list[CountedError] = []
        """What went wrong without ending the job."""
        self.is_skipped = False
        """The gate was shut before the job's turn came."""
        self._gate = gate
        self._is_device_live = is_device_live

    @property
    def is_refused(self) -> bool:
        """Whether the component turned the request down before anything was changed."""
        return isinstance(self.error, Refused)

    def run(self) -> Self:
        """On the worker; does not raise."""
        self.is_skipped = self._gate.is_shut
        if not self.is_skipped:
            _, self.error = guard(self._work)
            if self.error is not None:
                self._end_failed()
        return self

    def _end_failed(self) -> None:
        """Ends the jobs of the component after an error, unless it was a refusal."""
        if not self.is_refused:
            if self._is_device_live and not self._gate.is_shut:
                self._make_safe()
            self._gate.is_shut = True

    def _work(self) -> None:
        """Calls the author's methods."""
        raise NotImplementedError

    def _make_safe(self) -> None:
        """Leaves a driver's device safe after an error; other components have none."""
        if isinstance(self.component, ActuatorDriver):
            _, error = guard(self.component.make_safe)
            if error is not None:
                self.failures.append(CountedError(MAKE_SAFE, error))


class MethodJob(ComponentJob):
    """Runs methods in order; tolerated methods may fail, any other error ends the job.

    A `start()` that fails or returns after its time-out is undone here, since no `stop()` follows.

    Args:
        component: owner of the methods.
        methods: their names.
        gate: gate of the component's jobs.
        settings: settings passed to `initialize`.
        tolerated: methods whose failures are only counted.
        is_device_live: whether a driver has written to its device and has not made it safe since.
        create: creates a new component for `initialize`, where the present one cannot be reused.
    """

    def __init__(
        self,
        component: Component[Any],
        methods: Sequence[str],
        gate: Gate,
        *,
        settings: Any = None,
        tolerated: Sequence[str] = (),
        is_device_live: bool = False,
        create: Callable[[], Component[Any]] | None = None,
    ) -> None:
        super().__init__(component, gate, is_device_live=is_device_live)
        self.called: list[str] = []
        self.settings = settings
        self._methods = methods
        self._tolerated = tolerated
        self._create = create
        self._is_over = False
        self._end_lock = threading.Lock()

    def run(self) -> Self:
        """On the worker; does not raise."""
        super().run()
        with self._end_lock:
            self._is_over, is_late = True, self._gate.is_shut
        if "start" in self.called and (is_late or self.error is not None):
            self._undo_start()
        return self

    def abandon(self) -> bool:
        """Shuts the gate, in the loop's thread; returns whether `start()` has ended already, so that `stop()` is due."""
        with self._end_lock:
            self._gate.is_shut = True
            return self._is_over and "start" in self.called and self.error is None

    @property
    def is_refused(self) -> bool:
        """Whether the component turned the request down before anything was changed."""
        harmless = (CHECK_LEAVING, MAKE_SAFE, *self._tolerated)
        return super().is_refused and all(name in harmless for name in self.called[:-1])

    def _work(self) -> None:
        for name in self._methods:
            if self._gate.is_shut:
                return
            if name == "initialize" and self._create is not None:
                self.component = self._create()
            self.called.append(name)
            arguments = (self.settings,) if name == "initialize" else ()
            if name in self._tolerated:
                _, error = guard(getattr(self.component, name), *arguments)
                if error is not None:
                    self.failures.append(CountedError(name, error))
            else:
                getattr(self.component, name)(*arguments)

    def _undo_start(self) -> None:
        error: BaseException | None = None
        if self.error is None:
            _, error = guard(self.component.stop)
        elif isinstance(self.component, SensorSampler):
            _, error = guard(self.component.until_stop.close)
        if error is not None:
            self.failures.append(CountedError("stop", error))


class FunctionJob(ComponentJob):
    """Runs one function of a component.

    Args:
        component: owner of the function.
        entry: the function.
        arguments: of the function's type.
        now_s: time of the request.
        gate: gate of the component's jobs.
        is_device_live: whether a driver has written to its device and has not made it safe since.
    """

    def __init__(
        self,
        component: Component[Any],
        entry: FunctionEntry,
        arguments: Message,
        now_s: float,
        gate: Gate,
        *,
        is_device_live: bool,
    ) -> None:
        super().__init__(component, gate, is_device_live=is_device_live)
        self.result: dict[str, Any] = {}
        self._entry = entry
        self._arguments = arguments
        self._now_s = now_s

    def _work(self) -> None:
        reply = getattr(self.component, self._entry.method)(self._arguments, self._now_s)
        if not isinstance(reply, self._entry.reply):
            found, expected = type(reply).__name__, self._entry.reply.__name__
            raise Misuse(f"function {self._entry.name} gave {found}, not {expected}")
        self.result = msgspec.to_builtins(reply, builtin_types=(bytes,))


class CycleJob(ComponentJob):
    """Cycles of a component from one start to the next stop: `work()`, the resulting writes, the items to log.

    Cycles do not overlap, so one object serves them all.

    Args:
        component: owner of the cycles.
        outlets: outputs of the component.
        gate: gate of the component's jobs.
        stopwatch: measures the cost of a cycle; None where the cost is modelled.
    """

    def __init__(
        self, component: Component[Any], outlets: Outlets, gate: Gate, stopwatch: Callable[[], float] | None
    ) -> None:
        super().__init__(component, gate)
        self._outlets = outlets
        self._stopwatch = stopwatch
        self.now_s = 0.0
        """Start time of the cycle."""
        self.inbox = Inbox({}, {})
        self.is_quiet = False
        self.items: tuple[str, ...] = ()
        """What the data logger records."""
        self.results: list[Routed] = []
        self.logged: dict[str, Any] | None = None
        self.cost_s = 0.0
        """What the cycle cost; set beforehand where a model says it."""

    @property
    def is_refused(self) -> bool:
        """A cycle is no request: it cannot be turned down."""
        return False

    def run(self) -> Self:
        """On the worker; does not raise."""
        stopwatch = self._stopwatch
        begin_s = 0.0 if stopwatch is None else stopwatch()
        self.failures = []
        self._is_device_live = not self.is_quiet
        _, self.error = guard(self._work)
        if self.error is not None:
            self._end_failed()
        if stopwatch is not None:
            self.cost_s = stopwatch() - begin_s
        return self

    def _work(self) -> None:
        self.results = results = []
        self.logged = None
        component, now_s, route = self.component, self.now_s, self._outlets.route
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
        component = self.component
        if not isinstance(component, ActuatorDriver):
            raise Misuse(f"{type(component).__name__} is no actuator driver: it cannot write to a device")
        for write in writes:
            if not self.is_quiet and not self._gate.is_shut:
                component.actuate(write.write)
