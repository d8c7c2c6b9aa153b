"""Three stations and five vehicles as processes: each vehicle a simulator and an onboard process, each station its own.

`python -m tests.flight.fleet_processes SYSTEM SEED SPAN_S CRASH_S NAMES LINKS` is one of the stations: it commands all
vehicles and takes control of those that fly no mission as `fleet_trial.Operator` does, and tells each command on stdout, when
it is sent and when it is answered. After CRASH_S, where that is not 0, it kills itself as soon as it holds control.
"""

import asyncio
import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from random import Random
from typing import Any

import msgspec
from tests.commands.programs import Program, program
from tests.flight.fleet_trial import (
    FLYING,
    FLYING_STATION,
    FULL_WITHIN_S,
    TWO,
    WITNESSED,
    Command,
    Operator,
    Witness,
    knows_everything,
    passed_on,
    rates_of,
    wrongs,
)
from tests.flight.fleet_trial import routes as ways_of

from gloc3.log.reader import LogReader
from gloc3.messages.topics import TopicTable
from gloc3.platform.reader import whole_text
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_sitl.demo.demo import free_ports

ROOT = Path(__file__).parents[2]
SYSTEMS = (255, 254, 253)
LATE = 252


class ProcessesFound(msgspec.Struct):
    """What came of a run."""

    commands: int
    accepted: int
    refused: int
    unknown: int
    hand_overs: dict[str, int]
    crashed_holding: int
    late_full_s: float
    mission: str
    """How the mission across two of the vehicles ended."""
    wrong: list[str]


async def _operate(
    system: int, seed: int, span_s: float, crash_s: float, names: Sequence[str], urls: Sequence[str]
) -> None:
    """One station: commands for a while, then waits for the rest of the answers."""
    ground = GroundStation(StationSetup(boot=Random(f"{system} {seed}").getrandbits(32), system=system))
    await ground.open(urls)
    loop, station = ground.loop, ground.station
    began_s = loop.time()
    while not knows_everything(station, names) and loop.time() < began_s + FULL_WITHIN_S:
        await asyncio.sleep(0.05)
    full_s = loop.time() - began_s if knows_everything(station, names) else -1.0
    _report({"full_s": full_s})
    chance, rates = Random(seed * 1000 + system), rates_of(LATE + 3 - system)
    operator = Operator(station, names, names[FLYING:], chance, rates, _report)
    await operator.work(loop.time() + (crash_s or span_s))
    while crash_s:
        held = await operator.seize()
        if held:
            _report({"crashed_holding": held})
            os.kill(os.getpid(), signal.SIGKILL)
    await ground.close()


def _report(what: Any) -> None:
    sys.stdout.write(msgspec.json.encode(what).decode() + "\n")
    sys.stdout.flush()


@contextlib.contextmanager
def _vehicles(folder: Path, count: int, stations: int) -> Iterator[tuple[list[str], list[list[str]], list[Program]]]:
    """Vehicles on the ground: their names, for each station its links to them, and the onboard processes."""
    kind = socket.SOCK_DGRAM
    names = [f"vehicle{number}" for number in range(count)]
    text = whole_text("pelican_rtk")
    routes: list[list[str]] = [[] for _ in range(stations)]
    with ExitStack() as stack:
        onboard = []
        for number, name in enumerate(names):
            file = folder / f"{name}.yaml"
            file.write_text(re.sub(r"(?m)^platform: .*$", f"platform: {name}", text))
            cable, *ports = free_ports(1 + stations, kind)
            for way, port in zip(routes, ports, strict=True):
                way.append(f"udpout://127.0.0.1:{port}")
            link = f"companion=udpout://127.0.0.1:{cable}"
            stack.enter_context(program("sitl", "--link", link, "--param", f"MAV_SYS_ID={number + 1}", folder=folder))
            words = [word for port in ports for word in ("--station", f"udpin://127.0.0.1:{port}")]
            onboard.append(
                stack.enter_context(
                    program(
                        *("onboard", str(file), "--autopilot", f"udpin://127.0.0.1:{cable}"),
                        *("--system-id", str(number + 1), "--out", name, *words),
                        folder=folder,
                    )
                )
            )
        for one in onboard:
            one.await_line(lambda line: "components; log in" in line)
        yield names, routes, onboard


def _station(
    system: int, seed: int, span_s: float, names: Sequence[str], urls: Sequence[str], crash_s: float = 0.0
) -> "subprocess.Popen[str]":
    words = [str(system), str(seed), str(span_s), str(crash_s), ",".join(names), ",".join(urls)]
    return subprocess.Popen(
        [sys.executable, "-m", "tests.flight.fleet_processes", *words], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )


def run_processes(seed: int, folder: Path, count: int = 5, span_s: float = 40.0) -> ProcessesFound:
    """Three stations command all vehicles and struggle for all but two of them, which fly a mission across them; the first
    dies while it holds control, another comes late.
    """
    reported: list[str] = []
    with _vehicles(folder, count, len(SYSTEMS) + 2) as (names, routes, onboard):
        crew = [
            _station(system, seed, span_s, names, way, crash_s=0.0 if number else span_s / 2.0)
            for number, (system, way) in enumerate(zip(SYSTEMS, routes, strict=False))
        ]
        (folder / "two.yaml").write_text(TWO)
        links = [word for url in routes[-1][:FLYING] for word in ("--link", url)]
        words = ("station", "--headless", "--mission", "two.yaml", "--station-id", str(FLYING_STATION), *links)
        with program(*words, folder=folder) as flying:
            time.sleep(span_s / 2.0)
            late = _station(LATE, seed, span_s / 2.0, names, routes[-2])
            for one in (*crew, late):
                reported += one.communicate(timeout=span_s + 60.0)[0].splitlines()
            ended = flying.end()
            mission = "done" if ended == 0 else flying.text[-400:]
        for each in onboard:
            each.interrupt()
        for each in onboard:
            each.end()
    return _judge(reported, {name: _witness(folder / name / "log.mcap") for name in names}, mission)


def _witness(log: Path) -> Witness:
    witness = Witness()
    with LogReader(log, TopicTable.installed().types) as reader:
        for entry in reader.entries(*WITNESSED):
            witness.see(entry.envelope.payload)
    return witness


def _judge(reported: Sequence[str], witnesses: dict[str, Witness], mission: str) -> ProcessesFound:
    commands: dict[float, Command] = {}
    full_s, hands = [], []
    held: list[str] = []
    for line in reported:
        text = msgspec.json.decode(line)
        if "full_s" in text:
            full_s.append(text["full_s"])
        elif "way" in text:
            hands.append(text["way"])
        elif "crashed_holding" in text:
            held = text["crashed_holding"]
        else:
            command = msgspec.convert(text, Command)
            commands[command.rate_hz] = command
    outcomes = [command.outcome for command in commands.values()]
    return ProcessesFound(
        commands=len(outcomes),
        accepted=outcomes.count("accepted"),
        refused=outcomes.count("refused"),
        unknown=len(outcomes) - outcomes.count("accepted") - outcomes.count("refused"),
        hand_overs=ways_of(hands),
        crashed_holding=passed_on(held, str(SYSTEMS[0]), witnesses),
        late_full_s=round(full_s[-1], 1),
        mission=mission,
        wrong=list(wrongs(commands.values(), witnesses)),
    )


if __name__ == "__main__":
    own, chance, span, crash, named, links = sys.argv[1:]
    asyncio.run(_operate(int(own), int(chance), float(span), float(crash), named.split(","), links.split(",")))
