"""One request to MAVSDK's process, and the last line of output when it ends."""

import asyncio
from collections.abc import Callable
from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink.services.plan import PlanItem

STALLED_S: Final = 30.0
"""A request of which nothing is heard for so long is given up, and the process with it."""


async def last_line(stream: asyncio.StreamReader) -> str:
    """Reads to the end, so that nothing that is printed stops the process, and gives the last line."""
    tail = b""
    while piece := await stream.read(4096):
        tail = (tail + piece)[-4096:]
    lines = tail.decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else ""


class HelperCall:
    """One request, with the time after which it counts as stalled."""

    def __init__(self, on_fraction: Callable[[float], None] | None) -> None:
        self._on_fraction = on_fraction
        self._loop = asyncio.get_running_loop()
        self._ended: asyncio.Future[tuple[PlanItem, ...]] = self._loop.create_future()
        self._timer = self._loop.call_later(STALLED_S, self._stall)

    async def wait(self) -> tuple[PlanItem, ...]:
        """Waits for its end.

        Raises:
            Refused: it went wrong; with the reason.
            TimeoutError: it has stalled.
        """
        try:
            return await self._ended
        finally:
            self._timer.cancel()

    def received(self, *, is_transfer: bool) -> None:
        """Something came from the vehicle."""
        if is_transfer and not self._ended.done():
            self._timer.cancel()
            self._timer = self._loop.call_later(STALLED_S, self._stall)

    def advance(self, fraction: float) -> None:
        """It is so far, 0 to 1."""
        if self._on_fraction is not None:
            self._on_fraction(fraction)

    def finish(self, items: tuple[PlanItem, ...]) -> None:
        """It went well."""
        if not self._ended.done():
            self._ended.set_result(items)

    def fail(self, reason: str) -> None:
        """It went wrong."""
        if not self._ended.done():
            self._ended.set_exception(Refused(reason))

    def _stall(self) -> None:
        if not self._ended.done():
            self._ended.set_exception(TimeoutError())
