"""Calibration as seen by a station: its states, and the base of both firmwares' procedures.

PX4 reports the progress in status texts that begin with `[cal]`, ArduPilot in its own messages and commands; each has a
file. A repeated command restarts the calibration on some firmware, so it is not sent again where the vehicle answers
only at the end.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from enum import StrEnum
from typing import ClassVar, Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice, earliest
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient

PREFLIGHT_CALIBRATION: Final = 241
SILENT_S: Final = 90.0
"""Silence after which a calibration counts as ended, s: the vehicle itself gives up earlier."""
PATIENT_S: Final = 40.0
"""How long a vehicle may take to answer which answers only at the end."""
MOST_TEXTS: Final = 40


class CalibrationKind(StrEnum):
    """What can be calibrated."""

    GYRO = "gyro"
    ACCELEROMETER = "accelerometer"
    MAGNETOMETER = "magnetometer"
    LEVEL = "level"
    RADIO = "radio"
    """The channels of the transmitter (RC)."""
    ESC = "ESC"
    """The throttle range of the electronic speed controllers."""


class Side(StrEnum):
    """Orientations of the vehicle; the text ends the sentence "put the vehicle ..."."""

    LEVEL = "level"
    LEFT = "on its left side"
    RIGHT = "on its right side"
    NOSE_DOWN = "nose down"
    NOSE_UP = "nose up"
    UPSIDE_DOWN = "upside down"


class SideState(StrEnum):
    """Progress of one side."""

    PENDING = "pending"
    MEASURING = "measuring"
    DONE = "done"


class CalibrationPhase(StrEnum):
    """Phases of a calibration."""

    ASKED = "asked"
    RUNNING = "running"
    WAITING = "waiting for you"
    """The vehicle measures when the operator has confirmed the instruction."""
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


LEAST_PULSE_US, MOST_PULSE_US = 800, 2200
"""Pulses of a transmitter outside of these are none, µs."""


class RadioChannel(msgspec.Struct, frozen=True):
    """A channel of the transmitter while it is calibrated; pulses in µs."""

    number: int
    """From 1."""
    value_us: int
    minimum_us: int
    maximum_us: int
    centre_us: int | None = None
    """None until it is measured."""
    role: str = ""
    """The stick that moves it, as "throttle"; empty where none is known to."""
    is_reversed: bool = False


class CalibrationState(msgspec.Struct, frozen=True, kw_only=True):
    """A calibration at one moment."""

    kind: CalibrationKind
    phase: CalibrationPhase = CalibrationPhase.ASKED
    progress: float | None = None
    """From 0 to 1; None while the vehicle reports none."""
    instruction: str = ""
    """What a person has to do now."""
    sides: Mapping[Side, SideState] = {}
    """Sides that the vehicle requests; empty where it requests none."""
    reason: str = ""
    """Why it failed, or which steps remain."""
    texts: tuple[str, ...] = ()
    """The last texts that the vehicle has sent meanwhile."""
    channels: tuple[RadioChannel, ...] = ()
    """Those that the receiver delivers, while the transmitter is calibrated."""

    @property
    def is_over(self) -> bool:
        """Whether nothing more will happen."""
        return self.phase in (CalibrationPhase.DONE, CalibrationPhase.FAILED, CalibrationPhase.CANCELLED)


class Calibration(Microservice[CalibrationState]):
    """One calibration of one vehicle; each change of its state is an event.

    Args:
        own: address of this end.
        target: the autopilot.
        kind: what is calibrated.
    """

    silent_s: ClassVar[float] = SILENT_S
    """Silence after which it has failed, s."""
    silence: ClassVar[str] = f"no message from it for {SILENT_S:.0f} s; its last message may have been lost"
    """The reason then."""
    refusal_hint: ClassVar[str] = ""
    """What may be the reason where the vehicle refuses to begin."""

    def __init__(self, own: Address, target: Address, kind: CalibrationKind) -> None:
        super().__init__(own)
        self.state = CalibrationState(kind=kind)
        self.is_refused = False
        """Whether the vehicle has refused to begin."""
        self._target = target
        self._quick = MavCommandClient(own)
        self._is_waiting = MavCommandClient(own, retry_s=PATIENT_S, attempts=1)
        self._call: CommandCall | None = None
        self._received_s = 0.0

    @abstractmethod
    def begin(self, now_s: float) -> None:
        """Asks the vehicle to begin."""

    @abstractmethod
    def cancel(self, now_s: float) -> None:
        """Asks the vehicle to stop."""

    def confirm(self, now_s: float) -> None:
        """Tells the vehicle that it lies as it wants to.

        Raises:
            Refused: it does not wait for that.
        """
        del now_s
        raise Refused("the vehicle does not wait for a confirmation")

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles an acknowledgement or a progress report."""
        if sender.system != self._target.system:
            return
        if message.name == "COMMAND_ACK":
            for client in (self._quick, self._is_waiting):
                client.receive(message, sender, now_s)
            self._poll(now_s)
        elif sender == self._target and not self.state.is_over:
            self._receive(message, now_s)

    def tick(self, now_s: float) -> None:
        """Repeats the command, or gives up."""
        for client in (self._quick, self._is_waiting):
            client.tick(now_s)
        self._poll(now_s)
        if not self.state.is_over and now_s >= self._received_s + self.silent_s:
            self._end(CalibrationPhase.FAILED, self.silence)

    def next_tick_s(self) -> float | None:
        """When one of these is due."""
        silent_s = None if self.state.is_over else self._received_s + self.silent_s
        return earliest(self._quick.next_tick_s(), self._is_waiting.next_tick_s(), silent_s)

    def outgoing(self) -> list[MavlinkMessage]:
        """What is to be sent; asking empties it."""
        return [*self._quick.outgoing(), *self._is_waiting.outgoing(), *super().outgoing()]

    @abstractmethod
    def _receive(self, message: MavlinkMessage, now_s: float) -> None:
        """Handles the autopilot's progress messages."""

    @abstractmethod
    def _answered(self, result: CommandResult, *, was_in_progress: bool) -> None:
        """Handles the acceptance of the start command; whether that completes it depends on the firmware."""

    def _send_command(self, command: int, params: tuple[float, ...], now_s: float, *, is_patient: bool = False) -> None:
        """Sends the start command."""
        self._received_s = now_s
        client = self._is_waiting if is_patient else self._quick
        self._call = client.send_long(self._target, command, params, now_s=now_s)

    def _poll(self, now_s: float) -> None:
        """Sees what became of the command that began it."""
        for client in (self._quick, self._is_waiting):
            client.events()
        call = self._call
        if call is None or self.state.is_over:
            return
        if call.is_in_progress and call.result is None:
            self._received_s = now_s
            self._change(
                phase=CalibrationPhase.RUNNING, progress=None if call.progress is None else call.progress / 100.0
            )
        elif call.result is not None:
            self._call = None
            self._received_s = now_s
            if call.result is CommandResult.ACCEPTED:
                self._answered(call.result, was_in_progress=call.is_in_progress)
            else:
                self.is_refused = True
                self._end(CalibrationPhase.FAILED, f"the vehicle's answer: {call.result.words}{self.refusal_hint}")

    def _note(self, text: str) -> None:
        self._change(texts=(*self.state.texts, text)[-MOST_TEXTS:])

    def _end(self, phase: CalibrationPhase, reason: str = "") -> None:
        is_done = phase is CalibrationPhase.DONE
        self._change(phase=phase, reason=reason, instruction="", progress=1.0 if is_done else self.state.progress)

    def _change(self, **changes: object) -> None:
        changed = msgspec.structs.replace(self.state, **changes)
        if changed != self.state:
            self.state = changed
            self._events.append(changed)
