"""SS: the autopilot's satellite receiver."""

from collections.abc import Sequence

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.messages.perception import SatelliteFix
from gloc3_onboard.sensors.devices import Satellites


class SatellitesSampler(SensorSampler[NoSettings]):
    """Reports each fix once, and that there is none where the receiver says so."""

    loggable = ("seen",)

    satellites = Output(SatelliteFix)

    def __init__(self, device: Satellites) -> None:
        self.seen = 0
        """Satellites."""
        self._device = device
        self._last_s = float("-inf")

    def start(self) -> None:
        """Starts with data from now on."""
        self._last_s = float("-inf")
        self.until_stop.callback(self._device.on_fix(self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a fix that has not been reported yet."""
        stamped = self._device.fix()
        if stamped is None or stamped.t_s <= self._last_s:
            return []
        self._last_s = stamped.t_s
        self.seen = stamped.fix.satellites
        return [self.satellites.report(stamped.fix, t_s=stamped.t_s)]
