"""Logs: foreign files, a flight with all sensor data, Foxglove's schemas, ROS 2 bags, and the autopilot's own log."""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from itertools import starmap
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.reader import NonSeekingReader, make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from tests.common.log.autopilot_logs import write_dataflash, write_ulog
from tests.common.log.foreign_logs import FOREIGN
from tests.common.log.foxglove_sdk import foxglove_fields, parsed
from tests.evidence.page import ROOT, Bar, Figure, Progress
from tests.evidence.suites import suite

from gloc3.log.autopilot_log import read_autopilot_log
from gloc3.log.reader import LogReader
from gloc3.log.report.beside_autopilot import read_beside
from gloc3.messages.topics import TopicTable

GLOC3: Final = str(Path(sys.executable).with_name("gloc3"))
PLATFORM: Final = """\
platform: heron
extends: pelican
log: {camera/*: true, imu: true, laser: true, features/*: true}
"""
ODOMETERS: Final = (
    "features",
    "stereo_odometry",
    "ground_odometry",
    "laser_odometry",
    "optical_follower",
    "obstacles",
    "pose",
)
APART_S: Final = 41.37
NOISE_M_S: Final = 0.05
TESTS: Final = [
    "tests/common/log/test_log_foreign.py",
    "tests/common/log/test_log_convert.py",
    "tests/common/log/test_log_selection.py",
    "tests/common/log/test_log_replay.py",
    "tests/common/log/test_log_foxglove.py",
    "tests/common/log/test_beside_autopilot.py",
]


def gloc3(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [GLOC3, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def foreign() -> dict[str, Any]:
    """Messages of each foreign log that are read as the mcap library reads them, of how many."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, write in FOREIGN.items():
            file = Path(folder) / f"{name.replace(' ', '-')}.mcap"
            write(file)
            with file.open("rb") as stream:
                wanted = [
                    (channel.topic, message.log_time, message.data)
                    for _, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False)
                ]
            with LogReader(file) as reader:
                read = [
                    (reader.channel(message.channel).topic, message.log_ns, message.data)
                    for _, messages in reader.chunks()
                    for message in messages
                ]
            found[name] = [sum(starmap(tuple.__eq__, zip(read, wanted, strict=False))), len(wanted)]
    return found


def recorded() -> dict[str, Any]:
    """A flight with all sensor data: the log's size, its replays, what Foxglove and ROS read of it."""
    with tempfile.TemporaryDirectory() as folder:
        platform, run = Path(folder) / "heron.yaml", Path(folder) / "run"
        platform.write_text(PLATFORM)
        flown = gloc3("fly", "hop", "--platform", platform, "--out", run, "--quiet")
        log = run / "log.mcap"
        info = json.loads(gloc3("log", "info", run, "--json").stdout)
        replays = {name: _replayed(run, name) for name in ODOMETERS}
        converted = gloc3("log", "convert", run, "--to", "rosbag2", "--out", run / "bag")
        return {
            "flown": "hop: done" in flown.stdout,
            "mb_per_min": log.stat().st_size / 1e6 / info["duration_s"] * 60.0,
            "duration_s": info["duration_s"],
            "replays": replays,
            "foxglove": _foxglove(log),
            "bag": _bag(run / "bag") if not converted.returncode else [0, 1],
            "autopilot": {
                "ULog": _beside(log, run / "flight.ulg", write_ulog),
                "DataFlash": _beside(log, run / "00000001.BIN", write_dataflash),
            },
        }


def _replayed(run: Path, component: str) -> list[Any]:
    found = gloc3("log", "replay", run, component)
    return [found.returncode, " ".join(found.stdout.split("\n")[0].split()[1:])]


def _foxglove(log: Path) -> list[Any]:
    """Messages that fit Foxglove's schemas, of how many, and the schemas."""
    fitting, schemas = 0, Counter[str]()
    with log.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if schema is not None and schema.name.startswith("foxglove."):
                schemas[schema.name.removeprefix("foxglove.")] += 1
                ours = "type" in channel.metadata
                parsed(schema.name, foxglove_fields(schema.name, json.loads(message.data), is_ours=ours))
                fitting += 1
    return [fitting, schemas.total(), sorted(schemas)]


def _bag(folder: Path) -> list[int]:
    """Messages that rosbags reads with ROS's own types, of how many."""
    types = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([folder], default_typestore=types) as reader:
        read = sum(types.deserialize_cdr(data, one.msgtype) is not None for one, _, data in reader.messages())
        return [read, reader.message_count]


def _beside(log: Path, file: Path, write: Callable[[Path, Any, Any, Any], None]) -> list[float]:
    """Error of the offset, in s, and the correlation: the autopilot's estimate of this flight, with noise."""
    with LogReader(log, TopicTable.installed().types) as reader:
        rows = np.array(
            [
                (one.t_s, *one.payload.position_ned_m, *one.payload.velocity_ned_m_s)
                for _, one in reader.entries("autopilot_pose")
            ]
        )
        noise = np.random.default_rng(1).normal(0.0, NOISE_M_S, (len(rows), 3))
        write(file, rows[:, 0] + APART_S, rows[:, 1:4], rows[:, 4:7] + noise)
        found = read_beside(reader, read_autopilot_log(file), [], None)
    return [abs(found.offset_s + APART_S), found.correlation or 0.0]


def figures(progress: Progress) -> list[Figure]:
    """All of them."""
    others = progress.part("foreign", foreign)
    result = progress.part("flight", recorded)
    found = [
        Figure(
            f"foreign log, {name}: messages read as the mcap library reads them",
            f"{same} of {all_}",
            "all",
            same == all_,
        )
        for name, (same, all_) in others.items()
    ]
    found.append(
        Figure("flight with all sensor data", "done" if result["flown"] else "not done", "done", result["flown"])
    )
    size = f"{result['mb_per_min']:.0f} MB/min ({result['duration_s']:.0f} s)"
    found.append(Figure("its log, with four cameras of 640 x 480 at 15 Hz", size))
    for name, (code, text) in result["replays"].items():
        found.append(Figure(f"replay of {name}", text, "same", code == 0))
    fitting, all_, schemas = result["foxglove"]
    found.append(
        Figure(
            "messages that fit Foxglove's schemas by its SDK", f"{fitting:,} of {all_:,}", "all", fitting == all_ > 0
        )
    )
    found.append(Figure("schemas", ", ".join(schemas)))
    read, all_ = result["bag"]
    found.append(
        Figure(
            "messages of the ROS 2 bag that rosbags reads with ROS's types",
            f"{read:,} of {all_:,}",
            "all",
            read == all_ > 0,
        )
    )
    for form, (error_s, correlation) in result["autopilot"].items():
        text = f"{1000.0 * error_s:.1f} ms (correlation {correlation:.3f})"
        found.append(Figure(f"error of the offset to the autopilot's {form}", text, "< 30 ms", error_s < 0.03))
    return [*found, *suite("logs", TESTS)(progress)]


BARS: Final = (
    Bar(
        "logs",
        "GLOC3 reads logs of other programs, and other programs read GLOC3's",
        "Any valid MCAP file is read. The log of a flight replays every odometer, fits Foxglove's schemas, and "
        "becomes a ROS 2 bag. The autopilot's own log can be compared with ours. Not tried: the Foxglove app, a ROS "
        "installation, and logs of a real flight. ULog and DataFlash files are made from a simulated flight, written "
        "by pyulog and by the documented format, and read by pyulog and DFReader.",
        figures,
        seeds="0",
    ),
)
