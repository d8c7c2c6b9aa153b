"""SS: the autopilot's own estimate of where it is."""

from collections.abc import Sequence

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.messages.vehicle import AutopilotPose
from gloc3_onboard.sensors.devices import AutopilotTelemetry


class AutopilotPoseSampler(SensorSampler[NoSettings]):
    """Reports each estimate once, with the time at which it was valid; the attitude alone while there is no position."""

    autopilot_pose = Output(AutopilotPose, frame="autopilot_ned")
    autopilot_attitude = Output(AutopilotPose, frame="autopilot_ned")

    def __init__(self, device: AutopilotTelemetry) -> None:
        self._device = device
        self._last_s = float("-inf")

    def start(self) -> None:
        """Starts with data from now on."""
        self._last_s = float("-inf")
        self.until_stop.callback(self._device.on_pose(self.request_cycle))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports an estimate that has not been reported yet."""
        stamped, attitude = self._device.pose(), self._device.attitude()
        if stamped is not None and stamped.t_s > self._last_s:
            self._last_s = stamped.t_s
            return [self.autopilot_pose.report(stamped.pose, t_s=stamped.t_s)]
        if attitude is not None and attitude.t_s > self._last_s:
            self._last_s = attitude.t_s
            return [self.autopilot_attitude.report(attitude.pose, t_s=attitude.t_s)]
        return []
