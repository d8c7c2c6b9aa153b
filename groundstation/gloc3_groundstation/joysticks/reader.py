"""Opens the reader of joysticks that suits this computer: SDL where it is installed, Linux's own interface otherwise."""

import asyncio
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from gloc3_groundstation.joysticks.listener import JoystickListener, JoystickReader

NOT_INSTALLED: Final = "joysticks need SDL on this computer: install gloc3[joystick]"


def open_reader(device: str, listener: JoystickListener) -> JoystickReader:
    """Opens the joysticks of this computer.

    Args:
        device: a device or FIFO of Linux's joystick interface; empty for every joystick, by SDL where it is installed.
        listener: receives what is found, in the running event loop.
    """
    loop = asyncio.get_running_loop()
    if not device and find_spec("sdl2") is not None:
        from gloc3_groundstation.joysticks.sdl_reader import SdlReader

        return SdlReader(loop, listener)
    if sys.platform == "linux":
        from gloc3_groundstation.joysticks.linux_reader import LinuxReader

        return LinuxReader(loop, listener, Path(device).expanduser() if device else None)
    return _NoReader(listener)


class _NoReader:
    def __init__(self, listener: JoystickListener) -> None:
        listener.failed(NOT_INSTALLED)

    async def close(self) -> None:
        """Nothing is open."""
