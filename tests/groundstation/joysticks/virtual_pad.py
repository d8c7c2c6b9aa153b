"""SDL's process with a virtual pad: reads commands from its input, `axis 1 -32768`, `button 9 1`, `unplug`, `plug`."""

import sys
from pathlib import Path
from typing import Any

from gloc3_groundstation.joysticks import sdl_process

AXES, BUTTONS = 6, 15


class VirtualPad:
    """The pad, which SDL takes for a game controller."""

    def __init__(self, sdl: Any) -> None:
        self._sdl = sdl
        self._joystick: Any = None
        self._index = -1

    def plug(self) -> None:
        self._index = self._sdl.SDL_JoystickAttachVirtual(self._sdl.SDL_JOYSTICK_TYPE_GAMECONTROLLER, AXES, BUTTONS, 0)
        self._joystick = self._sdl.SDL_JoystickOpen(self._index)

    def obey(self, line: str) -> None:
        word, *numbers = line.split()
        match word, [int(number) for number in numbers]:
            case "axis", [axis, value]:
                self._sdl.SDL_JoystickSetVirtualAxis(self._joystick, axis, value)
            case "button", [button, is_pressed]:
                self._sdl.SDL_JoystickSetVirtualButton(self._joystick, button, is_pressed)
            case "unplug", []:
                self._sdl.SDL_JoystickDetachVirtual(self._index)
            case "plug", []:
                self.plug()


def main(path: str) -> None:
    """Reports as the real process does, and obeys the lines that are appended to a file."""
    import sdl2

    joysticks = sdl_process.SdlJoysticks(sdl_process.prepared())
    pad = VirtualPad(sdl2)
    pad.plug()
    with Path(path).open() as commands:

        def obey() -> None:
            while line := commands.readline():
                pad.obey(line)

        joysticks.run(obey)


if __name__ == "__main__":
    main(sys.argv[1])
