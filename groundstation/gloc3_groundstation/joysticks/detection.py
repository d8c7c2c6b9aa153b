"""Detects a mapping while an operator moves one stick and presses one button after the other."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final, NamedTuple

from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading
from gloc3_groundstation.joysticks.mapping import (
    DEAD_ZONE,
    PRESSED_BEYOND,
    AxisMapping,
    JoystickButton,
    JoystickMapping,
    StickAxis,
)

REST_S: Final = 1.5
"""Time without any change before the first step, and in which the noise of the sticks is measured, s."""
MOVED: Final = 0.4
"""Deflection from which a stick counts as moved."""
BACK: Final = 0.15
"""Deflection below which it counts as released."""
STAYS_S: Final = 1.2
"""Time after which a deflected stick counts as one without a spring, s."""
STILL: Final = 0.03
"""Largest change of a stick that stays, and of one at rest."""
NOISE_MARGIN: Final = 2.0
MOST_DEAD_ZONE: Final = 0.3


class DetectionAxis(NamedTuple):
    """A direction of the vehicle."""

    axis: StickAxis
    is_positive: bool


DetectionTarget = DetectionAxis | JoystickButton | None
"""What a step is for; None for the sticks at rest."""


class StepKind(StrEnum):
    """What the operator does in a step."""

    REST = "rest"
    MOVE = "move"
    PRESS = "press"


class DetectionStep(NamedTuple):
    """One request to the operator."""

    text: str
    target: DetectionTarget

    @property
    def kind(self) -> StepKind:
        """What is to be done."""
        if self.target is None:
            return StepKind.REST
        return StepKind.MOVE if isinstance(self.target, DetectionAxis) else StepKind.PRESS


def _both(axis: StickAxis, one: str, other: str) -> tuple[DetectionStep, DetectionStep]:
    return (
        DetectionStep(f"move the stick that shall move it {one}, all the way, and let go", DetectionAxis(axis, True)),
        DetectionStep(f"now the same stick the other way: {other}", DetectionAxis(axis, False)),
    )


STEPS: Final = (
    DetectionStep("let go of everything; a stick without a spring: to its middle", None),
    *_both(StickAxis.SURGE, "FORWARD", "BACK"),
    *_both(StickAxis.SWAY, "RIGHT", "LEFT"),
    *_both(StickAxis.HEAVE, "UP", "DOWN"),
    *_both(StickAxis.YAW, "round CLOCKWISE", "ANTICLOCKWISE"),
    DetectionStep("press and release the DEAD-MAN'S KEY: a button or trigger", JoystickButton.DEAD_MAN),
    DetectionStep("press and release the button for HOLD", JoystickButton.HOLD),
    DetectionStep("press and release the button for ARM", JoystickButton.ARM),
    DetectionStep("press and release the button for DISARM", JoystickButton.DISARM),
    DetectionStep("press and release the button for the next MODE", JoystickButton.MODE),
    DetectionStep("press and release the button for BRIGHTER LIGHTS", JoystickButton.LIGHTS_UP),
    DetectionStep("press and release the button for DARKER LIGHTS", JoystickButton.LIGHTS_DOWN),
    DetectionStep("press and release the button for MORE GAIN", JoystickButton.GAIN_UP),
    DetectionStep("press and release the button for LESS GAIN", JoystickButton.GAIN_DOWN),
)
"""In the order in which they are asked for."""


class Detection:
    """One detection of one device; told readings and the time.

    Args:
        device: the joystick.
    """

    def __init__(self, device: JoystickDevice) -> None:
        self.problem = ""
        """Why what was done does not count; empty where it does."""
        self._device = device
        self._number = 0
        self._rest: tuple[float, ...] = ()
        self._noise: tuple[float, ...] = ()
        self._low: tuple[float, ...] = ()
        self._high: tuple[float, ...] = ()
        self._rest_pressed: frozenset[int] = frozenset()
        self._since_s: float | None = None
        self._extreme: tuple[int, float] | None = None
        """Axis and farthest position in this step."""
        self._still: tuple[float, float] = (0.0, 0.0)
        """Last position of that axis, and since when it is there."""
        self._input = ""
        """What is pressed in this step, until it is released."""
        self._ends: dict[StickAxis, tuple[int, float]] = {}
        self._axes: dict[StickAxis, AxisMapping] = {}
        self._buttons: dict[JoystickButton, tuple[str, ...]] = {}

    @property
    def step(self) -> DetectionStep | None:
        """What is asked for now; None when all is done."""
        return STEPS[self._number] if self._number < len(STEPS) else None

    @property
    def mapping(self) -> JoystickMapping:
        """What was detected so far."""
        axes: Mapping[StickAxis, AxisMapping] = dict(self._axes)
        return JoystickMapping(name=self._device.name, axes=axes, buttons=dict(self._buttons))

    def skip(self) -> None:
        """Goes on without what is asked for; an axis without both its ends is not mapped."""
        step = self.step
        if step is not None and step.target is not None:
            is_first = isinstance(step.target, DetectionAxis) and step.target.is_positive
            self._next(2 if is_first else 1)

    def take(self, reading: JoystickReading, now_s: float) -> None:
        """Handles a reading."""
        step = self.step
        if step is None:
            return
        match step.kind:
            case StepKind.REST:
                self._take_rest(reading, now_s)
            case StepKind.MOVE:
                assert isinstance(step.target, DetectionAxis)
                self._take_move(step.target, reading, now_s)
            case StepKind.PRESS:
                assert isinstance(step.target, JoystickButton)
                self._take_press(step.target, reading)

    def _next(self, steps: int = 1) -> None:
        self._number += steps
        self._extreme, self._input, self.problem = None, "", ""

    def _take_rest(self, reading: JoystickReading, now_s: float) -> None:
        axes = reading.axes
        is_new = self._since_s is None or len(axes) != len(self._low) or reading.pressed != self._rest_pressed
        if is_new or any(high - low > BACK for low, high in zip(self._low, self._high, strict=True)):
            self._since_s, self._low, self._high, self._rest_pressed = now_s, axes, axes, reading.pressed
        self._low = tuple(map(min, self._low, axes))
        self._high = tuple(map(max, self._high, axes))
        assert self._since_s is not None
        if now_s - self._since_s >= REST_S:
            self._rest = tuple((low + high) / 2.0 for low, high in zip(self._low, self._high, strict=True))
            self._noise = tuple((high - low) / 2.0 for low, high in zip(self._low, self._high, strict=True))
            self._next()

    def _away(self, reading: JoystickReading) -> list[float]:
        """How far each axis is from rest."""
        return [here - rest for here, rest in zip(reading.axes, self._rest, strict=False)]

    def _take_move(self, target: DetectionAxis, reading: JoystickReading, now_s: float) -> None:
        away = self._away(reading)
        if self._extreme is None:
            axis = max(range(len(away)), key=lambda one: abs(away[one]), default=-1)
            if axis < 0 or abs(away[axis]) < MOVED or not self._is_free(target, axis, away[axis]):
                return
            self._extreme, self._still = (axis, reading.axes[axis]), (reading.axes[axis], now_s)
            return
        axis, farthest = self._extreme
        here = reading.axes[axis]
        if abs(here - self._rest[axis]) > abs(farthest - self._rest[axis]):
            self._extreme = (axis, here)
        if abs(here - self._still[0]) > STILL:
            self._still = (here, now_s)
        if abs(away[axis]) < BACK or now_s - self._still[1] >= STAYS_S:
            self._keep_end(target, *self._extreme)

    def _is_free(self, target: DetectionAxis, axis: int, away: float) -> bool:
        """Whether an axis may be the one that is asked for; otherwise it is said why not."""
        taken = {row.axis: name for name, row in self._axes.items()}
        if axis in taken:
            self.problem = f"that stick moves {taken[axis]} already"
            return False
        if target.is_positive:
            return True
        own, end = self._ends[target.axis]
        if axis != own:
            self.problem = "that is another stick"
            return False
        if (end - self._rest[own]) * away > 0.0:
            # One without a spring is still at its other end.
            return False
        self.problem = ""
        return True

    def _keep_end(self, target: DetectionAxis, axis: int, position: float) -> None:
        if target.is_positive:
            self._ends[target.axis] = axis, position
        else:
            _, high = self._ends[target.axis]
            centre = max(-1.0, min(1.0, self._rest[axis]))
            span = min(abs(high - centre), abs(position - centre))
            dead_zone = min(MOST_DEAD_ZONE, max(DEAD_ZONE, NOISE_MARGIN * self._noise[axis] / span))
            self._axes[target.axis] = AxisMapping(
                axis=axis, low=position, centre=centre, high=high, dead_zone=round(dead_zone, 3)
            )
        self._next()

    def _take_press(self, target: JoystickButton, reading: JoystickReading) -> None:
        pressed = sorted(reading.pressed - self._rest_pressed)
        sticks = {row.axis for row in self._axes.values()}
        triggers = [
            f"axis {axis}{'+' if away > 0.0 else '-'}"
            for axis, away in enumerate(self._away(reading))
            if axis not in sticks and abs(away) > MOVED and reading.axes[axis] * away > PRESSED_BEYOND * abs(away)
        ]
        now = f"button {pressed[0]}" if pressed else triggers[0] if triggers else ""
        if now:
            taken = next((name for name, inputs in self._buttons.items() if now in inputs), None)
            self.problem = f"that is {taken.replace('_', ' ')} already" if taken is not None else ""
            self._input = "" if taken is not None else now
        elif self._input:
            self._buttons[target] = (self._input,)
            self._next()
