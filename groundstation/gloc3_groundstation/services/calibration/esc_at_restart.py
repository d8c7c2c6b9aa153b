"""ArduPilot's calibration of the ESCs: a parameter that has it done at the next start, and what the operator does then.

With ESC_CALIBRATION = 3, ArduCopter gives full throttle for 5 s at its start and then none until it is started again; it
clears the parameter, and does nothing where the RC is not calibrated (ArduCopter/esc_calibration.cpp).
"""

import asyncio
from collections.abc import Callable
from typing import Final

import msgspec

from gloc3.errors import Gloc3Error, Refused
from gloc3.mavlink.services.calibration import CalibrationKind, CalibrationPhase, CalibrationState
from gloc3_groundstation.services.parameters import ParameterService

NAME: Final = "ESC_CALIBRATION"
_OFF, _AT_START, _DISABLED = 0.0, 3.0, 9.0
INSTRUCTION: Final = (
    "disconnect battery and USB. Connect the battery: the motors get full throttle for 5 s, then none, and the ESCs beep; "
    "press the safety switch first if there is one. Disconnect the battery, connect everything as usual, then confirm"
)


class EscAtRestart:
    """One calibration of the ESCs of one vehicle.

    Args:
        parameters: of the vehicle.
        on_state: called with each new state.
    """

    def __init__(self, parameters: ParameterService, on_state: Callable[[CalibrationState], None]) -> None:
        self.state = CalibrationState(kind=CalibrationKind.ESC)
        self._parameters, self._on_state = parameters, on_state
        self._answers: asyncio.Queue[bool] = asyncio.Queue()
        self._undoing: asyncio.Task[None] | None = None

    async def run(self) -> None:
        """Sets the parameter, and returns when the vehicle has been started again.

        Raises:
            Refused: the vehicle has no such calibration, or does not answer.
        """
        try:
            before = await self._parameters.read(NAME)
        except Refused as error:
            raise Refused(
                f"{error}; ArduCopter alone has {NAME} (QuadPlanes: Q_ESC_CAL, as their documents say)"
            ) from None
        if before.value == _DISABLED:
            raise Refused(f"{NAME} is 9, which disables the calibration; set it to 0 first")
        try:
            await self._parameters.set(NAME, _AT_START)
            self._change(phase=CalibrationPhase.WAITING, instruction=INSTRUCTION)
            while await self._answers.get():
                if not (problem := await self._problem()):
                    reason = f"the vehicle was started again, and has cleared {NAME}"
                    self._change(phase=CalibrationPhase.DONE, instruction="", reason=reason)
                    return
                self._change(instruction=f"{problem}: {INSTRUCTION}")
            await self._undo()
        except asyncio.CancelledError:
            self._undoing = asyncio.get_running_loop().create_task(self._undo())
            raise

    def confirm(self, now_s: float) -> None:
        """The vehicle was started twice, as instructed.

        Raises:
            Refused: nothing waits for that.
        """
        del now_s
        if self.state.phase is not CalibrationPhase.WAITING:
            raise Refused("the calibration does not wait for a confirmation")
        self._answers.put_nowait(True)

    def cancel(self, now_s: float) -> None:
        """Takes the parameter back."""
        del now_s
        self._answers.put_nowait(False)

    async def _problem(self) -> str:
        """Why it is not done yet; empty if it is."""
        try:
            value = (await self._parameters.read(NAME)).value
        except Refused as error:
            return str(error)
        return "" if value == _OFF else f"{NAME} is still {value:g}, so the vehicle has not been started again"

    async def _undo(self) -> None:
        try:
            await self._parameters.set(NAME, _OFF)
        except Gloc3Error as error:
            reason = f"{error}. Set {NAME} to 0: otherwise the motors turn at the next start"
        else:
            reason = f"{NAME} is 0 again"
        self._change(phase=CalibrationPhase.CANCELLED, instruction="", reason=reason)

    def _change(self, **changes: object) -> None:
        self.state = msgspec.structs.replace(self.state, **changes)
        self._on_state(self.state)
