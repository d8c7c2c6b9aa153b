"""What every page beside the terminal commands: HOLD, and other work of the desk, with the outcome as a message."""

import asyncio
from collections.abc import Coroutine
from typing import Any

from gloc3.errors import Gloc3Error
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.web import map_commands
from gloc3_groundstation.web.glass import Glass


class PageCommands:
    """Carries out commands of pages.

    Args:
        desk: commands the vehicles.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._tasks: set[asyncio.Task[None]] = set()

    def hold(self, glass: Glass, vehicle: str, beat_ms: object) -> None:
        """Has a vehicle hold, if the page may command and its key is current."""
        if not glass.may_command:
            glass.notify("read_only")
        elif glass.is_current(beat_ms):
            self.carry_out(glass, map_commands.hold(self._desk, vehicle))

    def carry_out(self, glass: Glass, work: Coroutine[Any, Any, str]) -> None:
        """Carries something out, and tells the page what became of it."""

        async def run() -> None:
            try:
                glass.notify("result", True, await work)
            except Gloc3Error as error:
                glass.notify("result", False, str(error))

        self.start(run())

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Starts work that nobody waits for."""
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
