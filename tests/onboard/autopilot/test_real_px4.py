"""A build of the real PX4 with its own physics (SIH), and the programs of a user: what its documents do not say."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.commands.programs import program
from tests.onboard.real_px4 import RealPx4, build_tree, under_way

pytestmark = [pytest.mark.firmware, pytest.mark.sockets, pytest.mark.thorough, pytest.mark.timeout(400)]


@pytest.fixture
def px4(tmp_path: Path) -> Iterator[RealPx4]:
    if build_tree() is None:
        pytest.skip("no px4 of a build tree is on PATH: see docs/firmware.md")
    with RealPx4(tmp_path) as made:
        yield made


def test_it_knows_where_it_is_though_px4_says_so_only_on_request(px4: RealPx4) -> None:
    text = px4.make_platform()
    assert "frames:" in text.splitlines()[6], text
    assert "geo: [47.39774" in text
    assert "least_acceptance_m: 1" in text


def test_it_says_why_it_would_not_arm_in_px4_s_own_sentence(px4: RealPx4) -> None:
    px4.make_platform()
    px4.shell("sensor_gps_sim", "stop")
    time.sleep(10.0)
    with program("doctor", "heron.yaml", *px4.autopilot, folder=px4.folder) as doctor:
        assert doctor.end() == 1
        assert "No valid global position estimate" in doctor.text


def test_a_second_mission_of_a_boot_is_flown_like_the_first(px4: RealPx4) -> None:
    px4.make_platform()
    with px4.onboard():
        px4.fly()
        px4.fly()


def test_a_killed_onboard_process_takes_its_mission_up_again(px4: RealPx4) -> None:
    px4.make_platform()
    with px4.station() as station:
        with px4.onboard() as first:
            under_way(station)
            first.interrupt(signal.SIGKILL)
            first.end()
        time.sleep(3.0)
        with px4.onboard():
            assert station.end() == 0, station.text


def test_a_process_that_stood_still_for_four_seconds_is_no_pilot(px4: RealPx4) -> None:
    px4.make_platform()
    with px4.onboard() as onboard, px4.station() as station:
        under_way(station)
        onboard.interrupt(signal.SIGSTOP)
        time.sleep(4.0)
        onboard.interrupt(signal.SIGCONT)
        assert station.end() == 0, station.text
        assert "this process stalled for" in station.text
        assert "pilot has control" not in station.text


def test_a_pilot_who_lands_ends_the_run_with_its_own_exit_code(px4: RealPx4) -> None:
    px4.make_platform()
    with px4.onboard(), px4.station() as station:
        under_way(station)
        px4.shell("commander", "mode", "auto:land")
        assert station.end() == 3, station.text
        assert "a pilot has landed the vehicle" in station.lines[-1]
