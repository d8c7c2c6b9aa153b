"""Calibration as PX4 reports it, in status texts that begin with `[cal]`; it changes nothing."""

from enum import StrEnum
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3_sitl.autopilot.craft import Craft


class Subject(StrEnum):
    """What is calibrated, in PX4's words."""

    GYRO = "gyro"
    MAGNETOMETER = "mag"
    ACCELEROMETER = "accel"
    LEVEL = "level"


TURNED: Final = frozenset({Subject.MAGNETOMETER, Subject.ACCELEROMETER})
"""Those for which somebody has to lay the vehicle on each of its sides, which nobody can here."""

_STEP_S: Final = 0.3
_STEPS: Final = 5
TIMEOUT_S: Final = 30.0
"""So long a vehicle waits to be turned."""


class CalibrationRun:
    """The calibration in progress, if any."""

    def __init__(self, craft: Craft) -> None:
        self._craft: Final = craft
        self._subject: Subject | None = None
        self._begin_s = 0.0
        self._step = 0

    @property
    def is_busy(self) -> bool:
        """Whether one is under way."""
        return self._subject is not None

    def begin(self, subject: Subject) -> None:
        """Begins one; `tick` goes on with it."""
        self._subject, self._begin_s, self._step = subject, self._craft.now_s, 0
        self._send_text(f"calibration started: 2 {subject}")
        if subject in TURNED:
            self._send_text("pending: back front left right up down")
            self._send_text("hold vehicle still on a pending side")

    def cancel(self) -> None:
        """Ends the one that is under way."""
        if self._subject is not None:
            self._subject = None
            self._send_text("calibration cancelled")

    def tick(self, now_s: float) -> None:
        """Reports its progress and its result."""
        subject = self._subject
        if subject is None:
            return
        if self._craft.is_armed:
            self._fail("armed")
        elif subject in TURNED:
            self._wait(subject, now_s)
        elif now_s - self._begin_s >= (self._step + 1) * _STEP_S:
            self._step += 1
            self._send_text(f"progress <{100 * self._step // _STEPS}>")
            if self._step == _STEPS:
                self._subject = None
                self._send_text(f"calibration done: {subject}")

    def _wait(self, subject: Subject, now_s: float) -> None:
        """The side on which it stands is measured; the others nobody brings down."""
        waited_s = now_s - self._begin_s
        if self._step == 0 and waited_s >= _STEP_S:
            self._step = 1
            self._send_text("down orientation detected")
        elif self._step == 1 and subject is Subject.ACCELEROMETER and waited_s >= _STEPS * _STEP_S:
            self._step = 2  # the compass wants to be turned about even on this side
            self._send_text("down side done, rotate to a different side")
            self._send_text("progress <17>")
        elif waited_s >= TIMEOUT_S:
            self._fail("timeout: no motion")

    def _fail(self, reason: str) -> None:
        self._subject = None
        self._send_text(f"calibration failed: {reason}")

    def _send_text(self, text: str) -> None:
        self._craft.send_text(Severity.INFO, f"[cal] {text}")
