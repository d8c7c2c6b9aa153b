"""The websocket of one browser: its queue of output and messages, and beats.

The server sends a beat behind the output that waits. The page reports to the operator when beats do not come, and
returns the time of the last beat with each key: a key that was pressed before a standstill does not act after it.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import msgspec

from gloc3.errors import UNREADABLE

if TYPE_CHECKING:
    from aiohttp import web

BEAT_S: Final = 0.5
"""Period of the beats; the page reports a standstill after 2 s without one."""
KEY_AGE_S: Final = 3.0
"""Keys that refer to an older beat are dropped."""
HEARTBEAT_S: Final = 5.0
"""Period of the websocket's pings; a browser counts as gone after half of it without an answer."""
HELLO_S: Final = 10.0
"""Time within which a page introduces itself."""
MOST_WAITING: Final = 1_000_000
"""Queued bytes for a slow browser, beyond which the terminal is redrawn once the browser has caught up."""
MOST_MS: Final = 1e15
MOST_MESSAGES: Final = 64
"""Messages that wait for a slow browser; older ones are dropped."""


class Glass:
    """Websocket of one browser, with a queue of output.

    Args:
        socket: the websocket.
        now_s: the clock of the beats.
        who: the browser, in words.
        may_command: whether its keys count.
    """

    def __init__(
        self, socket: "web.WebSocketResponse", now_s: Callable[[], float], who: str, *, may_command: bool
    ) -> None:
        self.socket: Final = socket
        self.now_s: Final = now_s
        self.who: Final = who
        self.may_command: Final = may_command
        self.columns, self.lines = 80, 24
        self.window = ""
        self.is_behind = False
        """Whether output was dropped, so that all must be redrawn."""
        self._waiting = bytearray()
        self._messages: deque[bytes] = deque(maxlen=MOST_MESSAGES)
        self._has_some = asyncio.Event()

    def show(self, data: bytes) -> None:
        """Queues output of the terminal."""
        if len(self._waiting) + len(data) > MOST_WAITING:
            self.is_behind = True
            self._waiting.clear()
        elif not self.is_behind:
            self._waiting += data
        self._has_some.set()

    def notify(self, *message: object) -> None:
        """Queues a message to the page."""
        self._messages.append(msgspec.json.encode(message))
        self._has_some.set()

    def age_s(self, beat_ms: object) -> float:
        """Age of the beat that a key refers to, s; infinity where it is none of this station's."""
        is_number = isinstance(beat_ms, int | float) and abs(beat_ms) < MOST_MS
        age_s = self.now_s() - beat_ms / 1000.0 if is_number else -1.0  # type: ignore[operator]
        return age_s if age_s > -0.001 else float("inf")

    @property
    def is_busy(self) -> bool:
        """Whether messages wait that the browser has not taken."""
        return len(self._messages) > MOST_MESSAGES // 4

    def is_current(self, beat_ms: object) -> bool:
        """Whether a key counts; the page learns of one that does not."""
        age_s = self.age_s(beat_ms)
        if age_s <= KEY_AGE_S:
            return True
        self.notify("dropped", round(min(age_s, 1e6), 1))
        return False

    async def converse(self, receive: Callable[[str], None], redraw: Callable[[], None]) -> None:
        """Sends and receives until the browser is gone, or has not introduced itself.

        Args:
            receive: called with each message.
            redraw: called to show everything again, where output was dropped.
        """
        from aiohttp import WSMsgType

        loop = asyncio.get_running_loop()
        sender = loop.create_task(self.send(redraw))
        late = loop.call_later(HELLO_S, sender.cancel)
        try:
            async for message in self.socket:
                if message.type is WSMsgType.TEXT:
                    late.cancel()
                    receive(message.data)
        finally:
            late.cancel()
            sender.cancel()

    async def send(self, redraw: Callable[[], None]) -> None:
        """Sends output, messages and beats until it is cancelled or the browser is gone."""
        beat_s = self.now_s()
        while not self.socket.closed:
            try:
                async with asyncio.timeout_at(beat_s):
                    await self._has_some.wait()
            except TimeoutError:
                pass
            self._has_some.clear()
            if self.is_behind:
                self.is_behind = False
                redraw()
            data, self._waiting = bytes(self._waiting), bytearray()
            try:
                if data:
                    await self.socket.send_bytes(data)
                while self._messages:
                    await self.socket.send_str(self._messages.popleft().decode())
                now_s = self.now_s()
                if now_s >= beat_s:
                    beat_s = now_s + BEAT_S
                    await self.socket.send_str(f'["beat",{now_s * 1000.0:.0f}]')
            except ConnectionError:
                return


def parts_of(data: str) -> list[object]:
    """The kind and the values of a page's message; of an unreadable one an empty kind."""
    try:
        return msgspec.json.decode(data, type=list[object]) or [""]
    except (*UNREADABLE, ValueError):
        return [""]
