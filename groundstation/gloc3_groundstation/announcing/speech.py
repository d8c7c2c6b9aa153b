"""Speech by a program of the computer: one text at a time, the newest first, and the loop never waits for it."""

import asyncio
import shutil
from collections.abc import Callable
from typing import Final

from gloc3.documents.characters import harmless

PROGRAMS: Final = (("spd-say", "--wait"), ("espeak-ng",), ("espeak",), ("say",))
"""Programs that speak their last argument, and end when it is spoken; the first one that is found is used."""
NONE_FOUND: Final = (
    "alerts are not spoken: no speech program is found (spd-say, espeak-ng, espeak or say); install one, such as the "
    "package speech-dispatcher or espeak-ng"
)
LONGEST_S: Final = 20.0
"""A text that is spoken longer is broken off, s."""
MOST_WAITING: Final = 4
"""Texts that wait; of more, the oldest are dropped."""
LONGEST_TEXT: Final = 200


def find_program() -> tuple[str, ...] | None:
    """The speech program of this computer, with its options; None where there is none."""
    return next((program for program in PROGRAMS if shutil.which(program[0])), None)


class Speech:
    """Speaks texts.

    Args:
        program: speaks its last argument.
        warn: called once, with the reason, where the program fails.
    """

    def __init__(self, program: tuple[str, ...], warn: Callable[[str], object]) -> None:
        self._program, self._warn = program, warn
        self._waiting: list[str] = []
        self._spoken = ""
        self._task: asyncio.Task[None] | None = None
        self._has_failed = False

    def speak(self, text: str) -> None:
        """Speaks a text when the present one is over; one that is spoken or waits already is dropped."""
        text = harmless(text)[:LONGEST_TEXT].lstrip("-+ ")  # no option of the program
        if not text or text == self._spoken or text in self._waiting:
            return
        self._waiting = [*self._waiting, text][-MOST_WAITING:]
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._speak_all())

    async def close(self) -> None:
        """Breaks off."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _speak_all(self) -> None:
        try:
            while self._waiting:
                self._spoken = self._waiting.pop()
                await self._run(self._spoken)
        finally:
            self._spoken, self._task = "", None

    async def _run(self, text: str) -> None:
        quiet = asyncio.subprocess.DEVNULL
        try:
            process = await asyncio.create_subprocess_exec(
                *self._program, text, stdin=quiet, stdout=quiet, stderr=quiet
            )
        except OSError as error:
            self._fail(error.strerror or str(error))
            return
        try:
            async with asyncio.timeout(LONGEST_S):
                code = await process.wait()
            if code:
                self._fail(f"it ends with {code}")
        except TimeoutError:
            self._fail(f"it does not end within {LONGEST_S:.0f} s")
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()

    def _fail(self, reason: str) -> None:
        if not self._has_failed:
            self._has_failed = True
            self._warn(f"alerts may not be spoken: {self._program[0]}: {reason}")
