"""What an autopilot has told, as samplers read it: the telemetry, height, satellites and wheels devices; from any thread."""

from collections.abc import Callable
from typing import Final

from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import AutopilotState
from gloc3_onboard.autopilot.inspection import Inspection
from gloc3_onboard.autopilot.sensors import FIX_HZ, WHEELS_HZ, AutopilotSensors
from gloc3_onboard.autopilot.telemetry import Telemetry
from gloc3_onboard.sensors.devices import Bell, Stamped, StampedFix, StampedHeight, StampedWheels, Unwatch


class ToldByAutopilot:
    """The reading half of the autopilot's link; what is read is immutable.

    Args:
        telemetry: state, pose and height.
        sensors: what is asked for once somebody uses it.
        inspection: firmware and parameters.
    """

    def __init__(self, telemetry: Telemetry, sensors: AutopilotSensors, inspection: Inspection) -> None:
        self.sensors: Final = sensors
        self._telemetry, self._inspection = telemetry, inspection
        self._rung: tuple[object, object, object] = (None, None, None)
        self._on_state, self._on_pose, self._on_height, self._on_setup = Bell(), Bell(), Bell(), Bell()

    def ring_for_news(self) -> None:
        """Rings for what is new."""
        state, pose, height = self._rung
        telemetry = self._telemetry
        self._rung = (telemetry.state, telemetry.pose, telemetry.height)
        if telemetry.pose is not pose:
            self._on_pose.ring()
        if telemetry.height is not height:
            self._on_height.ring()
        if telemetry.state is not state:
            self._on_state.ring()
        if self._inspection.events():
            self._on_setup.ring()

    def t_s_of_boot(self, boot_s: float) -> float | None:
        """Our time of a moment in the autopilot's own; None while nothing has been heard of it."""
        return self._telemetry.t_s_of_boot(boot_s)

    def state(self) -> AutopilotState:
        """Mode, arming, battery, as known now."""
        return self._telemetry.state

    def pose(self) -> Stamped | None:
        """The latest estimate; None before the first."""
        return self._telemetry.pose

    def height(self) -> StampedHeight | None:
        """The latest distance to the ground; None before the first."""
        return self._telemetry.height

    def fix(self) -> StampedFix | None:
        """What the satellite receiver said last; None before the first."""
        return self.sensors.satellites

    def wheels(self) -> StampedWheels | None:
        """How far the wheels have turned; None before the first."""
        return self.sensors.wheels

    def setup(self) -> AutopilotSetup:
        """Firmware, parameters that matter, and sensors' health, as known now."""
        return self._inspection.setup

    def on_setup(self, changed: Callable[[], None]) -> Unwatch:
        """Has `changed` called when the setup has changed, or was read anew."""
        return self._on_setup.listen(changed)

    def on_state(self, changed: Callable[[], None]) -> Unwatch:
        """Has `changed` called when the state has changed."""
        return self._on_state.listen(changed)

    def on_pose(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when a new estimate is there."""
        return self._on_pose.listen(ready)

    def on_height(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when a new distance is there."""
        return self._on_height.listen(ready)

    def on_fix(self, ready: Callable[[], None]) -> Unwatch:
        """Asks for satellite fixes, and has `ready` called when there is a new one."""
        self.sensors.want("satellites", FIX_HZ)
        return self.sensors.fix_bell.listen(ready)

    def on_wheels(self, ready: Callable[[], None]) -> Unwatch:
        """Asks for the encoders of the wheels, and has `ready` called when they have told."""
        self.sensors.want("wheels", WHEELS_HZ)
        return self.sensors.wheels_bell.listen(ready)
