"""Simulated calibration, which changes nothing: PX4's in `[cal]` texts, ArduPilot's accelerometer in position requests."""

from collections.abc import Callable
from enum import StrEnum
from typing import Final

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import MavlinkMessage
from gloc3.messages.envelope import Severity
from gloc3_sitl.autopilot.craft import Craft


class Subject(StrEnum):
    """Sensors that are calibrated, in PX4's words."""

    GYRO = "gyro"
    MAGNETOMETER = "mag"
    ACCELEROMETER = "accel"
    LEVEL = "level"
    ESC = "esc"


TURNED: Final = frozenset({Subject.MAGNETOMETER, Subject.ACCELEROMETER})
"""Calibrations that require the vehicle on each of its sides, which the simulation cannot do."""

_STEP_S: Final = 0.3
_STEPS: Final = 5
_CONNECT_S, _ESC_S = 6.0, 8.0
"""So long PX4 waits for the battery, and so long it drives the ESCs after that: 3 s with full throttle, 5 s with none."""
TIMEOUT_S: Final = 30.0
"""So long a vehicle waits to be turned."""


class CalibrationRun:
    """The calibration in progress, if any.

    Args:
        craft: the vehicle; its motors stay still while the ESCs are calibrated.
        has_battery: whether a battery is connected. The simulation has no plug: an empty battery counts as none.
    """

    def __init__(self, craft: Craft, has_battery: Callable[[], bool]) -> None:
        self._craft: Final = craft
        self._has_battery = has_battery
        self._subject: Subject | None = None
        self._begin_s = 0.0
        self._step = 0

    @property
    def is_busy(self) -> bool:
        """Whether a calibration is under way."""
        return self._subject is not None

    def begin(self, subject: Subject) -> None:
        """Starts a calibration; `tick` continues it."""
        self._subject, self._begin_s, self._step = subject, self._craft.now_s, 0
        self._send_text(f"calibration started: 2 {subject}")
        if subject is Subject.ESC:
            self._send_text("Connect battery now")
        if subject in TURNED:
            self._send_text("pending: back front left right up down")
            self._send_text("hold vehicle still on a pending side")

    def begin_escs(self) -> bool:
        """Starts that of the ESCs; false, with a text, while a battery is connected."""
        if self._has_battery():
            self._fail("Disconnect battery and try again")
            return False
        self.begin(Subject.ESC)
        return True

    def cancel(self) -> None:
        """Cancels the calibration under way."""
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
        elif subject is Subject.ESC:
            self._drive_escs(now_s)
        elif subject in TURNED:
            self._wait(subject, now_s)
        elif now_s - self._begin_s >= (self._step + 1) * _STEP_S:
            self._step += 1
            self._send_text(f"progress <{100 * self._step // _STEPS}>")
            if self._step == _STEPS:
                self._subject = None
                self._send_text(f"calibration done: {subject}")

    def _drive_escs(self, now_s: float) -> None:
        """Goes on when the battery is connected, or after a time without it, as PX4 does."""
        waited_s = now_s - self._begin_s
        if self._step == 0 and (self._has_battery() or waited_s >= _CONNECT_S):
            self._step, self._begin_s = 1, now_s
            self._send_text("Battery connected")
        elif self._step == 1 and waited_s >= _ESC_S:
            self._subject = None
            self._send_text("calibration done: esc")

    def _wait(self, subject: Subject, now_s: float) -> None:
        """Measures the present side; the other sides never come."""
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


VEHICLE_POSITION: Final = 42429
"""MAV_CMD_ACCELCAL_VEHICLE_POS: the autopilot requests a position, and the station confirms it."""
_POSITIONS: Final = ("level", "on its LEFT side", "on its RIGHT side", "nose DOWN", "nose UP", "on its BACK")
"""Numbered from 1, as ACCELCAL_VEHICLE_POS."""
_FAILED: Final = 16777216
_REQUEST_S: Final = 1.0
_SAMPLES_S: Final = 1.0


class AccelerometerPositions:
    """ArduPilot's calibration on six sides: it requests a position every second until a station confirms it.

    The simulated vehicle cannot be turned: when all six are confirmed, the calibration fails.
    """

    def __init__(self, craft: Craft) -> None:
        self._craft: Final = craft
        self._position = 0
        self._request_s = 0.0

    def begin(self) -> None:
        """Begins with the first position."""
        self._position, self._request_s = 1, self._craft.now_s
        self._send_text()

    def confirm(self, position: float) -> bool:
        """The vehicle lies as requested; false where another position is requested, or none."""
        if position != self._position or not 0 < position <= len(_POSITIONS):
            return False
        self._position += 1
        self._request_s = self._craft.now_s + _SAMPLES_S
        if self._position <= len(_POSITIONS):
            self._send_text()
        return True

    def tick(self, now_s: float) -> list[MavlinkMessage]:
        """Returns the request that is due."""
        if not self._position or now_s < self._request_s:
            return []
        self._request_s = now_s + _REQUEST_S
        wanted = self._position
        if wanted > len(_POSITIONS):
            self._position, wanted = 0, _FAILED
            self._craft.send_text(Severity.CRITICAL, "Calibration FAILED: the sides do not differ")
        return [message("COMMAND_LONG", command=VEHICLE_POSITION, param1=float(wanted))]

    def _send_text(self) -> None:
        self._craft.send_text(Severity.CRITICAL, f"Place vehicle {_POSITIONS[self._position - 1]} and confirm.")
