"""SS: the autopilot's own state: mode, arming, battery, and why it would not arm."""

from collections.abc import Sequence

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.messages.vehicle import AutopilotState
from gloc3_onboard.sensors.devices import AutopilotTelemetry

REPORT_PERIOD_S = 0.2


class AutopilotStateSampler(SensorSampler[NoSettings]):
    """Reports the state on every change, and at 5 Hz."""

    loggable = ("mode_name",)

    autopilot = Output(AutopilotState)

    def __init__(self, device: AutopilotTelemetry) -> None:
        self.mode_name = ""
        self._device = device
        self._last: AutopilotState | None = None
        self._reported_s = float("-inf")

    def start(self) -> None:
        """Reports at once."""
        self._last, self._reported_s = None, float("-inf")
        self.until_stop.callback(self._device.on_state(self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reads the state; says it when it is new or due."""
        state = self._device.state()
        self.mode_name = state.mode_name
        if state == self._last and now_s - self._reported_s < REPORT_PERIOD_S - 1e-9:
            return []
        self._last, self._reported_s = state, now_s
        return [state]
