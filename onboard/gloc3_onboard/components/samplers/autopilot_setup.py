"""SS: how the autopilot is set up: firmware, parameters that matter, and its sensors' health."""

from collections.abc import Callable, Sequence
from typing import Protocol

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.messages.readiness import AutopilotSetup, ReadSetup
from gloc3_onboard.sensors.devices import Unwatch

REPORT_PERIOD_S = 5.0


class AutopilotInspection(Protocol):
    """Access to an autopilot's setup. Both methods may be called from any thread."""

    def setup(self) -> AutopilotSetup:
        """What is known now."""

    def read_setup(self, number: int) -> None:
        """Starts reading the setup; its end is reported with this number."""

    def on_setup(self, changed: Callable[[], None]) -> Unwatch:
        """Has `changed` called, from any thread, when more is known."""


class AutopilotSetupSampler(SensorSampler[NoSettings]):
    """Reports the setup on every change and periodically; reads it again on request."""

    read_setup = Input(ReadSetup)
    autopilot_setup = Output(AutopilotSetup)

    def __init__(self, device: AutopilotInspection) -> None:
        self._device = device
        self._clear()

    def _clear(self) -> None:
        self._last: AutopilotSetup | None = None
        self._reported_s = float("-inf")

    def start(self) -> None:
        """Reports at once."""
        self._clear()
        self.until_stop.callback(self._device.on_setup(self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reads the setup; says it when it is new or due."""
        for requested in inbox.new(self.read_setup):
            self._device.read_setup(requested.payload.number)
        setup = self._device.setup()
        if setup == self._last and now_s - self._reported_s < REPORT_PERIOD_S - 1e-9:
            return []
        self._last, self._reported_s = setup, now_s
        return [setup]
