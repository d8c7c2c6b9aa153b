"""Logs and processes: a run gives the same bytes in any process, and a killed process loses at most a second."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gloc3.log.reader import LogReader

pytestmark = pytest.mark.thorough

IMPORTS = """
import asyncio, sys
from pathlib import Path
from random import Random
from gloc3.clock import Clock, run_virtual
from gloc3.exchange.base import Publisher
from gloc3.exchange.base import LocalExchange
from gloc3.messages.envelope import Event, InternalState, Severity
from gloc3.log.record import Recorder
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Pose

async def run(seconds: float, is_telling: bool) -> None:
    loop = asyncio.get_running_loop()
    exchange, random = LocalExchange(), Random(3)
    recorder = Recorder(Path(sys.argv[1]), Clock(loop), TopicTable(), {"platform": "pelican"})
    recorder.attach(exchange, loop)
    recorder.attach_file("mission.yaml", b"mission: hop")
    publishers = [Publisher(exchange, "pelican", name, random.getrandbits(32)) for name in ("ground", "pose")]
    start_s = loop.time()
    while loop.time() - start_s < seconds:
        now_s = loop.time()
        place = (random.random(), random.random(), now_s)
        pose = Pose(position_ned_m=place, velocity_ned_m_s=place, ned_from_frd=(1.0, 0.0, 0.0, 0.0))
        for publisher in publishers:
            publisher.publish("pelican/pose", pose, now_s - 0.001, "ned")
        items = {"seen": {"a", "b", "c", "d"}, "place": place}
        publishers[0].publish("pelican/components/ground/internal", InternalState(items=items), now_s)
        if is_telling:
            print(now_s, flush=True)
        await asyncio.sleep(0.01)
    recorder.close()
"""
VIRTUAL = IMPORTS + "run_virtual(run(3.0, False))"
WALL = IMPORTS + "asyncio.run(run(60.0, True))"


A_SECOND = 100
"""Cycles of that program; a computer that is busy makes fewer."""


def start(program: str, log: Path, hash_seed: str = "0") -> "subprocess.Popen[str]":
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", program, str(log)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def test_the_same_run_gives_the_same_bytes_with_any_hash_seed_in_any_folder(tmp_path: Path) -> None:
    logs = [tmp_path / folder / "log.mcap" for folder in ("one", "the_other")]
    for log in logs:
        log.parent.mkdir()
    processes = [start(VIRTUAL, log, seed) for log, seed in zip(logs, ("1", "4242"), strict=True)]
    for process in processes:
        process.communicate(timeout=900)
        assert process.returncode == 0
    one, other = (log.read_bytes() for log in logs)
    assert len(one) > 20_000
    assert one == other


def test_a_process_that_is_killed_loses_less_than_a_second(tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    with start(WALL, log) as process:
        assert process.stdout is not None
        text = [float(process.stdout.readline())]
        while text[-1] - text[0] < 0.4 or len(text) < 2 * A_SECOND:
            text.append(float(process.stdout.readline()))
        process.kill()
        text += [float(line) for line in process.stdout if line.endswith("\n")]
    with LogReader(log) as reader:
        poses = [entry.envelope.t_s for entry in reader.entries("pose")]
        assert not reader.is_finished
        assert "not finished" in reader.losses()[-1]
        assert reader.attachments == {"mission.yaml": b"mission: hop"}
    assert poses[0] <= text[0]
    assert len(text) - len(poses) / 2 < A_SECOND, "two in each cycle"
