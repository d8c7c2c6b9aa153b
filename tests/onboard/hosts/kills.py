"""A patrol in which processes are killed at random: of the vehicle's two hosts, their children, and the station's."""

import asyncio
import os
import random
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from math import dist
from pathlib import Path
from typing import Final

from tests.commands.programs import Program, program
from tests.onboard.hosts.kills_told import HEIGHT_M, Kill, Report, measured
from tests.onboard.hosts.managed import Manager, children_of, managed
from tests.onboard.hosts.patrol import HOME, mission_state
from tests.onboard.real_vehicle import flights, station, until
from tests.stalls import Watch

from gloc3.mission.model.states import ENDED
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.platform.reader import whole_text
from gloc3_groundstation.station.station import Station
from gloc3_sitl.demo.demo import free_ports

A_DAY: Final = timedelta(days=1)
ROOT: Final = Path(__file__).parents[3]
NAME: Final = "patrol"
MAIN, SECOND, STATION = "vehicle", "second", "station"
CHILDREN: Final = {"vehicle/one": MAIN, "vehicle/looks": MAIN, "second/two": SECOND}
VICTIMS: Final = (MAIN, SECOND, STATION, *CHILDREN)
CORNERS: Final = ((4.0, 0.0), (4.0, 4.0), (0.0, 4.0), (0.0, 0.0))
MISSION: Final = """\
mission: patrol
frame: hold
geofence: {{polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}}
on_failure: hold
on_link_loss: continue
on_low_battery: land
on_pose_lost: continue
on_restart: continue
tasks:
  depart: {{actions: {{up: {{take_off: {{height_m: 1.5}}}}}}}}
  rounds:
    after: [depart]
    actions:
      way: {{follow_waypoints: {{waypoints_m: [{way}], speed_m_s: 0.8}}}}
  recover: {{after: [rounds], actions: {{down: {{land: {{}}}}}}}}
"""


def platform() -> str:
    """The Pelican's file, with pose and limiter twice: in a child of the first host, and on a second host, there the
    limiter in its main process; the viewer in another child. A battery that lasts.
    """
    text = whole_text("pelican_rtk")
    lines: list[str] = []
    for line in text.splitlines():
        if "{name: pose," in line:
            spare = line.replace("{name: pose,", "{name: pose_standby, host: second, process: two, begin: quiet, standby_for: pose,")  # fmt: skip
            spare = spare.replace("required: true, ", "").replace(", then: land", "")
            line = line.replace("then: land", "then: hold")
            lines += [line.replace("on_fault: {", "process: one, on_fault: {standby: pose_standby, "), spare]
        elif "{name: limiter," in line:
            lines.append(
                line.replace("{name: limiter,", "{name: limiter, process: one,").replace("then: land", "then: hold")
            )
        elif "{name: limiter_standby," in line:
            lines.append(line.replace("{name: limiter_standby,", "{name: limiter_standby, host: second,"))
        elif "{name: viewer," in line:
            lines.append(line.replace("{name: viewer,", "{name: viewer, process: looks,"))
        elif "  low_battery:" in line or line.startswith("failsafes:"):
            continue
        else:
            lines.append(line)
    changed = "\n".join(lines).replace("platform: pelican", f"platform: {NAME}").replace("times: 3", "times: 20").replace("battery_wh: 66.6, reserve: 0.2", "battery_wh: 666, reserve: 0")  # fmt: skip
    return changed.replace("components:\n", "hosts: {vehicle: {}, second: {on_loss: ignore}}\ncomponents:\n", 1) + "\n"


class Fleet:
    """Everything that runs and may be killed."""

    def __init__(self, managers: dict[str, Manager]) -> None:
        self.managers = managers

    def pid(self, victim: str) -> int | None:
        """The process that plays a part just now; None where it is away."""
        host = CHILDREN.get(victim, victim)
        process = self.managers[host].program.process
        if process.poll() is not None:
            return None
        return process.pid if victim == host else children_of(process.pid).get(victim.partition("/")[2])

    def kill(self, victim: str) -> bool:
        """Whether it was there, and is not any more."""
        pid = self.pid(victim)
        if pid is not None:
            os.kill(pid, signal.SIGKILL)
        return pid is not None

    @property
    def is_whole(self) -> bool:
        """Whether everybody is there."""
        return all(self.pid(victim) is not None for victim in VICTIMS)


@contextmanager
def _fleet(folder: Path, ground: int, watch: int) -> Iterator[tuple[Program, Fleet]]:
    (companion,) = free_ports(1, socket.SOCK_DGRAM)
    (meeting,) = free_ports(1, socket.SOCK_STREAM)
    now = datetime.now(UTC)
    register.found(folder / "net", "patrol", now, A_DAY)
    for host, listen in ((MAIN, [f"127.0.0.1:{meeting}"]), (SECOND, [])):
        entry = register.NetworkMember(role=MemberRole.PLATFORM, certificate="", until="", listen=listen)
        register.add(folder / "net", f"{NAME}.{host}", entry, now, A_DAY, is_renewed=False)
    link = f"companion=udpout://127.0.0.1:{companion}"
    words = {host: ["onboard", "platform.yaml", "--host", host, "--out", "out"] for host in (MAIN, SECOND)}
    for host, line in words.items():
        line += ["--network", f"net/{NAME}.{host}/network.yaml"]
    words[MAIN] += ["--autopilot", f"udpin://127.0.0.1:{companion}", "--station", f"udpout://127.0.0.1:{ground}"]
    words[MAIN] += ["--station", f"udpout://127.0.0.1:{watch}?role=observer"]
    operator = [f"udpin://127.0.0.1:{ground}", str(folder)]
    sitl = ("sitl", "--link", link, "--out", "truth", "--param", "COM_LOW_BAT_ACT=0")
    with (
        program(*sitl, folder=folder) as simulator,
        managed(words[MAIN], folder) as main,
        managed(words[SECOND], folder) as second,
        managed(operator, ROOT, module="tests.onboard.hosts.patrol") as commanding,
    ):
        yield simulator, Fleet({MAIN: main, SECOND: second, STATION: commanding})


async def fly(folder: Path, kills: Iterator[tuple[float, str]], count: int, report: Callable[[str], None]) -> Report:
    """Flies rounds until so many processes have been killed, then on until everybody is there again, and home.

    Args:
        folder: for everything that is written.
        kills: how long after the one before, and whose turn it is; one that is away just then is not waited for.
        count: how many.
        report: told how far it is.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "platform.yaml").write_text(platform())
    way = ", ".join(f"[{x}, {y}, {HEIGHT_M}]" for x, y in CORNERS * (1 + count))
    (folder / "mission.yaml").write_text(MISSION.format(way=way))
    killed: list[Kill] = []
    stalls = Watch()
    ground, watch = free_ports(2, socket.SOCK_DGRAM)
    with _fleet(folder, ground, watch) as (simulator, fleet):
        async with station(f"udpin://127.0.0.1:{watch}", 254) as watching:
            name = await flights.await_platform(watching, None)
            try:
                await until(lambda: mission_state(watching, name, "rounds") == "running", 60.0, "it flies")
            except AssertionError as error:
                error.add_note("\n".join(fleet.managers[STATION].lines[-20:]))
                raise
            begun_s = time.monotonic()
            stalls.start()
            while len(killed) < count and mission_state(watching, name) not in ENDED:
                pause_s, victim = next(kills)
                await asyncio.sleep(pause_s)
                now_s = time.monotonic()
                if await asyncio.to_thread(fleet.kill, victim):
                    killed.append(Kill(now_s, victim))
                    report(f"{len(killed)} of {count}: {victim}")
            await until(lambda: fleet.is_whole, 60.0, "everybody is there again")
            if mission_state(watching, name) not in ENDED:
                await _flies_on(watching, name)
                (folder / HOME).touch()
            await until(lambda: mission_state(watching, name) in ENDED, 120.0, "the mission ends")
            await until(lambda: not watching.fleet.get(name).is_armed, 60.0, "it stands")  # type: ignore[union-attr]
            end, elapsed_s = mission_state(watching, name), time.monotonic() - begun_s
        for part in (STATION, SECOND, MAIN):
            await asyncio.to_thread(fleet.managers[part].end)
        assert fleet.managers[MAIN].code == 0, fleet.managers[MAIN].lines[-20:]
        assert fleet.managers[SECOND].code == 0, fleet.managers[SECOND].lines[-20:]
        simulator.interrupt()
        await asyncio.to_thread(simulator.end)
        for part, manager in fleet.managers.items():
            (folder / f"{part}.txt").write_text("\n".join(manager.lines))
    return measured(folder, killed, end, elapsed_s, fleet.managers[STATION].lines, stalls.longest_s)


async def _flies_on(watching: Station, name: str) -> None:
    """Waits until the mission has gone on for half a metre."""

    def place_m() -> tuple[float, float, float]:
        found = watching.fleet.get(name)
        assert found is not None
        assert found.vehicle is not None
        return found.vehicle.value.position_m

    await until(lambda: mission_state(watching, name, "rounds") == "running", 60.0, "it flies on")
    at_m = place_m()
    await until(lambda: dist(place_m(), at_m) > 0.5, 30.0, "it gets somewhere")


def at_random(seed: int, pause_s: tuple[float, float]) -> Iterator[tuple[float, str]]:
    """Kills without end: each a while after the one before, whoever's turn it is."""
    chance = random.Random(seed)
    while True:
        yield chance.uniform(*pause_s), chance.choice(VICTIMS)
