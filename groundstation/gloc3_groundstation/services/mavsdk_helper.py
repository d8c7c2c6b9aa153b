"""MAVSDK in its own process: exchanges frames and requests over pipes.

It is a process because the library is native code that can end or hang the program that it lives in: a call under way
when it is destroyed never returns and keeps asyncio from ending, `CalibrationAsync.cancel` and `get_all_params` can
block for good (measured with 4.1), and nothing in it can be cancelled. A process can always be ended.

It runs as `python -m gloc3_groundstation.services.mavsdk_helper SYSTEM COMPONENT`, and ends when its input does.
"""

import asyncio
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

from gloc3.errors import Gloc3Error
from gloc3.mavlink.services.plan import PlanItem, PlanType
from gloc3_groundstation.services.helper_messages import (
    LENGTH_BYTES,
    Advanced,
    Done,
    DownloadPlan,
    Failed,
    FromHelper,
    LinkReceived,
    LinkSent,
    Ready,
    ToHelper,
    UploadPlan,
    length_of,
    packed,
    to_helper,
)

FIND_S: Final = 12.0
"""How long the vehicle's heartbeat may take to come."""
_WORDS: Final = {
    "TIMEOUT": "no answer",
    "DENIED": "the vehicle accepts no plan from us now",
    "UNSUPPORTED": "an item's command or frame, or this type of plan, is not supported",
    "INVALID_ARGUMENT": "an item has an invalid value",
    "TOO_MANY_MISSION_ITEMS": "the plan has too many items",
    "BUSY": "another transfer is under way",
    "INVALID_SEQUENCE": "an item came out of sequence",
    "PROTOCOL_ERROR": "the vehicle broke the protocol",
    "ERROR": "the vehicle failed",
}


class HelperError(Gloc3Error):
    """A request that cannot be done; the text is the reason."""


class Helper:
    """The requests, on MAVSDK's asyncio face.

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
        self._plugin: Any = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self, reader: asyncio.StreamReader) -> None:
        """Does what is asked for until nobody asks any more."""
        loop = asyncio.get_running_loop()
        self._native.subscribe_raw_bytes_to_be_sent(
            lambda data: loop.call_soon_threadsafe(self._send, LinkSent(bytes(data)))
        )
        await self._mavsdk.add_any_connection("raw://")
        self._send(Ready())
        with suppress(asyncio.IncompleteReadError):
            while True:
                head = await reader.readexactly(LENGTH_BYTES)
                self._handle(to_helper.decode(await reader.readexactly(length_of(head))))

    def _handle(self, message: ToHelper) -> None:
        match message:
            case LinkReceived(data=data):
                self._native.pass_received_raw_bytes(data)
            case UploadPlan() | DownloadPlan():
                task = asyncio.ensure_future(self._answer(message))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)

    async def _answer(self, request: UploadPlan | DownloadPlan) -> None:
        from mavsdk.plugins.mission_raw import MissionRawError

        try:
            plugin = await self._mission()
            if isinstance(request, UploadPlan):
                await self._upload(plugin, request)
                self._send(Done(request.number))
            else:
                self._send(Done(request.number, await self._download(plugin, request.kind)))
        except MissionRawError as error:
            name = error.result.name
            self._send(Failed(request.number, _WORDS.get(name, name.lower().replace("_", " "))))
        except HelperError as error:
            self._send(Failed(request.number, str(error)))

    async def _mission(self) -> Any:
        from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync

        if self._plugin is None:
            system = await self._mavsdk.first_autopilot(FIND_S)
            if system is None:
                raise HelperError("no heartbeat of an autopilot as component 1")
            self._plugin = MissionRawAsync(system)
        return self._plugin

    async def _upload(self, plugin: Any, request: UploadPlan) -> None:
        from mavsdk.plugins.mission_raw import MissionPlan

        items = [_to_mavsdk(number, item, request.kind) for number, item in enumerate(request.items)]
        match request.kind:
            case PlanType.FENCE:
                await plugin.upload_geofence(items)
            case PlanType.RALLY:
                await plugin.upload_rally_points(items)
            case _:
                async for _, data in plugin.upload_mission_with_progress(MissionPlan(items)):
                    if data.progress == data.progress:
                        self._send(Advanced(request.number, float(data.progress)))

    @staticmethod
    async def _download(plugin: Any, kind: int) -> tuple[PlanItem, ...]:
        match kind:
            case PlanType.FENCE:
                items = await plugin.download_geofence()
            case PlanType.RALLY:
                items = await plugin.download_rallypoints()
            case _:
                items = await plugin.download_mission()
        return tuple(_from_mavsdk(item) for item in items)

    def _send(self, message: FromHelper) -> None:
        data = memoryview(packed(message))
        while data:
            data = data[os.write(self._output, data) :]


def _swallow(*log: Any) -> bool:
    """Takes what MAVSDK would else write to the standard output."""
    del log
    return True


def _to_mavsdk(number: int, item: PlanItem, kind: int) -> Any:
    from mavsdk.plugins.mission_raw import MissionItem

    return MissionItem(
        seq=number,
        frame=item.frame,
        command=item.command,
        current=int(number == 0),  # MAVSDK takes no plan whose first item is not the current one
        autocontinue=int(item.autocontinue),
        param1=item.param1,
        param2=item.param2,
        param3=item.param3,
        param4=item.param4,
        x=item.x,
        y=item.y,
        z=item.z,
        mission_type=kind,
    )


def _from_mavsdk(item: Any) -> PlanItem:
    return PlanItem(
        command=item.command,
        frame=item.frame,
        is_current=item.current == 1,
        autocontinue=item.autocontinue != 0,
        param1=item.param1,
        param2=item.param2,
        param3=item.param3,
        param4=item.param4,
        x=item.x,
        y=item.y,
        z=item.z,
    )


async def _serve(own: tuple[int, int], output: int) -> None:
    reader = asyncio.StreamReader(limit=1 << 20)
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    await Helper(own, output).run(reader)
    os._exit(0)  # an orderly end could wait for a call of the library that never returns


def main(arguments: Sequence[str]) -> None:
    """Serves until the input ends. What a library prints goes where errors go, not among the messages."""
    output = os.dup(1)
    os.dup2(2, 1)
    asyncio.run(_serve((int(arguments[0]), int(arguments[1])), output))


if __name__ == "__main__":
    main(sys.argv[1:])
