"""Detection of a mapping, pure: sticks with and without springs, noise, triggers, what was assigned already."""

import pytest

from gloc3_groundstation.joysticks.detection import REST_S, STAYS_S, STEPS, Detection, StepKind
from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading, StickDemand
from gloc3_groundstation.joysticks.mapping import JoystickButton, StickAxis

RELEASED = (0.0, 0.0, -1.0, 0.0, 0.0, -1.0)
"""Like an Xbox pad: two sticks and two triggers."""


class Operator:
    """Does what is asked for, in virtual time."""

    def __init__(self, rest: tuple[float, ...] = RELEASED) -> None:
        self.detection = Detection(JoystickDevice(key="pad", name="Pad"))
        self.axes = list(rest)
        self.now_s = 0.0

    def wait(self, seconds: float, *pressed: int) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.detection.take(JoystickReading(tuple(self.axes), frozenset(pressed)), self.now_s)
            self.now_s += 0.05

    def push(self, axis: int, *, to: float) -> None:
        """Pushes a stick in two steps and lets go."""
        before = self.axes[axis]
        for position in (before + (to - before) * 0.6, to, before):
            self.axes[axis] = position
            self.wait(0.1)

    def press(self, button: int) -> None:
        self.wait(0.1, button)
        self.wait(0.1)

    def rest(self) -> None:
        self.wait(REST_S + 0.1)

    @property
    def asked(self) -> str:
        step = self.detection.step
        return "" if step is None else step.text

    def all_sticks(self) -> None:
        self.rest()
        for axis, sign in ((4, -1.0), (3, 1.0), (1, -1.0), (0, 1.0)):
            self.push(axis, to=sign)
            self.push(axis, to=-sign)


def test_a_pad_is_mapped_by_doing_what_is_asked_for() -> None:
    at = Operator()
    at.all_sticks()
    assert "DEAD-MAN" in at.asked
    at.axes[5] = 1.0
    at.wait(0.2)
    at.axes[5] = -1.0
    at.wait(0.2)
    for number, _ in enumerate(STEPS[10:]):
        at.press(number)
    assert at.detection.step is None
    mapping = at.detection.mapping
    assert not mapping.problem
    assert mapping.buttons[JoystickButton.DEAD_MAN] == ("axis 5+",)
    assert mapping.buttons[JoystickButton.HOLD] == ("button 0",)
    assert mapping.sticks(JoystickReading((1.0, -1.0, -1.0, -1.0, -1.0, -1.0))) == StickDemand(1.0, -1.0, 1.0, 1.0)


def test_the_range_of_a_worn_stick_is_its_own_and_its_noise_widens_the_dead_zone() -> None:
    at = Operator((0.1, 0.0))
    for wobble in (0.05, -0.05) * 12:
        at.axes[0] = 0.1 + wobble
        at.wait(0.05)
    at.wait(REST_S)
    at.axes[0] = 0.1
    at.push(0, to=0.8)
    at.push(0, to=-0.7)
    axis = at.detection.mapping.axes[StickAxis.SURGE]
    assert (axis.low, axis.centre, axis.high) == pytest.approx((-0.7, 0.1, 0.8))
    assert axis.dead_zone == pytest.approx(2.0 * 0.05 / 0.7, abs=0.002)


def test_a_stick_without_a_spring_counts_when_it_stays_at_its_end() -> None:
    at = Operator((0.0,))
    at.rest()
    at.axes[0] = 0.9
    at.wait(STAYS_S + 0.2)
    assert "the other way" in at.asked
    at.wait(STAYS_S + 0.2)
    assert "the other way" in at.asked, "it is still at its first end"
    at.axes[0] = -0.9
    at.wait(STAYS_S + 0.2)
    assert at.detection.mapping.axes[StickAxis.SURGE].low == -0.9


def test_another_stick_or_one_that_is_assigned_is_told_and_not_taken() -> None:
    at = Operator()
    at.rest()
    at.push(4, to=-1.0)
    at.push(3, to=1.0)
    assert at.detection.problem == "that is another stick"
    at.push(4, to=1.0)
    at.push(4, to=1.0)
    assert at.detection.problem == "that stick moves surge already"
    assert "RIGHT" in at.asked


def test_steps_can_be_skipped_and_without_a_dead_mans_key_it_is_no_mapping() -> None:
    at = Operator()
    at.detection.skip()
    assert "let go" in at.asked, "rest is not skipped"
    at.rest()
    at.detection.skip()
    assert "RIGHT" in at.asked, "both ends of an axis are skipped"
    at.push(3, to=1.0)
    at.detection.skip()
    assert "UP" in at.asked
    while (step := at.detection.step) is not None and step.kind is not StepKind.PRESS:
        at.detection.skip()
    at.press(2)
    at.press(2)
    assert at.detection.problem == "that is dead man already"
    while at.detection.step is not None:
        at.detection.skip()
    assert at.detection.mapping.problem == "no axis is mapped"
    assert at.detection.mapping.buttons == {JoystickButton.DEAD_MAN: ("button 2",)}
