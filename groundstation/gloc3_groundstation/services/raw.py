"""MAVSDK behind the station's own link: it receives one vehicle's frames, and sends in the station's name.

The station owns each link once. MAVSDK therefore has no socket: a process of its own (see `mavsdk_helper`) gets the
frames that its services need, under the station's ids, and its frames are numbered (and signed, where the link is) by
the station's encoder. Its heartbeats end here, so that exactly one station heartbeat leaves; so do the questions that
it asks on its own account, up to four a second, which a radio can do without.
"""

import asyncio
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.codec import Frame, Parser, shape
from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.plan import PlanItem, PlanResult, PlanType
from gloc3_groundstation.services.helper_call import STALLED_S, HelperCall, last_line
from gloc3_groundstation.services.helper_messages import (
    LENGTH_BYTES,
    Advanced,
    Done,
    DownloadPlan,
    Failed,
    FromHelper,
    LinkReceived,
    LinkSent,
    PipeError,
    Ready,
    ToHelper,
    UploadPlan,
    from_helper,
    length_of,
    packed,
)
from gloc3_groundstation.services.machines import Wire

START_S: Final = 20.0
"""How long the process may take to begin."""
IDLE_S: Final = 120.0
"""A process that nobody has asked for anything for so long is ended; the next request begins another."""
RECEIVED_MESSAGES: Final = (
    "HEARTBEAT",
    "AUTOPILOT_VERSION",
    "COMMAND_ACK",
    "MISSION_REQUEST_INT",
    "MISSION_REQUEST",
    "MISSION_ACK",
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_CURRENT",
)
"""What MAVSDK is told; telemetry would only cost."""
SENT: Final = (
    "MISSION_COUNT",
    "MISSION_REQUEST_LIST",
    "MISSION_REQUEST_INT",
    "MISSION_ITEM_INT",
    "MISSION_ACK",
    "MISSION_CLEAR_ALL",
)
"""What may leave; all else that MAVSDK sends it sends on its own account."""


class MavsdkBehindLink:
    """MAVSDK for one vehicle; begun when it is first asked for something, and always ended by `close`."""

    def __init__(self, wire: Wire, target: Address) -> None:
        self.dropped = 0
        """Frames of MAVSDK that did not leave: its heartbeats and its own questions."""
        self.starts = 0
        """How often the process was begun."""
        self._wire = wire
        self._target = target
        self._received_ids = frozenset(shape(name).id for name in RECEIVED_MESSAGES)
        self._sent_ids = frozenset(shape(name).id for name in SENT)
        self._parser = Parser(is_datagram=True)
        self._process: asyncio.subprocess.Process | None = None
        self._reading: asyncio.Task[None] | None = None
        self._ready: asyncio.Future[None] | None = None
        self._calls: dict[int, HelperCall] = {}
        self._number = 0
        self._lock = asyncio.Lock()
        self._unlisten: Callable[[], object] | None = None
        self._idle: asyncio.TimerHandle | None = None
        self._is_open = True

    @property
    def is_running(self) -> bool:
        """Whether its process runs."""
        return self._process is not None and self._process.returncode is None

    async def upload(
        self, kind: PlanType, items: tuple[PlanItem, ...], on_fraction: Callable[[float], None] | None = None
    ) -> None:
        """Gives the vehicle a plan that is not empty.

        Raises:
            Refused: the vehicle does not take it, or does not answer; with the reason.
        """
        await self._request(lambda number: UploadPlan(number, kind, items), kind, on_fraction)

    async def download(self, kind: PlanType) -> tuple[PlanItem, ...]:
        """Gets the vehicle's plan.

        Raises:
            Refused: the vehicle does not answer; with the reason.
        """
        return await self._request(lambda number: DownloadPlan(number, kind), kind, None)

    async def close(self) -> None:
        """Ends the process; who waits is refused."""
        self._is_open = False
        await self._end("the services of this vehicle are closed")

    async def _request(
        self,
        request: Callable[[int], ToHelper],
        kind: PlanType,
        on_fraction: Callable[[float], None] | None,
    ) -> tuple[PlanItem, ...]:
        """Asks one thing after the other; a request that is cancelled or stalls takes the process with it."""
        async with self._lock:
            self._stop_idling()
            await self._start()
            self._number += 1
            call = self._calls[self._number] = HelperCall(on_fraction)
            self._send(request(self._number))
            try:
                return await call.wait()
            except TimeoutError:
                await self._end("MAVSDK hangs")
                raise Refused(f"no answer within {STALLED_S:.0f} s") from None
            except asyncio.CancelledError:
                await self._end("cancelled")
                self._give_up(kind)
                raise
            finally:
                self._calls.pop(self._number, None)
                if self._is_open and self.is_running:
                    self._idle = asyncio.get_running_loop().call_later(IDLE_S, self._end_idle)

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
        self.starts += 1
        self._process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "gloc3_groundstation.services.mavsdk_helper"),
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
        for call in self._calls.values():
            call.fail(reason)
        if self._ready is not None and not self._ready.done():
            self._ready.set_exception(Refused(reason))
        process, self._process = self._process, None
        reading, self._reading = self._reading, None
        if process is not None:
            with suppress(ProcessLookupError):
                process.kill()
            if process.stdin is not None:
                process.stdin.close()
        if reading is not None:
            await reading  # it ends with the process, which it waits for

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        """Takes what the process says until it ends."""
        assert process.stdout is not None
        assert process.stderr is not None
        complaints = asyncio.ensure_future(last_line(process.stderr))
        problem = ""
        try:
            while True:
                head = await process.stdout.readexactly(LENGTH_BYTES)
                self._handle(from_helper.decode(await process.stdout.readexactly(length_of(head))))
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
            on_error = f"MAVSDK has ended: {reason}"
            for call in self._calls.values():
                call.fail(on_error)
            if self._ready is not None and not self._ready.done():
                self._ready.set_exception(Refused(on_error))

    def _handle(self, message: FromHelper) -> None:
        match message:
            case LinkSent(data=data):
                for frame in self._parser.receive(data):
                    if frame.message_id in self._sent_ids and frame.sender == self._wire.own:
                        self._wire.forward(frame)
                    else:
                        self.dropped += 1
            case Ready():
                if self._ready is not None and not self._ready.done():
                    self._ready.set_result(None)
            case Advanced(number=number, fraction=fraction) if number in self._calls:
                self._calls[number].advance(fraction)
            case Done(number=number, items=items) if number in self._calls:
                self._calls[number].finish(items)
            case Failed(number=number, reason=reason) if number in self._calls:
                self._calls[number].fail(reason)

    def _receive_frame(self, frame: Frame) -> None:
        if frame.sender == self._target and frame.message_id in self._received_ids:
            self._send(LinkReceived(frame.raw))
            for call in self._calls.values():
                call.received(is_transfer=frame.message_id != 0)

    def _send(self, message: ToHelper) -> None:
        if self.is_running and self._process is not None and self._process.stdin is not None:
            self._process.stdin.write(packed(message))

    def _give_up(self, kind: PlanType) -> None:
        """Tells the vehicle that the transfer ends here; it keeps the plan that it had."""
        system, component = self._target
        fields = {"target_system": system, "target_component": component}
        self._wire.send(make("MISSION_ACK", type=PlanResult.CANCELLED, mission_type=kind, **fields))

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
        process = self._process
        if process is not None and process.stdin is not None:
            process.stdin.close()  # it ends when its input does
