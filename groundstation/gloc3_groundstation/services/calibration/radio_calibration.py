"""Calibration of the transmitter: sticks are found and measured on RC_CHANNELS, and become parameters.

PX4 is told to ignore the transmitter meanwhile, so that no stick arms it. Parameters as QGroundControl writes them: the
throttle's centre is its lowest pulse, which PX4 1.13 and later take for the middle, unless the stick is reversed.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

import msgspec

from gloc3.cli.counting import counted
from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.calibration import (
    LEAST_PULSE_US,
    MOST_PULSE_US,
    PREFLIGHT_CALIBRATION,
    Calibration,
    CalibrationKind,
    CalibrationPhase,
    RadioChannel,
)
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall
from gloc3.mavlink.services.heartbeat import ARMED
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL
from gloc3_groundstation.services.parameter_table import ParameterChange
from gloc3_groundstation.services.parameters import WriteReport

RC_CHANNELS: Final = 65
MOST_CHANNELS: Final = 16
MOVED_US: Final = 300
"""A channel that moves less is left as it is, and a stick that is deflected less is not recognized."""
LEAST_RANGE_US: Final = 600
"""Of a stick, from end to end."""
HELD_S: Final = 0.5
"""So long a stick is held before it is recognized."""
CENTRE_SHARE, BOTTOM_SHARE = 0.3, 0.15
"""Of a stick's range: so far from the middle, or from its end, it does not count as centred, or as down."""
INTERVAL_US: Final = 100_000.0


class StickRole(StrEnum):
    """What a stick commands, in the order in which they are asked for."""

    THROTTLE = "throttle"
    YAW = "yaw"
    ROLL = "roll"
    PITCH = "pitch"


_MOVES: Final = {
    StickRole.THROTTLE: "move the throttle stick fully up, and hold it there",
    StickRole.YAW: "move the yaw stick fully to the right, and hold it there",
    StickRole.ROLL: "move the roll stick fully to the right, and hold it there",
    StickRole.PITCH: "move the pitch stick fully forward, and hold it there",
}


class _Step(StrEnum):
    """What is measured; the order is that of the steps."""

    REST = "rest"
    STICKS = "sticks"
    ENDS = "ends"
    CENTRE = "centre"
    REVIEW = "review"
    WRITING = "writing"


_ORDER: Final = list(_Step)


class RadioCalibration(Calibration):
    """See `Calibration`; when it is confirmed, `changes` are to be written, and then reported to `finish`.

    Args:
        own: address of this end.
        target: the autopilot.
        is_px4: PX4's parameters, with the assignment of the sticks; else ArduPilot's.
        roles: channels of the sticks, where they are known; without, the operator shows each.
        is_throttle_centred: whether the throttle rests in the centre (rovers, boats), not down.
    """

    handles = frozenset({"COMMAND_ACK", "HEARTBEAT", "RC_CHANNELS"})
    silent_s = 5.0
    silence = (
        "no receiver is heard: no pulses in RC_CHANNELS for 5 s. Switch the transmitter on, and check that the receiver "
        "is bound and connected"
    )

    def __init__(
        self,
        own: Address,
        target: Address,
        *,
        is_px4: bool,
        roles: Mapping[StickRole, int],
        is_throttle_centred: bool,
    ) -> None:
        super().__init__(own, target, CalibrationKind.RADIO)
        self.changes: tuple[ParameterChange, ...] = ()
        self._is_px4, self._is_throttle_centred = is_px4, is_throttle_centred
        self._roles = {number: role for role, number in roles.items()}
        self._wanted = [] if roles else list(StickRole)
        self._step = _Step.ENDS if roles else _Step.REST
        self._channels: dict[int, RadioChannel] = {}
        self._rest: dict[int, int] = {}
        self._candidate, self._since_s, self._now_s = 0, 0.0, 0.0
        self._rate: CommandCall | None = None

    def begin(self, now_s: float) -> None:
        """Requests the pulses, and has PX4 ignore the transmitter."""
        self._now_s = self._received_s = now_s
        self._rate = self._quick.send_long(self._target, SET_MESSAGE_INTERVAL, (RC_CHANNELS, INTERVAL_US), now_s=now_s)
        if self._is_px4:
            self._send_command(PREFLIGHT_CALIBRATION, (0.0, 0.0, 0.0, 1.0), now_s)
        self._change(instruction="switch the transmitter on")

    def cancel(self, now_s: float) -> None:
        """Leaves the parameters as they are."""
        self._now_s = now_s
        if not self.state.is_over:
            self._end(CalibrationPhase.CANCELLED)

    def confirm(self, now_s: float) -> None:
        """The sticks are as instructed.

        Raises:
            Refused: nothing waits for that.
        """
        self._now_s = now_s
        if self.state.phase is not CalibrationPhase.WAITING:
            raise Refused("the calibration does not wait for a confirmation")
        problem = ""
        match self._step:
            case _Step.REST:
                self._rest = {number: one.value_us for number, one in self._channels.items()}
            case _Step.ENDS:
                problem = self._range_problem()
            case _Step.CENTRE:
                for number, one in self._channels.items():
                    middle_us = (one.minimum_us + one.maximum_us) // 2
                    centre_us = one.value_us if number in self._roles else middle_us
                    self._channels[number] = msgspec.structs.replace(one, centre_us=centre_us)
                problem = self._centre_problem()
            case _:
                self.changes = self._parameters()
        if not problem:
            self._step = _ORDER[_ORDER.index(self._step) + 1]
        self._show(problem)

    def finish(self, report: WriteReport) -> None:
        """Ends it with what has become of the parameters."""
        self.changes = ()
        count = counted(len(report.written), "parameter")
        if report.refused:
            reasons = "; ".join(report.refused.values())
            self._end(CalibrationPhase.FAILED, f"{count} written; not all of them: {reasons}")
        else:
            self._end(CalibrationPhase.DONE, f"{count} written and read back")

    def tick(self, now_s: float) -> None:
        """Repeats the commands, or gives up."""
        self._now_s = now_s
        super().tick(now_s)

    def _answered(self, result: CommandResult, *, was_in_progress: bool) -> None:
        """PX4 ignores the transmitter now; the pulses are waited for."""

    def _receive(self, message: MavlinkMessage, now_s: float) -> None:
        self._now_s = now_s
        if message.name == "HEARTBEAT":
            if message.base_mode & ARMED:
                self._end(CalibrationPhase.FAILED, "the vehicle was armed meanwhile; nothing was written")
            return
        pulses = {number: getattr(message, f"chan{number}_raw") for number in range(1, MOST_CHANNELS + 1)}
        pulses = {number: pulse for number, pulse in pulses.items() if LEAST_PULSE_US <= pulse <= MOST_PULSE_US}
        if not pulses or message.rssi == 0:
            return
        self._received_s = now_s
        for number, pulse in pulses.items():
            one = self._channels.get(number)
            if one is None:
                one = RadioChannel(number, pulse, pulse, pulse, role=str(self._roles.get(number, "")))
            self._channels[number] = msgspec.structs.replace(
                one,
                value_us=pulse,
                minimum_us=min(one.minimum_us, pulse),
                maximum_us=max(one.maximum_us, pulse),
            )
        if self._step is _Step.STICKS:
            self._find(now_s)
        if self.state.channels:
            self._change(channels=self._shown)
        else:
            self._show()

    @property
    def _shown(self) -> tuple[RadioChannel, ...]:
        return tuple(one for _, one in sorted(self._channels.items()))

    def _find(self, now_s: float) -> None:
        """Takes the channel that has moved most, and stays so, for the stick that is asked for."""
        moved = {
            number: abs(one.value_us - self._rest.get(number, one.value_us))
            for number, one in self._channels.items()
            if number not in self._roles
        }
        number = max(moved, key=moved.__getitem__, default=0)
        if not number or moved[number] < MOVED_US:
            self._candidate = 0
        elif number != self._candidate:
            self._candidate, self._since_s = number, now_s
        elif now_s - self._since_s >= HELD_S:
            role, one = self._wanted.pop(0), self._channels[number]
            self._roles[number], self._candidate = role, 0
            self._channels[number] = msgspec.structs.replace(
                one, role=str(role), is_reversed=one.value_us < self._rest[number]
            )
            if not self._wanted:
                self._step = _Step.ENDS
            self._show()

    def _show(self, problem: str = "") -> None:
        throttle = "in its centre" if self._is_throttle_centred else "down"
        match self._step:
            case _Step.REST:
                text = f"centre the sticks, the throttle {throttle}; then confirm"
            case _Step.STICKS:
                text = _MOVES[self._wanted[0]]
            case _Step.ENDS:
                text = "move all sticks, knobs and switches to their ends and back, until nothing changes; then confirm"
            case _Step.CENTRE:
                text = f"centre the sticks, the throttle {throttle}; then confirm"
            case _Step.REVIEW:
                text = f"confirm to write {counted(len(self._parameters()), 'parameter')}; esc leaves them as they are"
            case _Step.WRITING:
                text = "the parameters are written"
        is_led = self._step in (_Step.STICKS, _Step.WRITING)
        self._change(
            phase=CalibrationPhase.RUNNING if is_led else CalibrationPhase.WAITING,
            instruction=f"{problem}: {text}" if problem else text,
            progress=_ORDER.index(self._step) / len(_ORDER),
            channels=self._shown,
        )

    def _range_problem(self) -> str:
        for number, role in sorted(self._roles.items()):
            one = self._channels.get(number)
            range_us = 0 if one is None else one.maximum_us - one.minimum_us
            if range_us < LEAST_RANGE_US:
                return f"{role} (channel {number}) has moved by {range_us} µs only, of {LEAST_RANGE_US} µs at least"
        return ""

    def _centre_problem(self) -> str:
        for number, role in sorted(self._roles.items()):
            one = self._channels[number]
            share = (one.value_us - one.minimum_us) / (one.maximum_us - one.minimum_us)
            if role is StickRole.THROTTLE and not self._is_throttle_centred:
                bottom = (1.0,) if one.is_reversed else (0.0,) if self._is_px4 else (0.0, 1.0)
                if min(abs(share - end) for end in bottom) > BOTTOM_SHARE:
                    return f"the throttle is not down ({one.value_us} µs)"
            elif abs(share - 0.5) > CENTRE_SHARE:
                return f"{role} is not centred ({one.value_us} µs, from {one.minimum_us} to {one.maximum_us} µs)"
        return ""

    def _parameters(self) -> tuple[ParameterChange, ...]:
        found = list[ParameterChange]()
        for one in self._shown:
            if one.maximum_us - one.minimum_us < MOVED_US or one.centre_us is None:
                continue
            name = f"RC{one.number}"
            found += [
                ParameterChange(f"{name}_MIN", one.minimum_us),
                ParameterChange(f"{name}_MAX", one.maximum_us),
                ParameterChange(f"{name}_TRIM", self._trim_us(one)),
            ]
            if self._is_px4 and one.role:
                found.append(ParameterChange(f"{name}_REV", -1.0 if one.is_reversed else 1.0))
        if self._is_px4:
            found += [ParameterChange(f"RC_MAP_{role.name}", number) for number, role in sorted(self._roles.items())]
            found.append(ParameterChange("RC_CHAN_CNT", max(self._channels)))
        return tuple(found)

    def _trim_us(self, one: RadioChannel) -> int:
        assert one.centre_us is not None
        if one.role != StickRole.THROTTLE or self._is_throttle_centred:
            return one.centre_us
        middle_us = (one.minimum_us + one.maximum_us) // 2
        if self._is_px4:
            return middle_us if one.is_reversed else one.minimum_us
        return one.minimum_us if one.centre_us < middle_us else one.maximum_us

    def _end(self, phase: CalibrationPhase, reason: str = "") -> None:
        """Ends it; the vehicle takes the transmitter again, and sends its pulses as usual."""
        if not self.state.is_over:
            for call in (self._call, self._rate):
                if call is not None:
                    self._quick.abandon(call)
            self._call = self._rate = None
            if self._is_px4:
                self._quick.send_long(self._target, PREFLIGHT_CALIBRATION, now_s=self._now_s)
            self._quick.send_long(self._target, SET_MESSAGE_INTERVAL, (RC_CHANNELS, 0.0), now_s=self._now_s)
        super()._end(phase, reason)
