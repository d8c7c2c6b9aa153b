"""How a network grows: vehicles that send real traffic, routers, and stations, as processes; bytes, processor, latency.

A vehicle is a process, or where there are many a session in one, with a certificate of its own; it publishes again what a
vehicle in flight has published for its stations. Routers and stations are what users run.
"""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple

import msgspec
from tests.bare_loop import bare_loop
from tests.commands.programs import Program, program
from tests.common.network.yard import LONG, NOW

from gloc3.clock import monotonic_s
from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.zenoh import open_exchange
from gloc3.log.reader import LogReader
from gloc3.messages.envelope import Message
from gloc3.messages.topics import TopicTable
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.file import read_network
from gloc3.network.stations import join_platforms

ROOT: Final = Path(__file__).parents[3]
FLAT, ROUTER, TREE, WATCHED = "flat", "one router", "tree", "tree, one vehicle watched"
LAYOUTS: Final = (FLAT, ROUTER, TREE, WATCHED)
RECORDING: Final = ROOT / "tests" / "data" / "log-of-0.1" / "log.mcap"
"""Of a flight of `pelican_rtk`: take off, hold, land."""
ADDRESSED: Final = ("/request", "/reply")
"""Topics that not all stations receive."""
FIRST_PORT: Final = 21_000
"""Below those that the kernel gives to connections: of hundreds that are free, some would soon be taken."""
GOLDEN: Final = 0.618
"""Spreads any number of vehicles over the time of the recording."""
LATE_S: Final = 1.0
"""What is later is skipped."""
CONNECTION: Final = re.compile(r"ESTAB +\d+ +\d+ +(?P<own>\S+) +(?P<other>\S+) .*?pid=(?P<process>\d+)")
"""A line of `ss`."""
SETTLE_S: Final = 3.0
FOUND_WITHIN_S: Final = 60.0
PROCESSES: Final = 50
"""So many vehicles are each a process."""
IN_A_PROCESS: Final = 10
"""So many are in a process where there are more."""


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """One network."""

    layout: str
    vehicles: int
    stations: int
    seconds: float = 8.0


class StationReport(msgspec.Struct, frozen=True, kw_only=True):
    """What a station measures."""

    found_s: float | None
    """Until it has heard all vehicles that it receives, s; None if it has not within `FOUND_WITHIN_S`."""
    messages_s: float
    latency_p50_s: float
    latency_p99_s: float


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """One network, measured."""

    scene: Scene
    station_bytes_s: float
    """Received by a station, on average."""
    vehicle_bytes_s: float
    """Sent by a vehicle, on average."""
    station_cpu: float
    """Share of a core."""
    vehicle_cpu: float
    router_cpu: float
    """Of the busiest router; 0 without."""
    latency_p50_s: float
    """Of the middle station."""
    latency_p99_s: float
    """Of the worst station."""
    bare_p99_s: float
    """How late a loop that does nothing was on this computer in the same time."""
    found_s: float | None
    """Of the last station; None if one has not found all."""


def made(folder: Path, scene: Scene) -> None:
    """The network's files."""
    yard = folder / "yard"
    register.found(yard, "yard", NOW, LONG)

    def add(name: str, role: MemberRole, **fields: Any) -> None:
        entry = register.NetworkMember(role=role, certificate="", until="", **fields)
        register.add(yard, name, entry, NOW, LONG, is_renewed=False)

    ports = iter(range(FIRST_PORT, FIRST_PORT + scene.vehicles + len(LAYOUTS)))
    for router in routers_of(scene):
        uplinks = {"left": ["root"], "right": ["root"]}.get(router, [])
        add(router, MemberRole.ROUTER, listen=[f"127.0.0.1:{next(ports)}"], to=uplinks)
    for number in range(scene.vehicles):
        if scene.layout == FLAT:
            add(f"v{number}.main", MemberRole.PLATFORM, listen=[f"127.0.0.1:{next(ports)}"])
        else:
            add(f"v{number}.main", MemberRole.PLATFORM, to=["left" if len(routers_of(scene)) > 1 else "root"])
    for number in range(scene.stations):
        to = {FLAT: [], ROUTER: ["root"]}.get(scene.layout, ["right"])
        add(f"s{number}", MemberRole.OBSERVER, to=to, watches=["v0"] if scene.layout == WATCHED else [])


def routers_of(scene: Scene) -> list[str]:
    """Vehicles and stations of a tree are at different branches, so that messages pass three routers."""
    return {FLAT: [], ROUTER: ["root"]}.get(scene.layout, ["root", "left", "right"])


def measure(folder: Path, scene: Scene) -> Measured:
    """Runs a network for some seconds."""
    made(folder, scene)
    with ExitStack() as stack:
        routers = [
            stack.enter_context(program("network", "router", f"yard/{name}/network.yaml", folder=folder))
            for name in routers_of(scene)
        ]
        for router in routers:
            router.await_line(lambda line: "listens at" in line)
        together = 1 if scene.vehicles <= PROCESSES else IN_A_PROCESS
        vehicles = [
            stack.enter_context(_running(folder, "vehicles", first, min(together, scene.vehicles - first)))
            for first in range(0, scene.vehicles, together)
        ]
        for process in vehicles:
            process.await_line(lambda line: line == "open")
        stations = [
            stack.enter_context(_running(folder, "station", number, scene.vehicles, scene.seconds, scene.layout))
            for number in range(scene.stations)
        ]
        for station in stations:
            station.await_line(lambda line: line == "settled")
        bare = stack.enter_context(bare_loop())
        before = _sample(routers, vehicles, stations)
        bare.report()
        begin_s = monotonic_s()
        for station in stations:
            station.await_line(lambda line: line == "measured")
        late = bare.report()
        after, elapsed_s = _sample(routers, vehicles, stations), monotonic_s() - begin_s
        reports = [
            msgspec.json.decode(station.await_line(lambda line: line.startswith("{")), type=StationReport)
            for station in stations
        ]
        for process in vehicles:
            process.interrupt()

    found_s = [report.found_s for report in reports]

    def rate(key: str) -> list[float]:
        return [(later - earlier) / elapsed_s for earlier, later in zip(before[key], after[key], strict=True)]

    return Measured(
        scene=scene,
        station_bytes_s=sum(rate("station bytes")) / scene.stations,
        vehicle_bytes_s=sum(rate("vehicle bytes")) / scene.vehicles,
        station_cpu=sum(rate("station cpu")) / scene.stations,
        vehicle_cpu=sum(rate("vehicle cpu")) / scene.vehicles,
        router_cpu=max(rate("router cpu"), default=0.0),
        latency_p50_s=median(report.latency_p50_s for report in reports),
        latency_p99_s=max(report.latency_p99_s for report in reports),
        bare_p99_s=late.p99_s,
        found_s=None if None in found_s else max(filter(None, found_s)),
    )


@contextmanager
def _running(folder: Path, *words: object) -> Iterator[Program]:
    running = Program([str(folder), *map(str, words)], ROOT, module="tests.common.network.scale")
    try:
        yield running
    finally:
        if running.process.poll() is None:
            running.process.kill()
        running.end()
        running.close()


def _sample(routers: list[Program], vehicles: list[Program], stations: list[Program]) -> dict[str, list[float]]:
    traffic = _traffic()
    return {
        "router cpu": [_cpu_s(one.process.pid) for one in routers],
        "vehicle cpu": [_cpu_s(one.process.pid) for one in vehicles],
        "station cpu": [_cpu_s(one.process.pid) for one in stations],
        "vehicle bytes": [traffic.get(one.process.pid, (0.0, 0.0))[0] for one in vehicles],
        "station bytes": [traffic.get(one.process.pid, (0.0, 0.0))[1] for one in stations],
    }


def _cpu_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _traffic() -> dict[int, tuple[float, float]]:
    """Bytes of all TCP connections, sent and received, by process, as the kernel counts them."""
    text = subprocess.run(["ss", "-tinpHO"], capture_output=True, text=True, check=True).stdout
    connections = [(match, line) for line in text.splitlines() if (match := CONNECTION.match(line))]
    owners = {(match["own"], match["other"]): match["process"] for match, _ in connections}
    found: dict[int, tuple[float, float]] = {}
    for match, line in connections:
        process = int(match["process"])
        if owners.get((match["other"], match["own"])) == match["process"]:
            continue  # inside a process: between its front door and Zenoh
        sent, received = (
            float(count[1]) if (count := re.search(rf"{word}:(\d+)", line)) else 0.0
            for word in ("bytes_acked", "bytes_received")
        )
        before = found.get(process, (0.0, 0.0))
        found[process] = before[0] + sent, before[1] + received
    return found


# --- the processes ---


class RecordedMessage(NamedTuple):
    """A message that a station receives from a vehicle."""

    at_s: float
    """After the start of the recording."""
    topic: str
    """Below the platform's name."""
    message: Message


def recorded() -> list[RecordedMessage]:
    """What a vehicle in flight has sent to its stations."""
    with LogReader(RECORDING, TopicTable.installed().types) as reader:
        found = [entry.envelope for entry in reader.entries("ci/*")]
    return [
        RecordedMessage(one.t_s, one.topic.partition("/")[2], one.payload)
        for one in found
        if not one.topic.endswith(ADDRESSED)
    ]


async def fly(publisher: Publisher, name: str, messages: Sequence[RecordedMessage], skipped_s: float) -> None:
    """Publishes a recording again and again, from some point of it on."""
    loop, lasts_s = asyncio.get_running_loop(), messages[-1].at_s
    begin_s = loop.time() - skipped_s
    while True:
        for one in messages:
            wait_s = begin_s + one.at_s - loop.time()
            if wait_s >= 0.0 or begin_s + one.at_s > loop.time() - LATE_S:
                await asyncio.sleep(wait_s)
                publisher.publish(f"{name}/{one.topic}", one.message, loop.time())
        begin_s += lasts_s


async def vehicles(folder: Path, first: int, number: int) -> None:
    """Some vehicles, until they are interrupted."""
    loop, topics, messages = asyncio.get_running_loop(), TopicTable.installed(), recorded()
    with ExitStack() as stack:
        flights = []
        for index in range(first, first + number):
            name = f"v{index}"
            own = read_network(folder / "yard" / f"{name}.main" / "network.yaml", NOW)
            network = stack.enter_context(open_exchange(own.node(), loop, topics, settings=own.settings()))
            skipped_s = messages[-1].at_s * (index * GOLDEN % 1.0)
            flights.append(fly(Publisher(network, name, "ci", 1), name, messages, skipped_s))
        print("open", flush=True)
        await asyncio.gather(*flights)


async def station(folder: Path, number: int, wanted: int, seconds: float, layout: str) -> None:
    """A station, which measures for some seconds once it hears everyone."""
    loop, topics, name = asyncio.get_running_loop(), TopicTable.installed(), f"s{number}"
    own = read_network(folder / "yard" / name / "network.yaml", NOW)
    inside, heard, late_s = LocalExchange(topics), set[str](), list[float]()

    def receive(envelope: Any) -> None:
        heard.add(envelope.topic.partition("/")[0])
        late_s.append(loop.time() - envelope.t_s)

    inside.subscribe("*/ci/*", receive)
    count = 1 if layout == WATCHED else wanted
    begin_s = loop.time()
    with open_exchange(own.node(), loop, topics, settings=own.settings()) as network:
        join_platforms(network, inside, topics, name, signer=own.signer(), unsent=sys.exit, watched=own.file.watches)
        while len(heard) < count and loop.time() < begin_s + FOUND_WITHIN_S:
            await asyncio.sleep(0.01)
        found_s = loop.time() - begin_s if len(heard) >= count else None
        await asyncio.sleep(SETTLE_S)
        print("settled", flush=True)
        late_s.clear()
        await asyncio.sleep(seconds)
        print("measured", flush=True)
        count, ordered = len(late_s), sorted(late_s) or [seconds]  # at least, where nothing came
        await asyncio.sleep(SETTLE_S)  # while its bytes are counted
        report = StationReport(
            found_s=found_s,
            messages_s=count / seconds,
            latency_p50_s=ordered[len(ordered) // 2],
            latency_p99_s=ordered[min(len(ordered) - 1, round(0.99 * len(ordered)))],
        )
        print(msgspec.json.encode(report).decode(), flush=True)


def main(folder: str, kind: str, *words: str) -> None:
    """Runs vehicles or a station."""
    if kind == "vehicles":
        asyncio.run(vehicles(Path(folder), int(words[0]), int(words[1])))
    else:
        asyncio.run(station(Path(folder), int(words[0]), int(words[1]), float(words[2]), words[3]))


if __name__ == "__main__":
    main(*sys.argv[1:])
