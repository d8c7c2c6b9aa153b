"""Calibration as lines: the sensors, and the running calibration with its instructions."""

from typing import Final

from gloc3_groundstation.desk.vehicle_desk import CalibrationKind, CalibrationPhase, CalibrationState, SideState
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, bar, wrapped

WHAT: Final = {
    CalibrationKind.GYRO: "keep the vehicle still on the ground",
    CalibrationKind.ACCELEROMETER: "lay the vehicle on each of its sides",
    CalibrationKind.MAGNETOMETER: "turn it about each axis, far from iron",
    CalibrationKind.LEVEL: "put the vehicle level, and keep it still",
}
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
        lines.append((Span(" y", Tone.KEY), Span(" in position: measure")))
    if state.sides:
        lines.append(EMPTY)
        for side, progress in state.sides.items():
            sign, tone = _SIDES[progress]
            lines.append((Span(f" {sign} ", tone), Span(f"{side:<20}"), Span(str(progress), tone)))
    lines += [(Span(f" {row}", Tone.BAD),) for row in wrapped(state.reason, width - 2) if state.reason]
    if state.texts:
        lines.append(EMPTY)
        lines += [(Span(f" {text}", Tone.DIM),) for text in state.texts[-8:]]
    return lines
