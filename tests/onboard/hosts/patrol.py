"""The operator of a patrol, as a process that may be killed at any time: `python -m tests.onboard.hosts.patrol LINK FOLDER`.

It streams and starts the mission of the folder unless one is under way, says resume where that is paused for a while, and
meanwhile sends commands, each of them with a number of its own by which it is known again where it arrives. Once there
is a file `home` in the folder it has the rounds skipped. Each command is told on stdout, when it is sent and when it is
answered.
"""

import asyncio
import sys
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
from tests.flight.fleet_trial import Command
from tests.onboard.real_vehicle import flights, station, until

from gloc3.errors import Gloc3Error
from gloc3.messages.command_interface import CallFunction, Verb
from gloc3.mission.model.states import ENDED
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.command_client import Declined
from gloc3_groundstation.station.station import Station

SYSTEM = 255
HOME, RESUMED = "home", "resumed"
COMMANDED = ("ground_recorder", "viewer")
"""Whose rates it changes: one in the main process, one in a child."""
EVERY_S, TIMEOUT_S = 1.0, 2.0
START_ATTEMPTS = 30


def rate_hz() -> float:
    """A rate that no other command has, in this life or another: it follows the clock, in steps of 1 µHz a millisecond."""
    return round(5.0 + (time.monotonic_ns() // 1_000_000 % 10_000_000) * 1e-6, 6)


async def begin(operator: Station, name: str, text: str) -> None:
    """Streams a mission, and starts it as soon as the checks let it."""
    await flights.await_ready(operator, name)
    await flights.stream(operator, name, CheckedPlan(name="mission.yaml", title="patrol", text=text))
    for attempt in range(START_ATTEMPTS):
        try:
            await flights.start(operator, name)
        except Declined:  # the position, say, has only just come
            if attempt == START_ATTEMPTS - 1:
                raise
            await asyncio.sleep(1.0)
        else:
            return


def mission_state(watching: Station, name: str, task: str = "") -> str:
    """The state of the mission, or of a task of it; empty where none is known."""
    found = watching.fleet.get(name)
    reported = found.mission.value if found is not None and found.mission is not None else None
    return "" if reported is None else str(reported.tasks.get(task, "") if task else reported.state)


async def command(
    operator: Station, name: str, component: str, reported: Callable[[Command], None] = lambda _: None
) -> Command:
    """Gives a component a rate; tells of it when it is sent, and when it is answered."""
    sent = Command(operator.id, name, rate_hz())
    reported(sent)
    body = CallFunction(component=component, function="set_rate", arguments={"rate_hz": sent.rate_hz})
    reply = await operator.client.request(name, body)
    sent.outcome, sent.reason = str(reply.outcome), reply.reason
    reported(sent)
    return sent


def _report(what: Command | str) -> None:
    sys.stdout.write(msgspec.json.encode(what).decode() + "\n")
    sys.stdout.flush()


async def main(link: str, folder: Path) -> None:
    """One life of it."""
    async with station(link, SYSTEM) as operator:
        name = await flights.await_platform(operator, None)
        await until(lambda: operator.fleet.get(name).mission is not None, 60.0, "it tells of its mission")  # type: ignore[union-attr]
        if mission_state(operator, name) in ("", "waiting"):
            await begin(operator, name, (folder / "mission.yaml").read_text())
        commanding: set[asyncio.Task[Command]] = set()
        paused_s, turn = 0.0, 0
        while mission_state(operator, name) not in ENDED:
            await asyncio.sleep(EVERY_S)
            turn += 1
            task = asyncio.create_task(command(operator, name, COMMANDED[turn % len(COMMANDED)], _report))
            commanding.add(task)
            task.add_done_callback(commanding.discard)
            paused_s = paused_s + EVERY_S if mission_state(operator, name) == "paused" else 0.0
            try:
                if paused_s >= TIMEOUT_S:
                    await operator.client.steer(name, Verb.RESUME)
                    _report(RESUMED)
                elif (folder / HOME).exists() and mission_state(operator, name, "rounds") == "running":
                    await operator.client.steer(name, Verb.SKIP, "rounds")
            except Gloc3Error:  # it is not there, or goes on just now
                continue
        await asyncio.gather(*commanding)
        await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], Path(sys.argv[2])))
