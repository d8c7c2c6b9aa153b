"""Calibration as lines: what can be calibrated, and the running calibration with its instructions."""

from typing import Final

from gloc3_groundstation.desk.vehicle_desk import (
    LEAST_PULSE_US,
    MOST_PULSE_US,
    CalibrationKind,
    CalibrationPhase,
    CalibrationState,
    RadioChannel,
    SideState,
)
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, bar, wrapped

WHAT: Final = {
    CalibrationKind.GYRO: "keep the vehicle still on the ground",
    CalibrationKind.ACCELEROMETER: "lay the vehicle on each of its sides",
    CalibrationKind.MAGNETOMETER: "turn it about each axis, far from iron",
    CalibrationKind.LEVEL: "put the vehicle level, and keep it still",
    CalibrationKind.RADIO: "move the sticks of the transmitter",
    CalibrationKind.ESC: "PROPELLERS OFF; connect the battery when told",
}
ESC_WARNING: Final = (
    "The motors get full throttle although the vehicle is disarmed. Take the propellers off, and hold the vehicle down. "
    "ESCs with a digital protocol (DShot, DroneCAN) need no calibration."
)
TONES: Final = {
    CalibrationPhase.DONE: Tone.GOOD,
    CalibrationPhase.FAILED: Tone.BAD,
    CalibrationPhase.CANCELLED: Tone.WARN,
    CalibrationPhase.WAITING: Tone.WARN,
}
_SIDES: Final = {
    SideState.PENDING: ("·", Tone.DIM),
    SideState.MEASURING: ("▶", Tone.BUSY),
    SideState.DONE: ("✓", Tone.GOOD),
}


def kind_line(kind: CalibrationKind, state: CalibrationState | None) -> Line:
    """One sensor."""
    text = f"{state.phase}" if state is not None and state.kind is kind else ""
    tone = TONES.get(state.phase, Tone.BUSY) if state is not None else Tone.DIM
    return (Span(f" {kind:<15}", Tone.STRONG), Span(f"{text:<17}", tone), Span(WHAT[kind], Tone.DIM))


def calibration_lines(state: CalibrationState | None, width: int) -> list[Line]:
    """The calibration that runs, or the last one, in full."""
    if state is None:
        return [EMPTY, (Span(" enter starts; the vehicle must be disarmed.", Tone.DIM),)]
    lines: list[Line] = [
        (Span(f" {state.kind}: ", Tone.STRONG), Span(str(state.phase), TONES.get(state.phase, Tone.BUSY)))
    ]
    if state.progress is not None:
        lines.append((Span(f" {bar(state.progress, 30)} {state.progress * 100:3.0f} %", Tone.BUSY),))
    lines += [(Span(f" {row}", Tone.STRONG),) for row in wrapped(state.instruction, width - 2) if state.instruction]
    if state.phase is CalibrationPhase.WAITING:
        lines.append((Span(" y", Tone.KEY), Span(" done: go on")))
    if state.sides:
        lines.append(EMPTY)
        for side, progress in state.sides.items():
            sign, tone = _SIDES[progress]
            lines.append((Span(f" {sign} ", tone), Span(f"{side:<20}"), Span(str(progress), tone)))
    if state.channels:
        lines += [EMPTY, *(_channel_line(channel, width) for channel in state.channels)]
    reason_tone = Tone.GOOD if state.phase is CalibrationPhase.DONE else Tone.BAD
    lines += [(Span(f" {row}", reason_tone),) for row in wrapped(state.reason, width - 2) if state.reason]
    if state.texts:
        lines.append(EMPTY)
        lines += [(Span(f" {text}", Tone.DIM),) for text in state.texts[-8:]]
    return lines


def esc_warning(width: int) -> list[Line]:
    """What is asked before the ESCs are calibrated."""
    return [(Span(f" {text}", Tone.WARN),) for text in wrapped(ESC_WARNING, width - 2)]


def _channel_line(channel: RadioChannel, width: int) -> Line:
    """A channel: its ends as a bar from 800 to 2200 µs, with the stick as it is now."""
    cells = max(10, min(40, width - 46))

    def cell(pulse_us: int) -> int:
        share = (pulse_us - LEAST_PULSE_US) / (MOST_PULSE_US - LEAST_PULSE_US)
        return max(0, min(cells - 1, round(share * (cells - 1))))

    low, high, now = cell(channel.minimum_us), cell(channel.maximum_us), cell(channel.value_us)
    drawn = "".join("●" if at == now else "━" if low <= at <= high else "·" for at in range(cells))
    centre = "–" if channel.centre_us is None else str(channel.centre_us)
    numbers = f" {channel.minimum_us:4} {centre:>4} {channel.maximum_us:4} µs, now {channel.value_us:4}"
    return (
        Span(f" {channel.number:2} {channel.role:<9}", Tone.STRONG),
        Span("⇄ " if channel.is_reversed else "  ", Tone.WARN),
        Span(drawn, Tone.BUSY),
        Span(numbers),
    )
