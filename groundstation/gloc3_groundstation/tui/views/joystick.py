"""A joystick as lines: its axes and pressed buttons live, what they do, and the step of its mapping."""

from typing import Final, NamedTuple

from gloc3_groundstation.joysticks.device import JoystickReading
from gloc3_groundstation.joysticks.mapping import JoystickMapping
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, wrapped

WIDTH: Final = 58
MOST_AXES: Final = 10
"""Axes that are shown."""


class JoystickView(NamedTuple):
    """One joystick."""

    name: str
    """Empty without one."""
    is_own: bool
    """Its mapping is the operator's."""
    connected: int
    """Of all connected joysticks."""
    reading: JoystickReading
    mapping: JoystickMapping | None
    step: str = ""
    """What is asked for; empty while it is not mapped."""
    place: tuple[int, int] = (0, 0)
    """Number of the step, and of all."""
    problem: str = ""


def bar(position: float) -> str:
    """A position from -1 to 1, ten signs to each side."""
    filled = min(10, round(abs(position) * 10.0))
    left, right = ("", "█" * filled) if position > 0.0 else ("█" * filled, "")
    return f"{left:>10}│{right:<10}"


def joystick_lines(view: JoystickView) -> tuple[Line, ...]:
    """The joystick, the step, axes, buttons and demands."""
    if not view.name:
        return (
            (Span("no joystick is connected: plug one in", Tone.STRONG),),
            *_wrapped(view.problem, Tone.WARN),
        )
    mapping = view.mapping
    kind = "mapped here" if view.is_own else "default mapping" if mapping is not None else "not mapped: n maps it"
    others = f" ({view.connected} joysticks)" if view.connected > 1 else ""
    rows: list[Line] = [(Span(f"{view.name[:WIDTH]}", Tone.STRONG),), (Span(f"{kind}{others}", Tone.DIM),), EMPTY]
    if view.step:
        number = f"{view.place[0]}/{view.place[1]}  " if view.place[0] else ""
        rows += [*_wrapped(f"{number}{view.step}", Tone.BUSY), EMPTY]
    rows += _axis_rows(view)
    pressed = " ".join(str(button) for button in sorted(view.reading.pressed)) or "none"
    held = "" if mapping is None else ", ".join(sorted(mapping.pressed(view.reading))).replace("_", " ")
    rows.append((Span(f"pressed  {pressed}", Tone.TEXT), Span(f"   {held}" if held else "", Tone.GOOD)))
    return (*rows, *_wrapped(view.problem, Tone.WARN))


def _axis_rows(view: JoystickView) -> list[Line]:
    mapping = view.mapping
    moved = {} if mapping is None else {row.axis: name for name, row in mapping.axes.items()}
    rows: list[Line] = []
    for axis, position in enumerate(view.reading.axes[:MOST_AXES]):
        name = moved.get(axis)
        demand = f"{mapping.axes[name].demand(position) * 100.0:>+5.0f}% {name}" if mapping is not None and name else ""
        tone = Tone.TEXT if abs(position) > 0.1 else Tone.DIM
        rows.append((Span(f"axis {axis:<3}{bar(position)} {position:>+5.2f}", tone), Span(f"  {demand}", Tone.GOOD)))
    return rows


def _wrapped(text: str, tone: Tone) -> tuple[Line, ...]:
    return tuple((Span(line, tone),) for line in wrapped(text, WIDTH)) if text else ()
