"""The dead-man's key of a joystick, in virtual time: pressed, released, unplugged, silent; and two joysticks at once."""

import asyncio
from collections.abc import Awaitable, Callable

from gloc3.clock import run_virtual
from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading, StickDemand
from gloc3_groundstation.joysticks.hand_on_joystick import SILENT_S, TO_MAP, HandOnJoystick
from gloc3_groundstation.joysticks.mapping import AxisMapping, JoystickButton, JoystickMapping, StickAxis

MAPPING = JoystickMapping(
    axes={StickAxis.SURGE: AxisMapping(axis=0, dead_zone=0.0)},
    buttons={JoystickButton.DEAD_MAN: ("button 4",), JoystickButton.HOLD: ("button 1",)},
)
DEVICE = JoystickDevice(key="stick", name="Stick")
AHEAD, PRESSED = JoystickReading((1.0,)), JoystickReading((1.0,), frozenset({4}))


class Steered:
    def __init__(self) -> None:
        self.kept_until_s = float("-inf")
        self.sticks = StickDemand()
        self.buttons: list[JoystickButton] = []
        self.hand = HandOnJoystick(asyncio.get_running_loop(), self, {"stick": MAPPING}, self.buttons.append)

    def move(self, sticks: StickDemand) -> None:
        self.sticks = sticks

    def hold_key(self, for_s: float) -> None:
        self.kept_until_s = asyncio.get_running_loop().time() + for_s

    def release(self) -> None:
        self.kept_until_s = float("-inf")

    @property
    def is_kept(self) -> bool:
        return asyncio.get_running_loop().time() < self.kept_until_s

    def held(self) -> None:
        """Connects a joystick and holds its key, ahead."""
        self.hand.connected(1, DEVICE)
        self.hand.moved(1, AHEAD)
        self.hand.moved(1, PRESSED)
        assert self.is_kept
        assert self.sticks.surge == 1.0


def virtual(check: Callable[[Steered], Awaitable[None]]) -> None:
    async def main() -> None:
        await check(Steered())

    run_virtual(main())


def test_a_released_key_centres_the_sticks_at_once() -> None:
    async def check(at: Steered) -> None:
        at.held()
        at.hand.moved(1, AHEAD)
        assert (at.is_kept, at.sticks) == (False, StickDemand())

    virtual(check)


def test_an_unplugged_joystick_lets_go_at_once_is_told_and_has_to_press_again_when_it_is_back() -> None:
    async def check(at: Steered) -> None:
        at.held()
        at.hand.disconnected(1, "it is disconnected")
        assert (at.is_kept, at.sticks) == (False, StickDemand())
        assert at.hand.problem == "joystick Stick: it is disconnected"
        at.hand.connected(2, DEVICE)
        at.hand.moved(2, PRESSED)
        assert not at.is_kept, "a key that was held when it was connected is nothing that was pressed"
        at.hand.moved(2, AHEAD)
        at.hand.moved(2, PRESSED)
        assert at.is_kept

    virtual(check)


def test_a_silent_joystick_lets_go_and_has_to_press_again() -> None:
    async def check(at: Steered) -> None:
        at.held()
        await asyncio.sleep(SILENT_S + 0.01)
        assert (at.is_kept, at.sticks) == (False, StickDemand())
        assert "silent" in at.hand.problem
        at.hand.moved(1, PRESSED)
        assert not at.is_kept
        at.hand.moved(1, AHEAD)
        at.hand.moved(1, PRESSED)
        assert at.is_kept
        assert not at.hand.problem

    virtual(check)


def test_a_closed_hand_steers_no_more() -> None:
    async def check(at: Steered) -> None:
        at.held()
        at.hand.close()
        assert (at.is_kept, at.sticks) == (False, StickDemand())
        at.hand.moved(1, AHEAD)
        at.hand.moved(1, PRESSED)
        assert not at.is_kept

    virtual(check)


def test_of_two_joysticks_the_one_whose_key_is_held_steers() -> None:
    async def check(at: Steered) -> None:
        at.held()
        at.hand.connected(2, DEVICE)
        back = JoystickReading((-1.0,), frozenset({4}))
        at.hand.moved(2, JoystickReading((-1.0,)))
        at.hand.moved(2, back)
        assert at.sticks.surge == 1.0
        at.hand.moved(1, AHEAD)
        assert not at.is_kept
        at.hand.moved(2, back)
        assert at.sticks.surge == -1.0

    virtual(check)


def test_buttons_are_told_once_for_each_press_and_a_joystick_without_a_mapping_does_nothing() -> None:
    async def check(at: Steered) -> None:
        held = JoystickReading((0.0,), frozenset({1}))
        at.hand.connected(1, DEVICE)
        at.hand.moved(1, held)
        assert at.buttons == [], "it was held when it was connected"
        at.hand.moved(1, JoystickReading((0.0,)))
        at.hand.moved(1, held)
        at.hand.moved(1, held)
        assert at.buttons == [JoystickButton.HOLD]
        at.hand.connected(2, JoystickDevice(key="other", name="Other"))
        at.hand.moved(2, PRESSED)
        assert not at.is_kept
        assert at.hand.names == ("Stick", f"Other: {TO_MAP}")

    virtual(check)
