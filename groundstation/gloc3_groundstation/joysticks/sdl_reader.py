"""Joysticks of any make by SDL, which runs in a process of its own; one that ends is begun again."""

import asyncio
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

import msgspec

from gloc3_groundstation.joysticks.defaults import sdl_controls
from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading
from gloc3_groundstation.joysticks.listener import JoystickListener
from gloc3_groundstation.joysticks.sdl_process import FromSdl, JoystickFound, JoystickGone, JoystickMoved, from_sdl

PROGRAM: Final = ("-W", "ignore", "-m", "gloc3_groundstation.joysticks.sdl_process")
AGAIN_S: Final = 2.0
"""Time before a process that has ended is begun again, s."""
LINE_BYTES: Final = 1 << 16
LONGEST_REASON: Final = 200


class SdlReader:
    """Reads joysticks from SDL's process.

    Args:
        loop: the event loop.
        listener: receives what is found.
        program: arguments for Python that run the process.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, listener: JoystickListener, program: Sequence[str] = PROGRAM
    ) -> None:
        self._listener, self._program = listener, program
        self.process: asyncio.subprocess.Process | None = None
        """SDL's process; None before it runs."""
        self._found: set[int] = set()
        self._task = loop.create_task(self._run())

    async def close(self) -> None:
        """Ends the process."""
        self._task.cancel()
        with suppress(asyncio.CancelledError):
            await self._task

    async def _run(self) -> None:
        while True:
            reason = await self._serve()
            for number in sorted(self._found):
                self._listener.disconnected(number, "SDL has ended")
            self._found.clear()
            self._listener.failed(f"SDL has ended: {reason}"[:LONGEST_REASON])
            with suppress(TimeoutError):
                async with asyncio.timeout(AGAIN_S):
                    await asyncio.Event().wait()

    async def _serve(self) -> str:
        """Runs the process once; returns why it has ended."""
        try:
            self.process = process = await asyncio.create_subprocess_exec(
                *(sys.executable, *self._program),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                limit=LINE_BYTES,
                start_new_session=True,  # the terminal's Ctrl-C is not for it
                env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            )
        except OSError as error:
            return error.strerror or "it does not start"
        assert process.stdout is not None
        assert process.stderr is not None
        complaints = asyncio.ensure_future(_last_line(process.stderr))
        problem = ""
        try:
            while line := await process.stdout.readline():
                self._handle(from_sdl.decode(line))
        except (ValueError, msgspec.DecodeError):
            problem = "it does not speak as agreed"
        finally:
            with suppress(ProcessLookupError):
                process.kill()
            if process.stdin is not None:
                process.stdin.close()
            await process.stdout.read()  # to its end, so that the pipe is closed
            words = await complaints
            await process.wait()
        return problem or words or f"code {process.returncode}"

    def _handle(self, message: FromSdl) -> None:
        match message:
            case JoystickFound():
                self._found.add(message.number)
                controls = sdl_controls(message.database)
                device = JoystickDevice(key=message.guid, name=message.name, axes=message.axes, controls=controls)
                self._listener.connected(message.number, device)
            case JoystickGone(number=number):
                self._found.discard(number)
                self._listener.disconnected(number, "it is disconnected")
            case JoystickMoved(number=number):
                self._listener.moved(number, JoystickReading(message.axes, frozenset(message.pressed)))


async def _last_line(stream: asyncio.StreamReader) -> str:
    """Reads to the end, so that nothing that is printed stops the process, and gives the last line."""
    tail = b""
    while piece := await stream.read(4096):
        tail = (tail + piece)[-4096:]
    lines = tail.decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else ""
