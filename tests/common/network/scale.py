"""How a network grows: vehicles that send real traffic, routers, and stations, as processes; bytes, processor, latency.

A vehicle is a session of its own with its certificate, which publishes what an onboard process publishes for stations, at
the same rates and sizes; several vehicles share a process. Routers and stations are what users run.
"""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import msgspec
from tests.commands.programs import Program, program
from tests.common.network.yard import LONG, NOW, free_port

from gloc3.clock import monotonic_s
from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.zenoh import open_exchange
from gloc3.messages.envelope import Message
from gloc3.messages.motion import MotionSummary
from gloc3.messages.summaries import (
    ComponentLine,
    ControlState,
    Health,
    MissionSummary,
    Summary,
    VehicleSummary,
)
from gloc3.messages.topics import TopicTable
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.file import read_network
from gloc3.network.stations import join_platforms

ROOT: Final = Path(__file__).parents[3]
FLAT, ROUTER, TREE, WATCHED = "flat", "one router", "tree", "tree, one vehicle watched"
LAYOUTS: Final = (FLAT, ROUTER, TREE, WATCHED)
COMPONENTS: Final = 21
"""Of pelican."""
SETTLE_S: Final = 3.0
IN_A_PROCESS: Final = 10


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """One network."""

    layout: str
    vehicles: int
    stations: int
    seconds: float = 8.0


class StationReport(msgspec.Struct, frozen=True, kw_only=True):
    """What a station measures."""

    found_s: float
    """Until it has heard all vehicles that it receives, s; infinite if it has not."""
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
    latency_p99_s: float
    """Of the worst station."""
    found_s: float


def made(folder: Path, scene: Scene) -> None:
    """The network's files."""
    yard = folder / "yard"
    register.found(yard, "yard", NOW, LONG)

    def add(name: str, role: MemberRole, **fields: Any) -> None:
        entry = register.NetworkMember(role=role, certificate="", until="", **fields)
        register.add(yard, name, entry, NOW, LONG, is_renewed=False)

    for router in routers_of(scene):
        uplinks = {"left": ["root"], "right": ["root"]}.get(router, [])
        add(router, MemberRole.ROUTER, listen=[f"127.0.0.1:{free_port()}"], to=uplinks)
    for number in range(scene.vehicles):
        if scene.layout == FLAT:
            add(f"v{number}.main", MemberRole.PLATFORM, listen=[f"127.0.0.1:{free_port()}"])
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
        vehicles = [
            stack.enter_context(_running(folder, "vehicles", first, min(IN_A_PROCESS, scene.vehicles - first)))
            for first in range(0, scene.vehicles, IN_A_PROCESS)
        ]
        for process in vehicles:
            process.await_line(lambda line: line == "open")
        stations = [
            stack.enter_context(_running(folder, "station", number, scene.vehicles, scene.seconds, scene.layout))
            for number in range(scene.stations)
        ]
        for station in stations:
            station.await_line(lambda line: line == "settled")
        before = _sample(routers, vehicles, stations)
        begin_s = monotonic_s()
        for station in stations:
            station.await_line(lambda line: line == "measured")
        after, elapsed_s = _sample(routers, vehicles, stations), monotonic_s() - begin_s
        reports = [
            msgspec.json.decode(station.await_line(lambda line: line.startswith("{")), type=StationReport)
            for station in stations
        ]
        for process in vehicles:
            process.interrupt()

    def rate(key: str) -> list[float]:
        return [(later - earlier) / elapsed_s for earlier, later in zip(before[key], after[key], strict=True)]

    return Measured(
        scene=scene,
        station_bytes_s=sum(rate("station bytes")) / scene.stations,
        vehicle_bytes_s=sum(rate("vehicle bytes")) / scene.vehicles,
        station_cpu=sum(rate("station cpu")) / scene.stations,
        vehicle_cpu=sum(rate("vehicle cpu")) / scene.vehicles,
        router_cpu=max(rate("router cpu"), default=0.0),
        latency_p99_s=max(report.latency_p99_s for report in reports),
        found_s=max(report.found_s for report in reports),
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
    found: dict[int, tuple[float, float]] = {}
    for line in text.splitlines():
        owner = re.search(r"pid=(\d+)", line)
        if owner is None:
            continue
        sent, received = (
            float(match[1]) if (match := re.search(rf"{word}:(\d+)", line)) else 0.0
            for word in ("bytes_acked", "bytes_received")
        )
        before = found.get(int(owner[1]), (0.0, 0.0))
        found[int(owner[1])] = before[0] + sent, before[1] + received
    return found


# --- the processes ---


def traffic(t_s: float) -> list[tuple[str, float, Message]]:
    """What an onboard process sends to stations: topic, rate, message."""
    lines = [ComponentLine(number, 0, 100, 10, number, 0) for number in range(COMPONENTS)]
    vehicle = VehicleSummary(
        t_s=t_s,
        mode="AUTO.MISSION",
        is_armed=True,
        landed="in_air",
        battery_percent=83,
        position_m=(1.0, 2.0, 1.5),
        speed_m_s=0.5,
        heading_deg=90,
        is_pose_valid=True,
        has_pilot_control=False,
        is_autopilot_connected=True,
        frame="hold",
        pose_sources=["stereo", "laser"],
        pose_quality_percent=90,
    )
    motion = MotionSummary(
        t_s=t_s,
        attitude_cdeg=(0, 0, 9000),
        position_cm=(100, 200, 150),
        velocity_cm_s=(50, 0, 0),
        is_pose_valid=True,
        setpoint_cm=(101, 200, 150),
        setpoint_velocity_cm_s=(50, 0, 0),
        setpoint_heading_cdeg=9000,
    )
    tasks = {f"t{number}": "running" for number in range(8)}
    mission = MissionSummary(name="inspection", digest="0123456789abcdef", state="running", tasks=tasks)
    return [
        ("summary", 2.0, Summary(table=1, health=Health.WORKING, lines=lines)),
        ("vehicle", 2.0, vehicle),
        ("motion", 2.0, motion),
        ("mission", 1.0, mission),
        ("control", 1.0, ControlState(holder="alice")),
    ]


async def vehicles(folder: Path, first: int, number: int) -> None:
    """Some vehicles, until they are interrupted."""
    loop, topics = asyncio.get_running_loop(), TopicTable.installed()
    with ExitStack() as stack:
        publishers = {}
        for name in (f"v{index}" for index in range(first, first + number)):
            own = read_network(folder / "yard" / f"{name}.main" / "network.yaml", NOW)
            network = stack.enter_context(open_exchange(own.node(), loop, topics, settings=own.settings()))
            publishers[name] = Publisher(network, name, "ci", 1)
        print("open", flush=True)
        tick = 0
        while True:
            for offset, (name, publisher) in enumerate(publishers.items()):
                now_s = loop.time()
                for topic, rate_hz, message in traffic(now_s):
                    if (tick + offset) % round(2.0 / rate_hz) == 0:
                        publisher.publish(f"{name}/ci/{topic}", message, now_s)
                await asyncio.sleep(0.5 / len(publishers))
            tick += 1


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
        join_platforms(network, inside, topics, name, signer=own.signer(), watched=own.file.watches)
        while len(heard) < count and loop.time() < begin_s + 60.0:
            await asyncio.sleep(0.01)
        found_s = loop.time() - begin_s if len(heard) >= count else float("inf")
        await asyncio.sleep(SETTLE_S)
        print("settled", flush=True)
        late_s.clear()
        await asyncio.sleep(seconds)
        print("measured", flush=True)
        ordered = sorted(late_s) or [float("inf")]
        await asyncio.sleep(SETTLE_S)  # while its bytes are counted
        report = StationReport(
            found_s=found_s,
            messages_s=len(ordered) / seconds,
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
