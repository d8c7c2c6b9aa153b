"""Calibration of a vehicle's sensors: start, follow step by step, confirm and cancel.

It uses our own state machine, not MAVSDK's. MAVSDK supports only PX4 (all else is UNSUPPORTED), its `cancel()` blocks
forever when the vehicle acknowledges late, and it waits forever for a vehicle that goes silent (measured with 4.1).
"""

from collections.abc import Callable
from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink.services.calibration import Calibration, CalibrationKind, CalibrationState
from gloc3.mavlink.services.calibration_ardupilot import ArduPilotCalibration
from gloc3.mavlink.services.calibration_px4 import Px4Calibration
from gloc3_groundstation.services.machines import Machines, Wire
from gloc3_groundstation.services.snapshot import Firmware, SnapshotService

LAST_LINES_S: Final = 2.0
"""Longest time for sending the cancellation of a calibration to the vehicle."""

OnState = Callable[[CalibrationState], None]


class CalibrationService:
    """Calibrates sensors, one at a time on a vehicle."""

    def __init__(self, wire: Wire, machines: Machines, snapshot: SnapshotService) -> None:
        self._wire = wire
        self._machines = machines
        self._snapshot = snapshot
        self._running: Calibration | None = None
        self._own: Machines | None = None

    @property
    def state(self) -> CalibrationState | None:
        """The calibration that runs; None without one."""
        return None if self._running is None else self._running.state

    async def run(self, kind: CalibrationKind, on_state: OnState | None = None) -> CalibrationState:
        """Calibrates, and returns at the end; cancelling the task cancels it on the vehicle.

        Args:
            kind: the sensor.
            on_state: called with each new state: instruction and progress.

        Returns:
            The last state: done, failed with the reason, or cancelled.

        Raises:
            Refused: it cannot start: the vehicle is armed, of an unknown firmware, or is being calibrated.
        """
        if self._running is not None:
            raise Refused(f"the {self._running.state.kind} is being calibrated")
        snapshot = await self._snapshot.learn(self._machines)
        if snapshot.is_armed:
            raise Refused("the vehicle is armed; sensors are calibrated on the ground, disarmed")
        machine = {Firmware.PX4: Px4Calibration, Firmware.ARDUPILOT: ArduPilotCalibration}.get(snapshot.firmware)
        if machine is None:
            raise Refused("calibration of this firmware is not supported")
        running = self._running = machine(self._wire.own, snapshot.address, kind)
        own = self._own = Machines(self._wire, snapshot.address.system, [running])
        if on_state is not None:
            own.on_event(on_state)
        try:
            running.begin(own.now_s)
            await own.until(lambda: running.state.is_over)
        finally:
            if not running.state.is_over:
                running.cancel(own.now_s)
                own.settle()
            own.loop.call_later(LAST_LINES_S, own.close)
            self._running = self._own = None
        return running.state

    def confirm(self) -> None:
        """The vehicle lies as the instruction says.

        Raises:
            Refused: nothing waits for that.
        """
        if self._running is None or self._own is None:
            raise Refused("nothing is being calibrated")
        self._running.confirm(self._own.now_s)
        self._own.settle()

    def cancel(self) -> None:
        """Stops the calibration that runs, if any; `run` comes back with the state *cancelled*."""
        if self._running is not None and self._own is not None:
            self._running.cancel(self._own.now_s)
            self._own.settle()

    def close(self) -> None:
        """Abandons a running calibration; the vehicle is not notified."""
        if self._own is not None:
            self._own.close()
