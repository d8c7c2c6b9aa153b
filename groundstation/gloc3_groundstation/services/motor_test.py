"""Motor test on the ground: one motor, weak and short; PX4's ACTUATOR_TEST and ArduPilot's DO_MOTOR_TEST."""

from math import nan
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3_groundstation.services.actions import ActionService
from gloc3_groundstation.services.machines import Machines
from gloc3_groundstation.services.progress import OnProgress, Quietly
from gloc3_groundstation.services.snapshot import Firmware, ServicesSnapshot, SnapshotService

MOST_PERCENT: Final = 50.0
MOST_S: Final = 3.0
"""Longest test; PX4 ends each one then."""
MOST_MOTORS: Final = 12
_ACTUATOR_TEST, _DO_MOTOR_TEST = 310, 209
_STEP_S: Final = 0.2
_MOTORS: Final = {2: 4, 3: 2, 13: 6, 14: 8, 15: 3, 29: 12, 35: 10}
"""Motors by MAV_TYPE."""
_REASONS: Final = {
    Firmware.PX4: "COM_MOT_TEST_EN must be 1, the safety button pressed, and the motor assigned to an output",
    Firmware.ARDUPILOT: "the vehicle must be landed, the RC calibrated and the safety switch pressed",
}


class MotorTestSettings(msgspec.Struct, frozen=True, kw_only=True):
    """How a motor is tested."""

    percent: float = 10.0
    """Of full throttle."""
    seconds: float = 2.0

    def check(self) -> None:
        """Checks the bounds.

        Raises:
            Refused: it is too strong or too long.
        """
        if not 0.0 < self.percent <= MOST_PERCENT:
            raise Refused(f"a motor is tested with more than 0 and at most {MOST_PERCENT:g} %, not {self.percent:g} %")
        if not 0.0 < self.seconds <= MOST_S:
            raise Refused(f"a motor is tested for more than 0 and at most {MOST_S:g} s, not {self.seconds:g} s")


DEFAULT: Final = MotorTestSettings()


def motor_count(snapshot: ServicesSnapshot) -> int:
    """Motors of a vehicle by its type; as many as there may be where the type does not say."""
    return _MOTORS.get(snapshot.vehicle_type, MOST_MOTORS)


class MotorTestService:
    """Tests motors of a disarmed vehicle on the ground.

    Args:
        machines: run the client.
        commands: sends the commands.
        snapshot: of the vehicle.
        target: its autopilot.
        actions: has the autopilot's own reasons for a refusal.
    """

    def __init__(
        self,
        machines: Machines,
        commands: MavCommandClient,
        snapshot: SnapshotService,
        target: Address,
        actions: ActionService,
    ) -> None:
        self._machines, self._commands, self._snapshot, self._target = machines, commands, snapshot, target
        self._actions = actions
        self._call: CommandCall | None = None

    async def run(
        self, motor: int, settings: MotorTestSettings = DEFAULT, on_progress: OnProgress | None = None
    ) -> None:
        """Turns one motor, and returns after the time; cancelling the task stops it.

        Args:
            motor: from 1; PX4 counts its motors, ArduPilot the places of its test order (1 is A, front right).
            settings: throttle and time.
            on_progress: called with the progress.

        Raises:
            Refused: the vehicle is armed, in the air or of an unknown firmware, or refuses.
        """
        settings.check()
        if not 1 <= motor <= MOST_MOTORS:
            raise Refused(f"a motor has a number from 1 to {MOST_MOTORS}, not {motor}")
        snapshot = await self._snapshot.learn(self._machines)
        self._check(snapshot)
        if snapshot.firmware not in _REASONS:
            raise Refused("the motor test of this firmware is not supported")
        report, is_over = Quietly(on_progress), False
        try:
            await self._send(motor, settings)
            begin_s = self._machines.now_s
            while (passed_s := self._machines.now_s - begin_s) < settings.seconds:
                what = f"motor {motor} turns with {settings.percent:g} %"
                report(what, passed_s / settings.seconds, f"{passed_s:.1f} of {settings.seconds:g} s")
                await self._pass(min(_STEP_S, settings.seconds - passed_s))
            is_over = True
        finally:
            if not is_over:  # also where no answer came: it may turn
                self.stop(motor)

    def stop(self, motor: int) -> None:
        """Stops a motor at once; the command is repeated until the vehicle has answered."""
        if self._call is not None:
            self._commands.abandon(self._call)
        self._call = self._begin(motor, percent=0.0, seconds=0.0)
        self._machines.settle()

    def _check(self, snapshot: ServicesSnapshot) -> None:
        if snapshot.is_armed:
            raise Refused("the vehicle is armed; motors are tested disarmed, on the ground, with the propellers off")
        if snapshot.is_in_air:
            raise Refused("the vehicle is in the air; motors are tested on the ground, with the propellers off")

    def _begin(self, motor: int, percent: float, seconds: float) -> CommandCall:
        now_s = self._machines.now_s
        if self._snapshot.snapshot.firmware is Firmware.PX4:
            value = percent / 100.0 if seconds else nan
            params = (value, seconds, 0.0, 0.0, float(motor))
            return self._commands.send_long(self._target, _ACTUATOR_TEST, params, now_s=now_s)
        params = (float(motor), 0.0, percent, seconds, 1.0)
        return self._commands.send_long(self._target, _DO_MOTOR_TEST, params, now_s=now_s)

    async def _send(self, motor: int, settings: MotorTestSettings) -> None:
        if self._call is not None:
            self._commands.abandon(self._call)
        begin_s = self._machines.now_s
        call = self._call = self._begin(motor, settings.percent, settings.seconds)
        await self._machines.until(lambda: call.result is not None)
        self._call = None
        if call.result is not CommandResult.ACCEPTED:
            words = "no answer" if call.result is None else call.result.words
            refusal = f"motor {motor}: {words}; {_REASONS[self._snapshot.snapshot.firmware]}"
            raise Refused(await self._actions.explained(refusal, begin_s))

    async def _pass(self, seconds: float) -> None:
        ends_s = self._machines.now_s + seconds
        timer = self._machines.loop.call_at(ends_s, self._machines.settle)
        try:
            await self._machines.until(lambda: self._machines.now_s >= ends_s)
        finally:
            timer.cancel()
