"""The operator's hand on a joystick: the dead-man's key, sticks and buttons, from whatever joysticks are connected.

A joystick steers while its dead-man's key is held. A key that is held when the joystick is connected does not count
until it was released. A joystick that is unplugged, or silent for `SILENT_S`, has let go.
"""

import asyncio
from collections.abc import Callable, Mapping
from typing import Final, Protocol

from gloc3_groundstation.joysticks.defaults import default_mapping
from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading, StickDemand
from gloc3_groundstation.joysticks.mapping import JoystickButton, JoystickMapping

SILENT_S: Final = 0.3
"""Silence of a joystick after which its key counts as released, s."""
TO_MAP: Final = "it has no mapping; j maps it"


class Steered(Protocol):
    """What the hand moves; `gloc3_groundstation.desk.teleoperation.Hand` is one."""

    def move(self, sticks: StickDemand) -> None:
        """Moves the sticks."""

    def hold_key(self, for_s: float) -> None:
        """The dead-man's key is held, and counts so for `for_s`."""

    def release(self) -> None:
        """The dead-man's key is released."""


class _Connected:
    __slots__ = ("device", "is_armed", "mapping", "pressed", "problem")

    def __init__(self, device: JoystickDevice, mapping: JoystickMapping | None) -> None:
        self.device, self.mapping = device, mapping
        self.problem = TO_MAP if mapping is None else mapping.problem
        self.is_armed = False
        """Whether its dead-man's key has been seen released."""
        self.pressed: frozenset[JoystickButton] = frozenset()


class HandOnJoystick:
    """Listens to all joysticks; the one whose dead-man's key is held steers.

    Args:
        loop: the event loop.
        steered: what is moved.
        mappings: mappings of the configuration by key of the device.
        pressed: called for each button when it is pressed, the dead-man's key aside.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        steered: Steered,
        mappings: Mapping[str, JoystickMapping],
        pressed: Callable[[JoystickButton], None],
    ) -> None:
        self.problem = ""
        """Why no joystick steers, or what has happened to one; empty while all is well."""
        self._loop, self._steered, self._mappings, self._pressed = loop, steered, mappings, pressed
        self._connected: dict[int, _Connected] = {}
        self._steering: int | None = None
        self._silence: asyncio.TimerHandle | None = None
        self._is_open = True
        self._failure = ""

    @property
    def is_held(self) -> bool:
        """Whether a dead-man's key is held."""
        return self._steering is not None

    @property
    def held_buttons(self) -> frozenset[JoystickButton]:
        """Buttons that are held on the joystick that steers; none without one."""
        return frozenset() if self._steering is None else self._connected[self._steering].pressed

    @property
    def names(self) -> tuple[str, ...]:
        """Connected joysticks, each with what is wrong with it."""
        return tuple(
            f"{one.device.name}: {one.problem}" if one.problem else one.device.name for one in self._connected.values()
        )

    def close(self) -> None:
        """Lets go, for good."""
        if self._steering is not None:
            self._let_go()
        self._is_open = False

    # --- what a reader reports ---

    def connected(self, number: int, device: JoystickDevice) -> None:
        """A joystick is found."""
        if self.problem == self._failure:
            self.problem = ""
        self._connected[number] = _Connected(device, self._mappings.get(device.key) or default_mapping(device))

    def disconnected(self, number: int, reason: str) -> None:
        """A joystick is gone: its key is released."""
        lost = self._connected.pop(number, None)
        if lost is not None:
            self.problem = f"joystick {lost.device.name}: {reason}"
        if number == self._steering:
            self._let_go()

    def failed(self, reason: str) -> None:
        """No joystick can be read."""
        self.problem = self._failure = reason

    def moved(self, number: int, reading: JoystickReading) -> None:
        """Sticks count only while the dead-man's key is held, so that keys work beside a joystick at rest."""
        one = self._connected.get(number)
        if not self._is_open or one is None or one.mapping is None or one.problem:
            return
        before, one.pressed = one.pressed, one.mapping.pressed(reading)
        was_armed, is_down = one.is_armed, JoystickButton.DEAD_MAN in one.pressed
        one.is_armed = was_armed or not is_down
        if is_down and one.is_armed and self._steering in (None, number):
            if self._steering is None:
                self._steering, self.problem = number, ""
            self._steered.move(one.mapping.sticks(reading))
            self._steered.hold_key(SILENT_S)
            self._watch_silence()
        elif number == self._steering:
            self._let_go()
        if was_armed:
            for button in sorted(one.pressed - before - {JoystickButton.DEAD_MAN}):
                self._pressed(button)

    def _watch_silence(self) -> None:
        if self._silence is not None:
            self._silence.cancel()
        self._silence = self._loop.call_later(SILENT_S, self._fall_silent)

    def _fall_silent(self) -> None:
        if self._steering is not None:
            one = self._connected[self._steering]
            one.is_armed = False
            self.problem = f"joystick {one.device.name}: silent for {SILENT_S:g} s"
            self._let_go()

    def _let_go(self) -> None:
        self._steering = None
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None
        self._steered.move(StickDemand())
        self._steered.release()
