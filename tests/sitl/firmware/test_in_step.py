"""A firmware in step with virtual time, with a stand-in for its program."""

import os
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.sitl.firmware.test_firmware_command import program

from gloc3.cli.program import run
from gloc3.errors import Gloc3Error, Refused
from gloc3.log.reader import LogReader
from gloc3_sitl.faults.fault_effects import EFFECTS
from gloc3_sitl.faults.faults import read_fault
from gloc3_sitl.firmware.body import BodySettings
from gloc3_sitl.firmware.in_step import FirmwareInStep
from gloc3_sitl.world import World


def made(folder: Path, monkeypatch: pytest.MonkeyPatch, kind: str = "ardupilot") -> FirmwareInStep:
    program(folder, kind).rename(folder / "arducopter")
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    return FirmwareInStep("ardupilot", World.load("open"), BodySettings(), {}, folder)


@pytest.mark.sockets
def test_time_goes_on_only_when_it_is_asked_to_and_the_link_goes_both_ways(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown = made(tmp_path, monkeypatch)
    try:
        received: list[bytes] = []
        report = flown.attach(received.append)
        flown.advance(1.0)
        assert flown.truth().t_s == 1.0
        flown.advance(1.0)
        assert flown.truth().t_s == 1.0
        assert 1 <= len(received) <= 2  # the second may be on its way
        report(b"and back")
        flown.advance(2.5)
        assert flown.truth().t_s == 2.5
        assert received.count(b"and back") == 1
        assert len(received) == 4
    finally:
        flown.stop()
    assert (tmp_path / "firmware" / "ardupilot_pelican.parm").exists()


@pytest.mark.sockets
@pytest.mark.thorough
def test_a_flight_in_virtual_time_is_flown_by_px4_which_comes_set_up_for_a_pilot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(tmp_path, "px4").rename(tmp_path / "px4")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    code = run(
        ["fly", "hop", "--platform", "pelican_rtk", "--firmware", "px4", "--quiet", "--out", str(tmp_path / "out")]
    )
    assert code == 0
    with LogReader(tmp_path / "out" / "log.mcap") as reader:
        heights = [-entry.envelope.payload.position_ned_m[2] for entry in reader.entries("sim/truth")]
    assert max(heights) == pytest.approx(1.5, abs=0.3)


@pytest.mark.sockets
def test_a_firmware_that_ends_is_told_with_its_last_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flown = made(tmp_path, monkeypatch, "neither")
    try:
        with pytest.raises(Gloc3Error, match="has exited: stand-in: Failed to find location"):
            flown.advance(0.1)
    finally:
        flown.stop()


def test_a_flight_with_a_firmware_needs_its_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent / "nowhere"))
    with pytest.raises(Refused, match="arducopter is not on PATH"):
        FirmwareInStep("ardupilot", World.load("open"), BodySettings(), {})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("sensor:fix=lost", "simulates its own fix; only imu and height can fail here"),
        ("sensor:magnetometer=stuck", "its own magnetometer"),
        ("battery=0.1", "its own battery"),
        ("pilot:LOITER", "no simulated pilot"),
    ],
)
def test_faults_of_what_a_firmware_simulates_by_itself_are_refused(text: str, reason: str) -> None:
    fault = read_fault(text)
    simulator = object.__new__(FirmwareInStep)
    flight: Any = SimpleNamespace(plan=SimpleNamespace(is_firmware=True, autopilot="ardupilot"), simulator=simulator)
    with pytest.raises(Refused, match=reason):
        EFFECTS[fault.kind].check(flight, fault.given)
    for allowed in ("sensor:imu=biased/0.2", "sensor:height=lost", "wind=5"):
        good = read_fault(allowed)
        EFFECTS[good.kind].check(flight, good.given)
