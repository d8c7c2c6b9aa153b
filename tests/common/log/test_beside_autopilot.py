"""The autopilot's own log beside ours: read by the libraries of its project, on one time axis that the motion gives."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3.log.autopilot_log import autopilot_series, autopilot_track, read_autopilot_log
from gloc3.log.cli import app
from gloc3.log.reader import LogReader
from gloc3.log.report.beside_autopilot import in_words, read_beside
from gloc3.messages.vehicle import Pose

from .autopilot_logs import write_dataflash, write_ulog
from .samples import POSE, LogInMemory

Writer = Callable[[Path, Any, Any, Any], None]
WRITERS: dict[str, tuple[str, Writer]] = {
    "ULog": ("flight.ulg", write_ulog),
    "DataFlash": ("00000001.BIN", write_dataflash),
}
APART_S = 37.215
"""The autopilot has started so much earlier than our clock."""
ORIGIN_M = np.array([3.0, -4.0, 0.5])
"""Where our origin is in the autopilot's frame."""


def motion(t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A flight from 5 s on: up, round and round, down."""
    turn = 0.35 * np.clip(t_s - 12.0, 0.0, 40.0)
    height = np.clip(t_s - 5.0, 0.0, 4.0) - np.clip(t_s - 55.0, 0.0, 4.0)
    position = np.stack([4.0 * np.sin(turn), 3.0 - 3.0 * np.cos(turn) + 0.4 * turn, -height], axis=1)
    return position, np.gradient(position, t_s, axis=0)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    times = np.arange(0.0, 65.0, 0.05)
    memory = LogInMemory()
    for t_s, place, velocity in zip(times.tolist(), *(each.tolist() for each in motion(times)), strict=True):
        pose = Pose(position_ned_m=tuple(place), velocity_ned_m_s=tuple(velocity), ned_from_frd=(1.0, 0.0, 0.0, 0.0))
        memory.send("pose", pose, t_s, POSE, "ned")
    path = tmp_path / "log.mcap"
    path.write_bytes(memory.close())
    return path


@pytest.fixture(params=WRITERS)
def autopilot(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A log of the same flight that begins before ours, at another rate, with noise."""
    name, write = WRITERS[request.param]
    times = np.arange(-8.0, 62.0, 0.1)
    position, velocity = motion(times)
    noise = np.random.default_rng(3).normal(0.0, 0.05, velocity.shape)
    write(tmp_path / name, times + APART_S, position + ORIGIN_M, velocity + noise)
    return tmp_path / name


def run(*arguments: object) -> Any:
    return app([str(argument) for argument in arguments], exit_on_error=True, result_action="return_value")


def test_the_motion_brings_both_on_one_time_axis_and_to_one_origin(log: Path, autopilot: Path) -> None:
    with LogReader(log) as reader:
        found = read_beside(reader, read_autopilot_log(autopilot), [], None)
    assert found.offset_s == pytest.approx(-APART_S, abs=0.02)
    assert found.correlation is not None
    assert found.correlation > 0.95
    assert found.moved_m == pytest.approx(tuple(-ORIGIN_M), abs=0.05)
    at = np.interp(30.0, found.theirs.t_s, found.theirs.position_ned_m[:, 0])
    assert at == pytest.approx(motion(np.array([29.9, 30.0, 30.1]))[0][1, 0], abs=0.1)
    assert "its positions moved by -3.0" in in_words(found)


@pytest.mark.thorough
def test_a_picture_is_drawn_with_fields_of_the_autopilot(
    log: Path, autopilot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    field = "battery_status.voltage_v" if autopilot.suffix == ".ulg" else "BAT.Volt"
    assert run("plot", log, "--autopilot", autopilot, "--field", field) == 0
    target = log.with_name(f"log-{autopilot.stem}.svg")
    assert f'id="{field}"' in target.read_text()
    assert f"{target}: autopilot's time -37.2" in capsys.readouterr().out


def test_an_offset_that_is_given_is_taken(log: Path, autopilot: Path) -> None:
    with LogReader(log) as reader:
        found = read_beside(reader, read_autopilot_log(autopilot), [], -30.0)
        assert (found.offset_s, found.correlation) == (-30.0, None)
        with pytest.raises(Refused, match="no time in common"):
            read_beside(reader, read_autopilot_log(autopilot), [], 1000.0)


def test_the_first_core_is_taken_and_a_wrong_field_is_named(autopilot: Path) -> None:
    read = read_autopilot_log(autopilot)
    assert np.ptp(autopilot_track(read).position_ned_m[:, 0]) > 7.0
    with pytest.raises(Refused, match="did you mean"):
        autopilot_series(read, "vehicle_local_position.vw" if autopilot.suffix == ".ulg" else "XKF1.VM")


def test_logs_of_different_flights_are_refused(log: Path, tmp_path: Path) -> None:
    times = np.arange(0.0, 60.0, 0.1)
    speeds = np.random.default_rng(1).normal(0.0, 1.0, (len(times), 3))
    write_ulog(tmp_path / "other.ulg", times, np.cumsum(speeds, axis=0) * 0.1, speeds)
    with LogReader(log) as reader:
        with pytest.raises(Refused, match=r"not of one flight: .* set --offset"):
            read_beside(reader, read_autopilot_log(tmp_path / "other.ulg"), [], None)
        write_ulog(tmp_path / "still.ulg", times, np.zeros((len(times), 3)), np.zeros((len(times), 3)))
        with pytest.raises(Refused, match="the autopilot's log has too little motion"):
            read_beside(reader, read_autopilot_log(tmp_path / "still.ulg"), [], None)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"ULog\x01\x12\x35\x01", "is damaged"),
        (b"hello", "is no autopilot's log that is known"),
        (b"", "is no autopilot's"),
    ],
)
def test_what_is_no_autopilots_log_is_said(data: bytes, reason: str, tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(data)
    with pytest.raises(InputError, match=reason):
        read_autopilot_log(tmp_path / "a.ulg")
    with pytest.raises(InputError, match="No such file"):
        read_autopilot_log(tmp_path / "b.ulg")


def test_wrong_use_is_refused(log: Path, autopilot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Refused, match="belong to --autopilot"):
        run("plot", log, "--offset", 3.0)
    with pytest.raises(Refused, match="its own fields are named by --field"):
        run("plot", log, "pose", "--autopilot", autopilot)
    if autopilot.suffix == ".ulg":
        monkeypatch.setitem(sys.modules, "pyulog", None)
        with pytest.raises(Gloc3Error, match="ULog files need pyulog"):
            run("plot", log, "--autopilot", autopilot)
