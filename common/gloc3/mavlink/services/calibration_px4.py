"""Calibration of a PX4 vehicle: started by a command, reported in status texts that begin with `[cal]`."""

from __future__ import annotations

import re
from typing import Final

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
from gloc3.mavlink.services.statustext import StatusTextReceiver

_PARAMS: Final = {
    CalibrationKind.GYRO: (1.0,),
    CalibrationKind.MAGNETOMETER: (0.0, 1.0),
    CalibrationKind.ACCELEROMETER: (0.0, 0.0, 0.0, 0.0, 1.0),
    CalibrationKind.LEVEL: (0.0, 0.0, 0.0, 0.0, 2.0),
    CalibrationKind.ESC: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
}
_SIDES: Final = {
    "down": Side.LEVEL,
    "left": Side.LEFT,
    "right": Side.RIGHT,
    "front": Side.NOSE_DOWN,
    "back": Side.NOSE_UP,
    "up": Side.UPSIDE_DOWN,
}
"""PX4 names the side that points to the ground."""
_PREFIX: Final = "[cal] "
_PROGRESS: Final = re.compile(r"progress <(\d{1,3})>").search
_DETECTED: Final = re.compile(r"(\w+) orientation detected").match
_SIDE_DONE: Final = re.compile(r"(\w+) side (?:done|already completed)").match
_STILL: Final = {
    CalibrationKind.GYRO: "keep the vehicle still",
    CalibrationKind.LEVEL: "keep the vehicle still and level",
}


class Px4Calibration(Calibration):
    """See `Calibration`. The vehicle detects its own orientation, so nothing has to be confirmed."""

    handles = frozenset({"COMMAND_ACK", "STATUSTEXT"})

    def __init__(self, own: Address, target: Address, kind: CalibrationKind) -> None:
        super().__init__(own, target, kind)
        self._texts = StatusTextReceiver(own)

    def begin(self, now_s: float) -> None:
        """Asks the vehicle to begin."""
        self._send_command(PREFLIGHT_CALIBRATION, _PARAMS[self.state.kind], now_s)

    def cancel(self, now_s: float) -> None:
        """Asks the vehicle to stop: the same command with nothing in it."""
        if self.state.is_over:
            return
        if self._call is not None:
            self._quick.abandon(self._call)
            self._call = None
        self._quick.send_long(self._target, PREFLIGHT_CALIBRATION, now_s=now_s)
        self._end(CalibrationPhase.CANCELLED)

    def tick(self, now_s: float) -> None:
        """Repeats the command, or gives up."""
        self._texts.tick(now_s)
        self._read(now_s)
        super().tick(now_s)

    def _receive(self, message: MavlinkMessage, now_s: float) -> None:
        self._texts.receive(message, self._target, now_s)
        self._read(now_s)

    def _answered(self, result: CommandResult, *, was_in_progress: bool) -> None:
        if was_in_progress:
            self._end(CalibrationPhase.DONE)  # PX4 itself accepts at once and tells the end in a text
        elif self.state.phase is CalibrationPhase.ASKED:
            self._change(phase=CalibrationPhase.RUNNING, instruction=_STILL.get(self.state.kind, ""))

    def _read(self, now_s: float) -> None:
        for reported in self._texts.events():
            if reported.text.startswith(_PREFIX) and not self.state.is_over:
                self._received_s = now_s
                self._understand(reported.text.removeprefix(_PREFIX).strip())

    def _understand(self, text: str) -> None:
        self._note(text)
        if text.startswith("calibration started"):
            self._change(phase=CalibrationPhase.RUNNING, progress=0.0, instruction=_STILL.get(self.state.kind, ""))
        elif text.startswith("calibration done"):
            self._end(CalibrationPhase.DONE)
        elif text.startswith("calibration failed"):
            self._end(CalibrationPhase.FAILED, text.partition(":")[2].strip() or "the vehicle says no more than that")
        elif text.startswith("calibration cancelled"):
            self._end(CalibrationPhase.CANCELLED)
        elif found := _PROGRESS(text):
            self._change(phase=CalibrationPhase.RUNNING, progress=min(int(found[1]), 100) / 100.0)
        elif text.startswith("pending:"):
            self._wants([_SIDES[word] for word in text.removeprefix("pending:").split() if word in _SIDES])
        elif (found := _DETECTED(text)) and found[1] in _SIDES:
            self._set_side(_SIDES[found[1]], SideState.MEASURING)
            self._change(instruction=self._while_measuring())
        elif (found := _SIDE_DONE(text)) and found[1] in _SIDES:
            self._set_side(_SIDES[found[1]], SideState.DONE)
            self._change(instruction=self._next_side())
        else:
            self._change(instruction=text)

    def _wants(self, pending: list[Side]) -> None:
        known = [*self.state.sides, *(side for side in pending if side not in self.state.sides)]
        self._change(
            phase=CalibrationPhase.RUNNING,
            sides={side: SideState.PENDING if side in pending else SideState.DONE for side in known},
        )
        self._change(instruction=self._next_side())

    def _set_side(self, side: Side, state: SideState) -> None:
        self._change(sides={**self.state.sides, side: state})

    def _next_side(self) -> str:
        pending = [side.value for side, state in self.state.sides.items() if state is not SideState.DONE]
        return f"put the vehicle {' or '.join(pending)}, and hold it still" if pending else ""

    def _while_measuring(self) -> str:
        if self.state.kind is CalibrationKind.MAGNETOMETER:
            return "turn the vehicle slowly about the axis that points up, always the same side down"
        return "hold the vehicle still: this side is measured"


class Px4EscCalibration(Px4Calibration):
    """Full throttle until the battery is connected, then none; PX4 does not stop it once it has begun."""

    refusal_hint = "; the battery must be disconnected, and USB power the autopilot"

    def cancel(self, now_s: float) -> None:
        """Follows it no longer."""
        if not self.state.is_over:
            super().cancel(now_s)
            self._change(reason="PX4 goes on for up to 15 s; keep clear of the motors")
