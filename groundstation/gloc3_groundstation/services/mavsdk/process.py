"""MAVSDK in its own process: exchanges frames and commands over pipes.

It is a process because the library is native code that can end or hang the program that it lives in: a call under way
when it is destroyed never returns and keeps asyncio from ending, and nothing in it can be cancelled (measured with 4.1).
A process can always be ended.

It runs as `python -m gloc3_groundstation.services.mavsdk.process SYSTEM COMPONENT`, and ends when its input does.
"""

import asyncio
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, Final

from gloc3_groundstation.services.mavsdk.messages import (
    LENGTH_BYTES,
    Act,
    Done,
    Failed,
    FromProcess,
    LinkReceived,
    LinkSent,
    Plugin,
    Ready,
    ToProcess,
    length_of,
    packed,
    to_process,
)

FIND_S: Final = 8.0
"""Longest time for the vehicle's heartbeat to come, s."""
_WORDS: Final = {
    "UNKNOWN": "MAVSDK does not say why",
    "NO_SYSTEM": "the vehicle is not heard",
    "BUSY": "another command is under way",
    "COMMAND_DENIED": "the vehicle refuses it",
    "COMMAND_DENIED_LANDED_STATE_UNKNOWN": "whether it has landed is not known",
    "COMMAND_DENIED_NOT_LANDED": "it has not landed",
    "TIMEOUT": "no answer",
    "PARAMETER_ERROR": "the take-off height cannot be set",
    "UNSUPPORTED": "this vehicle cannot do it",
    "FAILED": "it failed",
    "INVALID_ARGUMENT": "a value is not possible",
    "DENIED": "the vehicle refuses it",
    "NO_MISSION_AVAILABLE": "there is no plan on the vehicle",
    "ERROR": "the vehicle failed",
}


class MavsdkProcess:
    """Carries commands out on MAVSDK's asyncio face.

    Args:
        own: system and component as which it speaks: the station's.
        output: a file descriptor that takes what it says.
    """

    def __init__(self, own: tuple[int, int], output: int) -> None:
        from mavsdk import log_subscribe
        from mavsdk.asyncio import Configuration, Mavsdk

        log_subscribe(_swallow)
        self._output = output
        self._mavsdk = Mavsdk(Configuration.create_manual(*own, False))
        self._native = self._mavsdk._mavsdk  # its asyncio face has no raw connection
        self._plugins: dict[str, Any] = {}
        self._system: Any = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self, reader: asyncio.StreamReader) -> None:
        """Carries out what is asked for until nobody asks any more."""
        loop = asyncio.get_running_loop()
        self._native.subscribe_raw_bytes_to_be_sent(
            lambda data: loop.call_soon_threadsafe(self._send, LinkSent(bytes(data)))
        )
        await self._mavsdk.add_any_connection("raw://")
        self._send(Ready())
        with suppress(asyncio.IncompleteReadError):
            while True:
                head = await reader.readexactly(LENGTH_BYTES)
                self._handle(to_process.decode(await reader.readexactly(length_of(head))))

    def _handle(self, message: ToProcess) -> None:
        match message:
            case LinkReceived(data=data):
                self._native.pass_received_raw_bytes(data)
            case Act():
                task = asyncio.ensure_future(self._answer(message))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)

    async def _answer(self, act: Act) -> None:
        from mavsdk.plugins.action import ActionError
        from mavsdk.plugins.mission_raw import MissionRawError

        try:
            problem = await self._do(act)
        except (ActionError, MissionRawError) as error:
            problem = _WORDS.get(error.result.name, error.result.name.lower().replace("_", " "))
        self._send(Failed(act.number, problem) if problem else Done(act.number))

    async def _do(self, act: Act) -> str:
        """Carries one command out; returns why it cannot."""
        if self._system is None:
            self._system = await self._mavsdk.first_autopilot(FIND_S)
        if self._system is None:
            return "no heartbeat of its autopilot"
        name, _, method = act.plugin.value.partition(".")
        plugin, arguments = self._plugin(name), act.arguments
        if act.plugin is Plugin.TAKE_OFF:
            await plugin.set_takeoff_altitude(*arguments)
            arguments = ()
        await getattr(plugin, method)(*arguments)
        return ""

    def _plugin(self, name: str) -> Any:
        if name not in self._plugins:
            module = import_module(f"mavsdk.asyncio.plugins.{name}")
            kind = "".join(word.capitalize() for word in name.split("_")) + "Async"
            self._plugins[name] = getattr(module, kind)(self._system)
        return self._plugins[name]

    def _send(self, message: FromProcess) -> None:
        data = memoryview(packed(message))
        while data:
            data = data[os.write(self._output, data) :]


def _swallow(*log: Any) -> bool:
    """Takes what MAVSDK would else write to the standard output."""
    del log
    return True


async def _serve(own: tuple[int, int], output: int) -> None:
    reader = asyncio.StreamReader(limit=1 << 20)
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    await MavsdkProcess(own, output).run(reader)
    os._exit(0)  # an orderly end could wait for a call of the library that never returns


def main(arguments: Sequence[str]) -> None:
    """Serves until the input ends. What a library prints goes where errors go, not among the messages."""
    output = os.dup(1)
    os.dup2(2, 1)
    asyncio.run(_serve((int(arguments[0]), int(arguments[1])), output))


if __name__ == "__main__":
    main(sys.argv[1:])
