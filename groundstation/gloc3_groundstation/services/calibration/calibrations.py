"""Calibration of a vehicle: start, follow step by step, confirm and cancel.

It uses our own state machines, not MAVSDK's. MAVSDK supports only PX4 (all else is UNSUPPORTED), its `cancel()` blocks
forever when the vehicle acknowledges late, and it waits forever for a vehicle that goes silent (measured with 4.1).
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.services.calibration import Calibration, CalibrationKind, CalibrationState
from gloc3.mavlink.services.calibration_ardupilot import ArduPilotCalibration
from gloc3.mavlink.services.calibration_px4 import Px4Calibration, Px4EscCalibration
from gloc3_groundstation.services.actions import ActionService
from gloc3_groundstation.services.calibration.esc_at_restart import EscAtRestart
from gloc3_groundstation.services.calibration.radio_calibration import RadioCalibration, StickRole
from gloc3_groundstation.services.machines import Machines, Wire
from gloc3_groundstation.services.parameters import ParameterService, WriteReport
from gloc3_groundstation.services.snapshot import Firmware, ServicesSnapshot, SnapshotService

LAST_LINES_S: Final = 2.0
"""Longest time for sending the end of a calibration to the vehicle."""
_BACKWARDS: Final = frozenset({10, 11, 12})
"""MAV_TYPE of rovers, boats and submarines: their throttle rests in the centre."""
_STEERED: Final = frozenset({10, 11})
"""ArduPilot's rovers and boats have two sticks, roll and throttle."""
_ARDUPILOT_ROLES: Final = {StickRole.ROLL: 1, StickRole.PITCH: 2, StickRole.THROTTLE: 3, StickRole.YAW: 4}
"""Where the vehicle does not say otherwise."""

OnState = Callable[[CalibrationState], None]


class CalibrationService:
    """Calibrates, one thing at a time on a vehicle.

    Args:
        wire: the link to the vehicle.
        machines: run the other services.
        snapshot: of the vehicle.
        parameters: of the vehicle; some calibrations end in them.
        actions: has the autopilot's own reasons for a refusal.
    """

    def __init__(
        self,
        wire: Wire,
        machines: Machines,
        snapshot: SnapshotService,
        parameters: ParameterService,
        actions: ActionService,
    ) -> None:
        self._wire = wire
        self._machines = machines
        self._snapshot = snapshot
        self._parameters = parameters
        self._actions = actions
        self._running: Calibration | EscAtRestart | None = None
        self._own: Machines | None = None

    @property
    def state(self) -> CalibrationState | None:
        """The calibration that runs; None without one."""
        return None if self._running is None else self._running.state

    async def run(self, kind: CalibrationKind, on_state: OnState | None = None) -> CalibrationState:
        """Calibrates, and returns at the end; cancelling the task cancels it on the vehicle.

        Args:
            kind: what is calibrated. The propellers must be off before the ESCs are.
            on_state: called with each new state: instruction and progress.

        Returns:
            The last state: done, failed with the reason, or cancelled.

        Raises:
            Refused: it cannot start: the vehicle is armed, in the air, of an unknown firmware, or is being calibrated.
        """
        if self._running is not None:
            raise Refused(f"the {self._running.state.kind} is being calibrated")
        snapshot = await self._snapshot.learn(self._machines)
        self._check(snapshot, kind)
        if kind is CalibrationKind.ESC and snapshot.firmware is Firmware.ARDUPILOT:
            return await self._run_at_restart(on_state or _ignore)
        return await self._run_machine(await self._machine(kind, snapshot), on_state or _ignore)

    async def _run_machine(self, running: Calibration, on_state: OnState) -> CalibrationState:
        self._running = running
        own = self._own = Machines(self._wire, self._snapshot.snapshot.address.system, [running])
        own.on_event(on_state)
        begin_s = own.now_s
        try:
            running.begin(own.now_s)
            if isinstance(running, RadioCalibration):
                await own.until(lambda: running.state.is_over or bool(running.changes))
                if running.changes:
                    running.finish(await self._write(running))
                    own.settle()
            else:
                await own.until(lambda: running.state.is_over)
            if running.is_refused:
                reason = await self._actions.explained(running.state.reason, begin_s)
                running.state = msgspec.structs.replace(running.state, reason=reason)
                on_state(running.state)
        finally:
            if not running.state.is_over:
                running.cancel(own.now_s)
                own.settle()
            own.loop.call_later(LAST_LINES_S, own.close)
            self._running = self._own = None
        return running.state

    async def _run_at_restart(self, on_state: OnState) -> CalibrationState:
        running = self._running = EscAtRestart(self._parameters, on_state)
        try:
            await running.run()
        finally:
            self._running = None
        return running.state

    def confirm(self) -> None:
        """The vehicle lies, or the sticks are, as the instruction says.

        Raises:
            Refused: nothing waits for that.
        """
        if self._running is None:
            raise Refused("nothing is being calibrated")
        self._running.confirm(self._machines.now_s)
        self._settle()

    def cancel(self) -> None:
        """Stops the calibration that runs, if any; `run` comes back with the state *cancelled*."""
        if self._running is not None:
            self._running.cancel(self._machines.now_s)
            self._settle()

    def close(self) -> None:
        """Abandons a running calibration; the vehicle is not notified."""
        if self._own is not None:
            self._own.close()

    def _settle(self) -> None:
        if self._own is not None:
            self._own.settle()

    def _check(self, snapshot: ServicesSnapshot, kind: CalibrationKind) -> None:
        if snapshot.is_armed:
            raise Refused("the vehicle is armed; it is calibrated on the ground, disarmed")
        if snapshot.is_in_air and kind is CalibrationKind.ESC:
            raise Refused("the vehicle is in the air; ESCs are calibrated on the ground, with the propellers off")
        if snapshot.firmware is Firmware.OTHER:
            raise Refused("calibration of this firmware is not supported")

    async def _machine(self, kind: CalibrationKind, snapshot: ServicesSnapshot) -> Calibration:
        own, target, is_px4 = self._wire.own, snapshot.address, snapshot.firmware is Firmware.PX4
        if kind is CalibrationKind.RADIO:
            return RadioCalibration(
                own,
                target,
                is_px4=is_px4,
                roles={} if is_px4 else await self._roles(snapshot),
                is_throttle_centred=snapshot.vehicle_type in _BACKWARDS,
            )
        if kind is CalibrationKind.ESC:
            return Px4EscCalibration(own, target, kind)
        return Px4Calibration(own, target, kind) if is_px4 else ArduPilotCalibration(own, target, kind)

    async def _roles(self, snapshot: ServicesSnapshot) -> Mapping[StickRole, int]:
        """Channels of an ArduPilot vehicle's sticks."""
        roles = dict(_ARDUPILOT_ROLES)
        if snapshot.vehicle_type in _STEERED:
            roles = {role: roles[role] for role in (StickRole.ROLL, StickRole.THROTTLE)}
        for role in roles:
            with suppress(Refused):  # older than the parameter, or not answered: it is where it usually is
                roles[role] = int((await self._parameters.read(f"RCMAP_{role.name}")).value)
        return roles

    async def _write(self, running: RadioCalibration) -> WriteReport:
        """Writes the parameters, which the vehicle must have."""
        lacking = dict[str, str]()
        for change in running.changes:
            if change.name not in self._parameters.table.rows:
                try:
                    await self._parameters.read(change.name)
                except Refused as error:
                    lacking[change.name] = str(error)
        if lacking:
            return WriteReport(refused=lacking)
        return await self._parameters.write(running.changes)


def _ignore(state: CalibrationState) -> None:
    del state
