"""Reboot and shutdown: what is forgotten, what stands on the memory card, and when they are refused."""

import pytest

from gloc3.mavlink.services.plan import PlanResult
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.vehicles.simulator import BOOT_S

from .bench import ARM, Bench

STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])
POWER, REBOOT, SHUTDOWN = 246, 1, 2
HEIGHT = {"px4": "RTL_RETURN_ALT", "ardupilot": "RTL_ALT_M"}


@STYLES
def test_a_reboot_is_silent_and_begins_anew_with_what_is_on_the_card(style: str) -> None:
    bench = Bench(style)
    bench.get_ready()
    bench.set_parameter(HEIGHT[style], 7.0)
    assert bench.upload([bench.item(16), bench.item(22), bench.item(16, 5.0)]) is PlanResult.ACCEPTED
    bench.sim.front.files.make_folder("/kept")
    bench.run(2.0)
    assert bench.command(POWER, REBOOT) is Result.ACCEPTED
    bench.received.clear()
    bench.run(BOOT_S - 0.1)
    assert not bench.received
    bench.run(1.0)
    bench.send("HEARTBEAT", type=18, autopilot=8)
    bench.command(512, 2)
    assert bench.last("SYSTEM_TIME").time_boot_ms < 2000
    assert bench.autopilot.parameters[HEIGHT[style]] == 7.0
    assert len(bench.download()) == len(bench.autopilot.plans.mission) == 3
    assert "kept" in [entry.name for entry in bench.sim.front.files.entries("/")]
    bench.run_until(lambda: not bench.autopilot.commander.problems(), 10.0)
    assert bench.command(ARM, 1) is Result.ACCEPTED


def test_the_logs_of_before_a_reboot_can_still_be_read() -> None:
    bench = Bench()
    bench.get_ready()
    bench.command(ARM, 1)
    bench.run(1.0)
    bench.command(ARM, 0)
    bench.run(0.1)
    before = bench.autopilot.logger.entries()
    bench.command(POWER, REBOOT)
    bench.run(BOOT_S + 4.0)
    assert bench.autopilot.logger.entries() == before
    bench.command(ARM, 1)
    bench.run(1.0)
    assert [log.name for log in bench.autopilot.logger.logs] == ["flight_001.ulg", "flight_002.ulg"]


@pytest.mark.flight
@STYLES
def test_it_flies_after_a_reboot(style: str) -> None:
    bench = Bench(style)
    bench.get_ready()
    bench.command(POWER, REBOOT)
    bench.run(BOOT_S + 0.5)
    bench.send("HEARTBEAT", type=18, autopilot=8)
    bench.take_off()
    assert bench.position[2] == pytest.approx(-2.5, abs=0.3)


@STYLES
def test_neither_is_done_while_armed(style: str) -> None:
    bench = Bench(style)
    bench.get_ready()
    bench.command(ARM, 1)
    refused = Result.DENIED if bench.is_px4 else Result.FAILED
    assert bench.command(POWER, REBOOT) is refused
    assert bench.command(POWER, SHUTDOWN) is refused
    bench.run(1.0)
    assert bench.is_armed
    assert not bench.sim.is_down


def test_a_shutdown_is_final_in_px4_style() -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.command(POWER, SHUTDOWN) is Result.ACCEPTED
    bench.run(0.1)
    assert bench.sim.is_off
    bench.received.clear()
    bench.send("HEARTBEAT", type=18, autopilot=8)
    bench.run(5.0)
    assert not bench.received


def test_ardupilot_cannot_be_shut_down() -> None:
    bench = Bench("ardupilot")
    bench.get_ready()
    assert bench.command(POWER, SHUTDOWN) is Result.UNSUPPORTED
    assert not bench.sim.is_down
