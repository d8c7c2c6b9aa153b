"""Calibration of an ArduPilot vehicle: gyro and level end with the answer, the others are guided step by step."""

from __future__ import annotations

import math
from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.calibration import (
    PREFLIGHT_CALIBRATION,
    Calibration,
    CalibrationKind,
    CalibrationPhase,
    Side,
    SideState,
)
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall

ACCELEROMETER_POSITION: Final = 42429
START_MAGNETOMETER: Final = 42424
CANCEL_MAGNETOMETER: Final = 42426
_SUCCESS, _FAILED = 16_777_215, 16_777_216
_POSITIONS: Final = {
    1: Side.LEVEL,
    2: Side.LEFT,
    3: Side.RIGHT,
    4: Side.NOSE_DOWN,
    5: Side.NOSE_UP,
    6: Side.UPSIDE_DOWN,
}
_MAGNETOMETER_DONE: Final = 4
_MAGNETOMETER_WORDS: Final = {
    5: "failed: the measurements do not lie on a sphere",
    6: "failed: its mounting does not match its orientation parameter",
    7: "failed: the field is too strong or too weak; is metal nearby?",
}


class ArduPilotCalibration(Calibration):
    """See `Calibration`."""

    handles = frozenset({"COMMAND_ACK", "COMMAND_LONG", "STATUSTEXT", "MAG_CAL_PROGRESS", "MAG_CAL_REPORT"})

    def __init__(self, own: Address, target: Address, kind: CalibrationKind) -> None:
        super().__init__(own, target, kind)
        self._position = 0
        self._confirmed = 0
        self._confirmation: CommandCall | None = None
        self._percent: dict[int, int] = {}
        self._reports: dict[int, int] = {}
        self._mask = 0

    def begin(self, now_s: float) -> None:
        """Asks the vehicle to begin."""
        match self.state.kind:
            case CalibrationKind.GYRO:
                self._send_command(PREFLIGHT_CALIBRATION, (1.0,), now_s, is_patient=True)
                self._change(instruction="keep the vehicle still")
            case CalibrationKind.LEVEL:
                self._send_command(PREFLIGHT_CALIBRATION, (0.0, 0.0, 0.0, 0.0, 2.0), now_s, is_patient=True)
                self._change(instruction="keep the vehicle still and level")
            case CalibrationKind.ACCELEROMETER:
                self._send_command(PREFLIGHT_CALIBRATION, (0.0, 0.0, 0.0, 0.0, 1.0), now_s)
            case CalibrationKind.MAGNETOMETER:
                self._send_command(
                    START_MAGNETOMETER, (0.0, 0.0, 1.0), now_s
                )  # all of them, no retry, saved at the end

    def cancel(self, now_s: float) -> None:
        """Asks the vehicle to stop, where it can."""
        if self.state.is_over:
            return
        if self._call is not None:
            for client in (self._quick, self._is_waiting):
                client.abandon(self._call)
            self._call = None
        reason = ""
        if self.state.kind is CalibrationKind.MAGNETOMETER:
            self._quick.send_long(self._target, CANCEL_MAGNETOMETER, now_s=now_s)
        elif self.state.kind is CalibrationKind.ACCELEROMETER:
            reason = "the vehicle goes on waiting for a position; begin again, or restart it before the flight"
        self._end(CalibrationPhase.CANCELLED, reason)

    def confirm(self, now_s: float) -> None:
        """Tells the vehicle that it lies as it wants to.

        Raises:
            Refused: it does not wait for that.
        """
        if self.state.phase is not CalibrationPhase.WAITING:
            raise Refused("the vehicle does not wait for a confirmation")
        if self._confirmation is not None:
            self._quick.abandon(self._confirmation)  # the vehicle has gone on, so it has heard that
        position = (float(self._position),)
        self._confirmation = self._quick.send_long(self._target, ACCELEROMETER_POSITION, position, now_s=now_s)
        self._received_s, self._confirmed = now_s, self._position
        side = _POSITIONS[self._position]
        self._change(
            phase=CalibrationPhase.RUNNING,
            instruction="hold the vehicle still: this side is measured",
            sides={**self.state.sides, side: SideState.MEASURING},
        )

    def _answered(self, result: CommandResult, *, was_in_progress: bool) -> None:
        if self.state.kind in (CalibrationKind.GYRO, CalibrationKind.LEVEL):
            self._end(CalibrationPhase.DONE)
        elif self.state.phase is CalibrationPhase.ASKED:
            is_magnetometer = self.state.kind is CalibrationKind.MAGNETOMETER
            text = "turn the vehicle slowly about all its axes, each side down once" if is_magnetometer else ""
            self._change(phase=CalibrationPhase.RUNNING, progress=0.0, instruction=text)

    def _receive(self, message: MavlinkMessage, now_s: float) -> None:
        match message.name:
            case "STATUSTEXT":
                self._note(message.text)
            case "COMMAND_LONG":
                is_ours = self._is_for_us(message) and message.command == ACCELEROMETER_POSITION
                if is_ours and self.state.kind is CalibrationKind.ACCELEROMETER:
                    self._received_s = now_s
                    self._wants(message.param1)
            case _ if self.state.kind is CalibrationKind.MAGNETOMETER:
                self._received_s = now_s
                self._mask |= message.cal_mask
                if message.name == "MAG_CAL_PROGRESS":
                    self._percent[message.compass_id] = min(message.completion_pct, 100)
                    self._change(
                        phase=CalibrationPhase.RUNNING, progress=sum(self._percent.values()) / 100 / len(self._percent)
                    )
                else:
                    self._reports[message.compass_id] = message.cal_status
                    self._judge()

    def _wants(self, reported: float) -> None:
        """Handles a requested position, which the vehicle repeats until it is confirmed, or the end."""
        position = int(reported) if math.isfinite(reported) else 0
        if position == _SUCCESS:
            self._end(CalibrationPhase.DONE)
        elif position == _FAILED:
            self._end(
                CalibrationPhase.FAILED, self.state.texts[-1] if self.state.texts else "the vehicle does not say why"
            )
        elif position in _POSITIONS and position not in (self._position, self._confirmed):
            self._position = position
            order = list(_POSITIONS.values())
            current = order.index(_POSITIONS[position])
            self._change(
                phase=CalibrationPhase.WAITING,
                progress=current / len(order),
                instruction=f"put the vehicle {_POSITIONS[position]}, hold it still, and confirm",
                sides={side: SideState.DONE if order.index(side) < current else SideState.PENDING for side in order},
            )

    def _judge(self) -> None:
        """Ends when every magnetometer has reported."""
        if any(self._mask >> number & 1 and number not in self._reports for number in range(8)):
            return
        bad = {number: status for number, status in self._reports.items() if status != _MAGNETOMETER_DONE}
        if not bad:
            self._end(CalibrationPhase.DONE, "restart the vehicle before the next flight")
            return
        words = [f"magnetometer {n + 1} {_MAGNETOMETER_WORDS.get(s, 'failed')}" for n, s in sorted(bad.items())]
        self._end(CalibrationPhase.FAILED, "; ".join(words))
