"""MAVSDK behind the station's own link: it receives one vehicle's frames, and sends in the station's name.

The station owns each link once. MAVSDK therefore has no socket: a process of its own (see `process`) gets the frames that
its plugins need, and what it sends is decoded, and sent (and signed, where the link is) by the station. Its heartbeats
end here, so that exactly one station heartbeat leaves; so do the questions that it asks on its own account, up to four a
second, which a radio can do without.
"""

import asyncio
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.codec import Frame, Parser, decode, shape
from gloc3.mavlink.message import Address
from gloc3_groundstation.services.machines import Wire
from gloc3_groundstation.services.mavsdk.messages import (
    LENGTH_BYTES,
    Act,
    Done,
    Failed,
    FromProcess,
    LinkReceived,
    LinkSent,
    PipeError,
    Plugin,
    Ready,
    ToProcess,
    from_process,
    length_of,
    packed,
)

START_S: Final = 20.0
"""Longest time for the process to begin, s."""
ANSWER_S: Final = 20.0
"""Longest time for the vehicle's answer, s: MAVSDK repeats a command three times in half a second each, and a take-off
is three of them."""
IDLE_S: Final = 120.0
"""A process that nobody has asked for anything for so long is ended; the next command begins another."""
RECEIVED: Final = (
    "HEARTBEAT", "AUTOPILOT_VERSION", "COMMAND_ACK", "EXTENDED_SYS_STATE", "GLOBAL_POSITION_INT", "HOME_POSITION",
    "MISSION_ACK", "MISSION_CURRENT", "PARAM_VALUE", "SYS_STATUS",
)  # fmt: skip
"""What MAVSDK is told; other telemetry would only cost."""
SENT: Final = ("COMMAND_LONG", "COMMAND_INT", "SET_MODE", "PARAM_SET", "PARAM_REQUEST_READ", "MISSION_SET_CURRENT")
"""What may leave."""
QUESTIONS: Final = frozenset({511, 512, 520})
"""Commands that MAVSDK sends on its own account: message intervals, and requests for messages and capabilities."""


class MavsdkBehindLink:
    """MAVSDK for one vehicle; begun when it is first asked for something, and always ended by `close`.

    Args:
        wire: the link.
        target: the vehicle's autopilot.
    """

    def __init__(self, wire: Wire, target: Address) -> None:
        self.dropped = 0
        """Frames of MAVSDK that did not leave: its heartbeats and its own questions."""
        self._wire = wire
        self._target = target
        self._received_ids = frozenset(shape(name).id for name in RECEIVED)
        self._sent_ids = frozenset(shape(name).id for name in SENT)
        self._parser = Parser(is_datagram=True)
        self._process: asyncio.subprocess.Process | None = None
        self._reading: asyncio.Task[None] | None = None
        self._ready: asyncio.Future[None] | None = None
        self._calls: dict[int, asyncio.Future[None]] = {}
        self._number = 0
        self._lock = asyncio.Lock()
        self._unlisten: Callable[[], object] | None = None
        self._idle: asyncio.TimerHandle | None = None
        self._is_open = True

    @property
    def is_running(self) -> bool:
        """Whether its process runs."""
        return self._process is not None and self._process.returncode is None

    async def act(self, plugin: Plugin, *arguments: float) -> None:
        """Commands the vehicle, one thing after the other.

        Raises:
            Refused: the vehicle refuses it or does not answer, or MAVSDK does not run; with the reason.
        """
        async with self._lock:
            self._stop_idling()
            await self._start()
            self._number += 1
            call = self._calls[self._number] = asyncio.get_running_loop().create_future()
            self._send(Act(self._number, plugin, arguments))
            try:
                async with asyncio.timeout(ANSWER_S):
                    await call
            except TimeoutError:
                await self._end("MAVSDK hangs")
                raise Refused(f"no answer within {ANSWER_S:.0f} s") from None
            except asyncio.CancelledError:
                await self._end("cancelled")
                raise
            finally:
                self._calls.pop(self._number, None)
                if self._is_open and self.is_running:
                    self._idle = asyncio.get_running_loop().call_later(IDLE_S, self._end_idle)

    async def close(self) -> None:
        """Ends the process; who waits is refused."""
        self._is_open = False
        await self._end("the services of this vehicle are closed")

    async def _start(self) -> None:
        """Begins the process, unless it runs.

        Raises:
            Refused: it does not begin; with what it said last.
        """
        if not self._is_open:
            raise Refused("the services of this vehicle are closed")
        if self.is_running:
            return
        await self._end("it is restarted")
        own = self._wire.own
        self._process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "gloc3_groundstation.services.mavsdk.process"),
            *(str(own.system), str(own.component)),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,  # the terminal's Ctrl-C is not for it
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        )
        self._ready = asyncio.get_running_loop().create_future()
        self._reading = asyncio.ensure_future(self._read(self._process))
        self._unlisten = self._wire.listen(self._receive_frame)
        try:
            await asyncio.wait_for(asyncio.shield(self._ready), START_S)
        except (TimeoutError, asyncio.CancelledError) as error:
            self._ready.cancel()
            await self._end("it did not start")
            if isinstance(error, TimeoutError):
                raise Refused("MAVSDK does not start") from None
            raise

    async def _end(self, reason: str) -> None:
        """Ends the process and whatever was asked of it."""
        self._stop_idling()
        self._stop_listening()
        self._fail_all(reason)
        process, self._process = self._process, None
        reading, self._reading = self._reading, None
        if process is not None:
            with suppress(ProcessLookupError):
                process.kill()
            if process.stdin is not None:
                process.stdin.close()
        if reading is not None:
            await reading  # it ends with the process, which it waits for

    def _fail_all(self, reason: str) -> None:
        for waiting in (*self._calls.values(), self._ready):
            if waiting is not None and not waiting.done():
                waiting.set_exception(Refused(reason))
                waiting.exception()  # whoever waits hears of it; otherwise nobody has to

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        """Takes what the process says until it ends."""
        assert process.stdout is not None
        assert process.stderr is not None
        complaints = asyncio.ensure_future(_last_line(process.stderr))
        problem = ""
        try:
            while True:
                head = await process.stdout.readexactly(LENGTH_BYTES)
                self._handle(from_process.decode(await process.stdout.readexactly(length_of(head))))
        except asyncio.IncompleteReadError:
            pass
        except (PipeError, msgspec.DecodeError) as error:
            problem = str(error)
            with suppress(ProcessLookupError):
                process.kill()
        words = await complaints
        code = await process.wait()
        if process is self._process:
            reason = problem or words or f"code {code}"
            if "No module named 'mavsdk'" in reason:
                reason = "it is not installed; install gloc3[groundstation]"
            self._fail_all(f"MAVSDK has ended: {reason}")

    def _handle(self, message: FromProcess) -> None:
        match message:
            case LinkSent(data=data):
                for frame in self._parser.receive(data):
                    self._pass_on(frame)
            case Ready():
                if self._ready is not None and not self._ready.done():
                    self._ready.set_result(None)
            case Done(number=number) if number in self._calls and not self._calls[number].done():
                self._calls[number].set_result(None)
            case Failed(number=number, reason=reason) if number in self._calls and not self._calls[number].done():
                self._calls[number].set_exception(Refused(reason))

    def _pass_on(self, frame: Frame) -> None:
        sent = decode(frame) if frame.message_id in self._sent_ids and frame.sender == self._wire.own else None
        if sent is None or getattr(sent, "command", None) in QUESTIONS:
            self.dropped += 1
        else:
            self._wire.send(sent)

    def _receive_frame(self, frame: Frame) -> None:
        if frame.sender == self._target and frame.message_id in self._received_ids:
            self._send(LinkReceived(frame.raw))

    def _send(self, message: ToProcess) -> None:
        if self.is_running and self._process is not None and self._process.stdin is not None:
            self._process.stdin.write(packed(message))

    def _stop_idling(self) -> None:
        if self._idle is not None:
            self._idle.cancel()
            self._idle = None

    def _stop_listening(self) -> None:
        if self._unlisten is not None:
            self._unlisten()
            self._unlisten = None

    def _end_idle(self) -> None:
        self._stop_listening()
        process, self._process = self._process, None
        if process is not None and process.stdin is not None:
            process.stdin.close()  # it ends when its input does


async def _last_line(stream: asyncio.StreamReader) -> str:
    """Reads to the end, so that nothing that is printed stops the process, and gives the last line."""
    tail = b""
    while piece := await stream.read(4096):
        tail = (tail + piece)[-4096:]
    lines = tail.decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else ""
