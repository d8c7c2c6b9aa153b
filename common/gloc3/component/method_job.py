"""What a host has its worker do with a component's methods: one after the other, until one raises."""

from collections.abc import Callable, Sequence
from typing import Any, Final

from gloc3.component.component import ActuatorDriver, Component
from gloc3.component.error_handler import Failure
from gloc3.component.gate import Gate
from gloc3.component.guard import guard
from gloc3.errors import Refused

CHECK_LEAVING: Final = "check_leaving"
MAKE_SAFE: Final = "make_safe"


class MethodJob:
    """Runs methods in order; those that are tolerated may fail, any other error ends the job and shuts the gate."""

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
        """A job for the worker.

        Args:
            component: whose methods.
            methods: their names.
            gate: what the component's jobs pass.
            settings: what `initialize` is given.
            tolerated: methods whose failures are only counted.
            is_device_live: whether a driver has written to its device and has not left it safe since.
            create: makes the component that `initialize` is called on, where the present one cannot be used again.
        """
        self.component = component
        self.called: list[str] = []
        self.error: BaseException | None = None
        self.failures: list[Failure] = []
        self.is_skipped = False
        """The gate was shut before the job's turn came."""
        self._methods = methods
        self._gate = gate
        self.settings = settings
        self._tolerated = tolerated
        self._is_device_live = is_device_live
        self._create = create

    @property
    def is_refused(self) -> bool:
        """Whether the component turned the request down before anything was changed."""
        harmless = (CHECK_LEAVING, MAKE_SAFE, *self._tolerated)
        return isinstance(self.error, Refused) and all(name in harmless for name in self.called[:-1])

    def run(self) -> "MethodJob":
        """On the worker."""
        self.is_skipped = self._gate.is_shut
        _, self.error = guard(self._run)
        if self.error is not None and not self.is_refused:
            if self._is_device_live and not self._gate.is_shut:
                make_safe(self.component, self.failures)
            self._gate.is_shut = True
        return self

    def _run(self) -> None:
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
                    self.failures.append(Failure(name, error))
            else:
                getattr(self.component, name)(*arguments)


def make_safe(component: Component[Any], failures: list[Failure]) -> None:
    """Leaves a driver's device safe after an error; other components have none."""
    if isinstance(component, ActuatorDriver):
        _, error = guard(component.make_safe)
        if error is not None:
            failures.append(Failure(MAKE_SAFE, error))
