"""SDL in its own process: reports joysticks of any make as lines of JSON on its output, and ends when its input does.

It is a process because SDL is native code that must run on a main thread (on macOS), and whose drivers can hang or end
the program that it lives in. SDL gives no window and takes no keyboard here.

It runs as `python -m gloc3_groundstation.joysticks.sdl_process`.
"""

import os
import sys
import threading
from collections.abc import Callable
from typing import Any, Final, NoReturn, TypeAlias

import msgspec

POLL_MS: Final = 5
"""Time between two looks for events, ms."""
REPEAT_MS: Final = 100
"""Longest time between two reports of a joystick, ms."""
FULL: Final = 32767
HINTS: Final = {
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",
    "SDL_JOYSTICK_THREAD": "1",
    "SDL_NO_SIGNAL_HANDLERS": "1",
    "SDL_VIDEODRIVER": "dummy",
}
"""Settings of SDL: it reads joysticks without a window."""
HAT_UP, HAT_RIGHT, HAT_DOWN, HAT_LEFT = 1, 2, 4, 8


class JoystickFound(msgspec.Struct, frozen=True, tag=True):
    """A joystick is connected."""

    number: int
    guid: str
    name: str
    axes: int
    database: str = ""
    """Its line of SDL's database; empty where it is not in it."""


class JoystickGone(msgspec.Struct, frozen=True, tag=True):
    """A joystick is disconnected."""

    number: int


class JoystickMoved(msgspec.Struct, frozen=True, tag=True):
    """Positions of a joystick."""

    number: int
    axes: tuple[float, ...]
    """-1 to 1, hats behind the others: to the right, and down."""
    pressed: tuple[int, ...]


FromSdl: TypeAlias = JoystickFound | JoystickGone | JoystickMoved
from_sdl: Final = msgspec.json.Decoder(FromSdl)
_encode = msgspec.json.Encoder().encode


class SdlJoysticks:
    """All joysticks that SDL knows; `poll` reports what is new.

    Args:
        output: a file descriptor that takes the lines.
    """

    def __init__(self, output: int) -> None:
        import sdl2

        self._sdl: Any = sdl2
        self._output = output
        self._open: dict[int, Any] = {}
        self._last: dict[int, tuple[JoystickMoved, int]] = {}
        for name, value in HINTS.items():
            sdl2.SDL_SetHint(name.encode(), value.encode())
        if sdl2.SDL_Init(sdl2.SDL_INIT_JOYSTICK | sdl2.SDL_INIT_GAMECONTROLLER):
            raise SystemExit(f"SDL does not start: {sdl2.SDL_GetError().decode('utf-8', 'replace')}")

    def run(self, poll: Callable[[], None] = lambda: None) -> NoReturn:
        """Reports joysticks until the process ends.

        Args:
            poll: called before each look for events.
        """
        while True:
            poll()
            self._poll()
            self._sdl.SDL_Delay(POLL_MS)

    def _poll(self) -> None:
        sdl, event = self._sdl, self._sdl.SDL_Event()
        while sdl.SDL_PollEvent(event):
            if event.type == sdl.SDL_JOYDEVICEADDED:
                self._find(event.jdevice.which)
            elif event.type == sdl.SDL_JOYDEVICEREMOVED:
                self._lose(event.jdevice.which)
        for number, joystick in self._open.items():
            self._report(number, joystick)

    def _find(self, index: int) -> None:
        sdl = self._sdl
        joystick = sdl.SDL_JoystickOpen(index)
        if not joystick:
            return
        number = sdl.SDL_JoystickInstanceID(joystick)
        guid = sdl.SDL_JoystickGetGUID(joystick)
        known = sdl.SDL_GameControllerMappingForGUID(guid)
        self._open[number] = joystick
        found = JoystickFound(
            number=number,
            guid="".join(f"{byte:02x}" for byte in guid.data),
            name=(sdl.SDL_JoystickName(joystick) or b"joystick").decode("utf-8", "replace"),
            axes=sdl.SDL_JoystickNumAxes(joystick),
            database=known.decode("utf-8", "replace") if known else "",
        )
        self._send(found)

    def _lose(self, number: int) -> None:
        joystick = self._open.pop(number, None)
        self._last.pop(number, None)
        if joystick is not None:
            self._sdl.SDL_JoystickClose(joystick)
            self._send(JoystickGone(number))

    def _report(self, number: int, joystick: Any) -> None:
        if not self._sdl.SDL_JoystickGetAttached(joystick):
            return
        moved, now_ms = self._positions(number, joystick), self._sdl.SDL_GetTicks()
        last, sent_ms = self._last.get(number, (None, 0))
        if moved != last or now_ms - sent_ms >= REPEAT_MS:
            self._last[number] = moved, now_ms
            self._send(moved)

    def _positions(self, number: int, joystick: Any) -> JoystickMoved:
        sdl = self._sdl
        axes = [sdl.SDL_JoystickGetAxis(joystick, axis) for axis in range(sdl.SDL_JoystickNumAxes(joystick))]
        hats = [sdl.SDL_JoystickGetHat(joystick, hat) for hat in range(sdl.SDL_JoystickNumHats(joystick))]
        buttons = range(sdl.SDL_JoystickNumButtons(joystick))
        crossed = [
            float(bool(hat & more) - bool(hat & less))
            for hat in hats
            for more, less in ((HAT_RIGHT, HAT_LEFT), (HAT_DOWN, HAT_UP))
        ]
        return JoystickMoved(
            number,
            (*(round(max(-1.0, value / FULL), 4) for value in axes), *crossed),
            tuple(button for button in buttons if sdl.SDL_JoystickGetButton(joystick, button)),
        )

    def _send(self, message: FromSdl) -> None:
        data = memoryview(_encode(message) + b"\n")
        while data:
            data = data[os.write(self._output, data) :]


def prepared() -> int:
    """Ends this process with its input; returns the output for messages. What SDL prints goes where errors go."""
    os.environ.update(HINTS)
    output = os.dup(1)
    os.dup2(2, 1)
    threading.Thread(target=_end_with_input, daemon=True).start()
    return output


def _end_with_input() -> None:
    while sys.stdin.buffer.read(1024):
        pass
    os._exit(0)


def main() -> None:
    """Reports joysticks until the input ends."""
    SdlJoysticks(prepared()).run()


if __name__ == "__main__":
    main()
