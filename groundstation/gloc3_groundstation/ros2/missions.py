"""Services of ROS 2 that command the missions of vehicles, with the rights of this station.

`/PLATFORM/mission/start`, `pause`, `resume`, `abort` and `state`, all `std_srvs/srv/Trigger`: what is refused has
`success: false` and the reason as its message.
"""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

from gloc3.errors import Gloc3Error
from gloc3.mission.model.states import ActionState
from gloc3.ros2.messages import RosMessage
from gloc3.ros2.node import RosNode
from gloc3_groundstation.api import ScriptVehicle
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.station.snapshots import PlatformSnapshot

READY_S: Final = 10.0
"""Time for a vehicle to be ready for a start, s."""
TRIGGER: Final = "std_srvs/Trigger"
Respond = Callable[[RosMessage], None]


class MissionServices:
    """The services of all vehicles of a station.

    Args:
        desk: commands the vehicles.
        node: in the graph of ROS 2.
        mission: is uploaded before each start; None to start the loaded one.
    """

    def __init__(self, desk: Desk, node: RosNode, mission: Path | None) -> None:
        self._desk, self._node, self._mission = desk, node, mission
        self._loop = asyncio.get_running_loop()
        self._offered: set[str] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    def offer(self, platform: PlatformSnapshot) -> None:
        """Offers the services of a vehicle, once; one without a companion has no missions."""
        if platform.name in self._offered or not platform.has_companion:
            return
        self._offered.add(platform.name)
        vehicle = ScriptVehicle(self._desk, platform.name)

        async def start() -> str:
            if self._mission is not None:
                await vehicle.upload(self._mission)
            await vehicle.start(wait_s=READY_S)
            return "the mission is started"

        async def pause() -> str:
            await vehicle.pause()
            return "the mission is paused"

        async def resume() -> str:
            await vehicle.resume()
            return "the mission is resumed"

        async def abort() -> str:
            await vehicle.abort()
            return "the mission is aborted"

        for name, work in (("start", start), ("pause", pause), ("resume", resume), ("abort", abort)):
            self._serve(f"/{platform.name}/mission/{name}", work)

        def state(request: Any, respond: Respond) -> None:
            del request
            self._loop.call_soon_threadsafe(lambda: respond(_state(self._desk.station.fleet.get(platform.name))))

        self._node.serve(f"/{platform.name}/mission/state", TRIGGER, state)

    def close(self) -> None:
        """Carries nothing further out."""
        for task in self._tasks:
            task.cancel()

    def _serve(self, service: str, work: Callable[[], Awaitable[str]]) -> None:
        async def carry_out(respond: Respond) -> None:
            try:
                response = {"success": True, "message": await work()}
            except Gloc3Error as error:
                response = {"success": False, "message": str(error)}
            respond(response)

        def begin(respond: Respond) -> None:
            task = self._loop.create_task(carry_out(respond))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

        def handle(request: Any, respond: Respond) -> None:
            del request
            self._loop.call_soon_threadsafe(begin, respond)

        self._node.serve(service, TRIGGER, handle)


def _state(platform: PlatformSnapshot | None) -> RosMessage:
    """The mission's state: a success while it runs."""
    mission = None if platform is None or platform.mission is None else platform.mission.value
    if mission is None or not mission.state:
        return {"success": False, "message": "no mission is loaded"}
    tasks = [state for target, state in mission.tasks.items() if "." not in target]
    done = sum(state == ActionState.DONE for state in tasks)
    is_running = mission.state == ActionState.RUNNING
    reason = f" ({mission.reason})" if mission.reason and not is_running else ""
    text = f"{mission.state}: {mission.name}, {done} of {len(tasks)} tasks done{reason}"
    return {"success": is_running, "message": text}
