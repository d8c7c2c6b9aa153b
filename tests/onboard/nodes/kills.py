"""A flight in which processes of the onboard side are killed at random; who restarts the main one is a few lines here."""

import asyncio
import os
import random
import signal
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from math import inf
from pathlib import Path
from threading import Event, Thread
from typing import Final

import msgspec
from tests.commands.programs import Program, program
from tests.onboard.real_vehicle import flights, station, until

import gloc3_onboard.platforms
from gloc3.ci import Verb
from gloc3.errors import Gloc3Error
from gloc3.lci import OPERATING, State
from gloc3.log.reader import LogReader
from gloc3.messages import ComponentStatus
from gloc3.topics import TopicTable
from gloc3_groundstation.command_client import Declined
from gloc3_groundstation.plans import Plan
from gloc3_groundstation.station import Station
from gloc3_sitl.demo import free_ports
from gloc3_sitl.flight_messages import TOPICS

START_ATTEMPTS: Final = 30
MAIN: Final = "main"
CHILDREN: Final = ("one", "two", "looks")
STANDBYS: Final = {
    "pose": "pose_standby",
    "pose_standby": "pose",
    "limiter": "limiter_standby",
    "limiter_standby": "limiter",
}
HEIGHT_M: Final = 1.5
MISSION: Final = """\
mission: round and round
frame: hold
geofence: {{polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}}
on_failure: land
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
CORNERS: Final = ((4.0, 0.0), (4.0, 4.0), (0.0, 4.0), (0.0, 0.0))


def platform() -> str:
    """The Pelican's file, with the pose and the limiter twice in processes of their own, and the viewer in a third."""
    text = (Path(gloc3_onboard.platforms.__path__[0]) / "pelican_rtk.yaml").read_text()
    lines: list[str] = []
    for line in text.splitlines():
        if "{name: pose," in line:
            spare = line.replace("{name: pose,", "{name: pose_standby, process: two, begin: quiet, standby_for: pose,")
            spare = spare.replace("required: true, ", "").replace(", then: land", "")
            lines += [line.replace("on_fault: {", "process: one, on_fault: {standby: pose_standby, "), spare]
        elif "{name: limiter," in line:
            lines.append(line.replace("{name: limiter,", "{name: limiter, process: one,"))
        elif "{name: limiter_standby," in line:
            lines.append(line.replace("{name: limiter_standby,", "{name: limiter_standby, process: two,"))
        elif "{name: viewer," in line:
            lines.append(line.replace("{name: viewer,", "{name: viewer, process: looks,"))
        else:
            lines.append(line)
    return "\n".join(lines).replace("times: 3", "times: 20") + "\n"


class Report(msgspec.Struct, frozen=True):
    """How it went."""

    kills: dict[str, int]
    """By process."""
    mission: str
    """How it ended."""
    took_s: float
    lowest_m: float
    """Height between the end of the take-off and the begin of the landing."""
    highest_m: float
    farthest_m: float
    """From the ways between the corners, over ground."""
    fastest_m_s: float
    most_back_m: float
    """How far it flew back along its way at most."""
    resumed: int
    """How often the operator had to say resume, since the autopilot had acted by itself on a computer without time."""
    logs: int
    unreadable: list[str]
    most_lost_s: float
    """Longest time before a kill of which the main process's log tells nothing."""
    longest_away_s: float
    """Longest time without a summary of the command interface."""
    noticed_s: list[float]
    """From the kill of a child to the first status that says so, of each; without those that were beginning."""
    taken_over_s: list[float]
    """From there to the standby's work, of each."""


class Manager:
    """Starts the onboard process, and starts it again whenever it ends."""

    def __init__(self, arguments: list[str], folder: Path, before: Sequence[str]) -> None:
        self._arguments, self._folder, self._before = arguments, folder, before
        self._is_over = Event()
        self.program = Program(arguments, folder, before)
        self.said: list[str] = []
        self.code: int | None = None
        """Of the last one's end."""
        self._thread = Thread(target=self._keep, daemon=True)
        self._thread.start()

    def _keep(self) -> None:
        while True:
            self.program.process.wait()
            code = self.program.end()
            self.said += self.program.lines
            self.program.close()
            if self._is_over.is_set():
                self.code = code
                return
            self.program = Program(self._arguments, self._folder, self._before)

    def end(self) -> None:
        self._is_over.set()
        self.program.interrupt(signal.SIGTERM)
        self._thread.join(30.0)

    def kill(self) -> None:
        self._is_over.set()
        if self.program.process.poll() is None:
            self.program.interrupt(signal.SIGKILL)
        self._thread.join(30.0)


@contextmanager
def managed(arguments: list[str], folder: Path, before: Sequence[str] = ()) -> Iterator[Manager]:
    manager = Manager(arguments, folder, before)
    try:
        yield manager
    finally:
        manager.kill()


def children_of(pid: int) -> dict[str, int]:
    """The child processes of an onboard process, by name."""
    found = {}
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            arguments = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if parent == pid and b"gloc3_onboard.nodes.child_main" in arguments:
            found[arguments[-2].decode().rpartition("/")[2]] = int(folder.name)
    return found


async def begin(operator: Station, name: str) -> None:
    """Starts the mission as soon as the checks let it."""
    for _ in range(START_ATTEMPTS):
        try:
            await flights.start(operator, name)
        except Declined:  # the position, say, has only just come
            await asyncio.sleep(1.0)
        else:
            return
    await flights.start(operator, name)


def is_disarmed(operator: Station, name: str) -> bool:
    """Whether the vehicle is known to stand."""
    found = operator.fleet.get(name)
    return found is not None and found.vehicle is not None and not found.vehicle.value.is_armed


async def attend(operator: Station, name: str, is_paused: Callable[[], bool], resumed: list[float]) -> None:
    """Says resume when the mission has been paused for a while."""
    while True:
        await asyncio.sleep(2.0)
        if not is_paused():
            continue
        await asyncio.sleep(2.0)
        try:
            if is_paused():
                await operator.client.steer(name, Verb.RESUME)
                resumed.append(time.monotonic())
        except Gloc3Error:  # it is not there, or goes on just now
            continue


async def fly(
    folder: Path,
    victims: Sequence[str],
    seed: int,
    pause_s: tuple[float, float],
    say: Callable[[str], None],
) -> Report:
    """Flies rounds until so many processes have been killed and the mission has ended.

    Args:
        folder: for everything that is written.
        victims: whose turn it is; one that is away just then is not waited for.
        seed: of when.
        pause_s: least and longest time between two kills.
        say: told how far it is.
    """
    chance = random.Random(seed)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "platform.yaml").write_text(platform())
    legs = max(2, round(len(victims) * sum(pause_s) / 2.0 * 0.55 / 4.0))
    way = ", ".join(f"[{x}, {y}, {HEIGHT_M}]" for x, y in (CORNERS * legs)[:legs])
    mission = MISSION.format(way=way)
    companion, ground = free_ports(2, socket.SOCK_DGRAM)
    onboard = ["onboard", "platform.yaml", "--autopilot", f"udpin://127.0.0.1:{companion}", "--out", "out"]
    onboard += ["--station", f"udpout://127.0.0.1:{ground}"]
    link = f"companion=udpout://127.0.0.1:{companion}"
    killed: list[tuple[float, str]] = []
    resumed: list[float] = []
    with program("sitl", "--link", link, "--out", "truth", folder=folder) as sitl, managed(onboard, folder) as manager:
        async with station(f"udpin://127.0.0.1:{ground}", 255) as operator:
            name = await flights.await_platform(operator, None)
            assert not await flights.await_ready(operator, name)
            await flights.stream(operator, name, Plan(name="mission.yaml", title="round and round", text=mission))
            await begin(operator, name)

            def state(target: str) -> str:
                found = operator.fleet.get(name)
                told = found.mission if found is not None else None
                if told is None:
                    return ""
                return str(told.value.state if target == "mission" else told.value.tasks.get(target, ""))

            await until(lambda: state("rounds") == "running", 60.0, "it flies")
            begun_s = time.monotonic()
            attending = asyncio.create_task(attend(operator, name, lambda: state("mission") == "paused", resumed))
            for victim in victims:
                await asyncio.sleep(chance.uniform(*pause_s))
                if state("mission") in ("done", "failed"):
                    break
                main = manager.program.process
                pid = main.pid if victim == MAIN else children_of(main.pid).get(victim)
                if pid is None or main.poll() is not None:
                    continue
                os.kill(pid, signal.SIGKILL)
                killed.append((time.monotonic(), victim))
                say(f"{len(killed)} of {len(victims)}: {victim}")
            await until(lambda: state("mission") in ("done", "failed"), 600.0, "the mission ends")
            attending.cancel()
            await until(lambda: is_disarmed(operator, name), 60.0, "it has landed")
            end, took_s = state("mission"), time.monotonic() - begun_s
        await asyncio.to_thread(manager.end)
        assert manager.code == 0, manager.said
        sitl.interrupt()
        await asyncio.to_thread(sitl.end)
        (folder / "said.txt").write_text("\n".join(manager.said))
    return _measured(folder, killed, end, took_s, len(resumed))


def _measured(folder: Path, killed: list[tuple[float, str]], end: str, took_s: float, resumed: int) -> Report:
    unreadable, summaries_s, ends_s = [], [], []
    noticed_s: list[float] = []
    taken_over_s: list[float] = []
    logs = sorted((folder / "out").glob("log*.mcap"), key=lambda path: path.stat().st_mtime)
    for path in logs:
        with LogReader(path) as reader:
            entries = list(reader.entries())
        if not entries:
            unreadable.append(path.name)
            continue
        if path.stem.removeprefix("log-main-").removeprefix("log-main").isdecimal() or path.stem == "log-main":
            summaries_s += [e.envelope.t_s for e in entries if e.envelope.topic.endswith("/ci/summary")]
            ends_s.append(max(e.now_s for e in entries))
            statuses = [(e.now_s, e.envelope.payload) for e in entries if e.envelope.topic.endswith("/status")]
            _look_at_faults(statuses, killed, noticed_s, taken_over_s)
    with LogReader(folder / "truth" / "truth.mcap", TopicTable(TOPICS).types) as reader:
        truth = [(e.envelope.t_s, e.envelope.payload) for e in reader.entries()]
    truth = [(t_s, one) for t_s, one in truth if hasattr(one, "position_ned_m")]
    floor_m = -truth[0][1].position_ned_m[2]
    heights = [-one.position_ned_m[2] - floor_m for _, one in truth]
    up = next(i for i, height in enumerate(heights) if height > HEIGHT_M - 0.1)
    down = max(i for i, height in enumerate(heights) if height > HEIGHT_M - 0.2)
    flown = truth[up : down + 1]
    mains_s = [t_s for t_s, name in killed if name == MAIN]
    next_kills = [min((t_s for t_s in mains_s if t_s >= end_s), default=end_s) for end_s in ends_s]
    lost = [kill_s - end_s for kill_s, end_s in zip(next_kills, ends_s, strict=True)]
    summaries_s.sort()
    return Report(
        kills=dict(Counter(name for _, name in killed)),
        mission=end,
        took_s=round(took_s, 1),
        lowest_m=round(min(heights[up : down + 1]), 2),
        highest_m=round(max(heights), 2),
        farthest_m=round(max(_away_m(one.position_ned_m) for _, one in flown), 2),
        fastest_m_s=round(max(max(abs(v) for v in one.velocity_ned_m_s) for _, one in flown), 2),
        most_back_m=round(_most_back_m([one.position_ned_m for _, one in flown]), 2),
        resumed=resumed,
        logs=len(logs),
        unreadable=unreadable,
        most_lost_s=round(max(lost, default=0.0), 2),
        longest_away_s=round(max((b - a for a, b in pairwise(summaries_s)), default=0.0), 2),
        noticed_s=noticed_s,
        taken_over_s=taken_over_s,
    )


def _look_at_faults(
    statuses: list[tuple[float, ComponentStatus]],
    killed: list[tuple[float, str]],
    noticed_s: list[float],
    taken_over_s: list[float],
) -> None:
    """How soon the ends of children were seen in one life of the main process, and their standbys at work."""
    known: dict[str, State | None] = {}
    for now_s, status in statuses:
        was, known[status.name] = known.get(status.name), status.state
        if status.state is not State.FAULTY or was not in OPERATING:
            continue
        kills_s = [t_s for t_s, name in killed if f"process {name} ended" in status.cause and t_s <= now_s]
        if not kills_s:
            continue
        noticed_s.append(round(now_s - max(kills_s), 3))
        other = STANDBYS.get(status.name)
        if was is State.WORKING and other is not None and known.get(other) is State.QUIET:
            up_s = (t_s for t_s, one in statuses if t_s >= now_s and one.name == other and one.state is State.WORKING)
            taken_over_s.append(round(next(up_s, inf) - now_s, 3))


def _away_m(place: tuple[float, float, float]) -> float:
    """How far a place is from the box's sides, over ground; x is north, y to the left of it."""
    x, y = place[0], -place[1]
    outside = max(-x, x - 4.0, -y, y - 4.0)
    return outside if outside > 0.0 else min(x, 4.0 - x, y, 4.0 - y)


def _along_m(place: tuple[float, float, float]) -> float:
    """How far along the box's sides a place is, 0 to 16 m."""
    x, y = min(4.0, max(0.0, place[0])), min(4.0, max(0.0, -place[1]))
    _, along = min((y, x), (4.0 - x, 4.0 + y), (4.0 - y, 12.0 - x), (x, 16.0 - y))
    return along


def _most_back_m(places: Sequence[tuple[float, float, float]]) -> float:
    """How far behind the farthest place along the rounds a later one was at most."""
    total = farthest = most = 0.0
    for before, after in pairwise(map(_along_m, places)):
        total += (after - before + 8.0) % 16.0 - 8.0
        farthest = max(farthest, total)
        most = max(most, farthest - total)
    return most
