"""`gloc3 onboard` as a service: what its manager is told, and what happens when it hangs, dies, is reloaded or ends."""

import os
import re
import signal
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from tests.commands.programs import Program
from tests.onboard.fake_manager import FakeManager, service

from gloc3.component.workers import REAL_TIME_PRIORITY, rate_priority, take_real_time_priority
from gloc3.errors import Refused
from gloc3.exchange import Publisher
from gloc3.exchange.base import LocalExchange
from gloc3.messages.summaries import Health, Summary
from gloc3_onboard.process.process import REAL_TIME_SWITCH_S
from gloc3_onboard.service.manager import ServiceManager
from gloc3_onboard.service.service import ServiceReport
from gloc3_sitl.demo.demo import free_ports

pytestmark = pytest.mark.sockets

STUCK = '''
"""A sampler that hangs for as long as a file is there."""

import sys
import time
from pathlib import Path
from typing import Annotated

from gloc3.component.component import SensorSampler
from gloc3.component.settings import Bounds, Settings


class StuckSettings(Settings, frozen=True):
    """Settings of the sampler."""

    depth_m: Annotated[float, Bounds(0.0, 5.0)] = 1.0
    """How deep it is stuck."""


class StuckSampler(SensorSampler[StuckSettings]):
    """Hangs when it is told to."""


    def initialize(self, settings):
        Path("depth_m").write_text(str(settings.depth_m))

    def work(self, now_s, inbox):
        while Path("stuck").exists():
            time.sleep(0.05)
        Path("switch_s").write_text(str(sys.getswitchinterval()))
        return []
'''
SERVER = (
    '  - {name: command_server, class: "gloc3_onboard.command_server.server:CommandServer", rate_hz: 10, '
    "trigger: [request, event], devices: {site: site}, required: true, ports: {height: [], request: ci/request, "
    'heard: ci/heard, status: "components/*/status", reply: "components/*/reply", function_reply: '
    '"components/*/function_reply", event: "components/*/event", action_status: "action_status/*", ci_reply: ci/reply, '
    "summary: ci/summary, table: ci/table, trouble: ci/trouble, vehicle: ci/vehicle, motion: ci/motion, whereabouts: "
    "ci/site, mission: ci/mission, control: ci/control, ci_event: ci/event, command: "
    '"components/{key}/command", function: "components/{key}/function", grant: motion/grant, limits: motion/limits, '
    "home: motion/home, take_over: motion/take_over, emergency: motion/emergency, geofence: motion/geofence, "
    "fence_state: [], autopilot: [], pose: [], setpoint: [], driver: [], autopilot_setup: [], computer: []}}\n"
)
PLATFORM = (
    "platform: bench\nvehicle: {type: quadrotor, mass_kg: 1.0}\ncomponents:\n"
    "  - {name: stuck, class: 'stuck_sampler:StuckSampler', rate_hz: 10, required: true}\n" + SERVER
)


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A folder with a platform that needs no autopilot, and a component that can be made to hang."""
    (tmp_path / "stuck_sampler.py").write_text(STUCK)
    (tmp_path / "bench.yaml").write_text(PLATFORM)
    return tmp_path


def arguments() -> list[str]:
    companion, ground = free_ports(2, socket.SOCK_DGRAM)
    links = ["--autopilot", f"udpin://127.0.0.1:{companion}", "--station", f"udpout://127.0.0.1:{ground}"]
    return ["onboard", "bench.yaml", *links, "--out", "out"]


def fed_after(manager: FakeManager, life: int, line: str) -> bool:
    reported = [each for number, _, each in manager.reported if number == life]
    return line in reported and "WATCHDOG=1" in reported[reported.index(line) :]


def test_a_manager_hears_ready_then_the_watchdog_and_at_the_end_stopping(bench: Path) -> None:
    with service(*arguments(), folder=bench, is_abstract=True) as manager:
        manager.await_line(0, "READY=1")
        manager.until(lambda: fed_after(manager, 0, "READY=1"), "the watchdog is fed")
        manager.await_line(0, "STATUS=bench is working: 2 of 2 components work; no autopilot is connected")
        os.kill(manager.process.pid, signal.SIGTERM)
        manager.until(lambda: manager.ends == [0], "it ends by itself")
    order = manager.lines(0)
    before = order[: order.index("READY=1")]
    assert all(line.startswith("STATUS=bench is ") for line in before)
    assert before[-1].startswith("STATUS=bench is working: 2 of 2 components work"), "all are up"
    assert order[-2:] == ["STOPPING=1", "STATUS=stopping"]
    assert "<5>onboard: stopping" in manager.journal.splitlines()
    assert "<6>onboard: bench: 2 components; log in out/log.mcap" in manager.journal.splitlines()


def test_a_required_component_that_hangs_or_a_kill_has_the_manager_start_it_anew(bench: Path) -> None:
    with service(*arguments(), folder=bench, watchdog_s=2.0) as manager:
        manager.until(lambda: fed_after(manager, 0, "READY=1"), "the watchdog is fed")
        (bench / "stuck").touch()
        manager.await_line(0, "STATUS=bench is faulty: 1 of 2 components work; stuck hung")
        manager.until(lambda: len(manager.ends) == 1, "the watchdog ends it")
        (bench / "stuck").unlink()
        manager.await_line(1, "READY=1")
        os.kill(manager.process.pid, signal.SIGKILL)
        manager.await_line(2, "STATUS=bench is working: 2 of 2 components work")
    assert manager.ends == [-signal.SIGABRT, -signal.SIGKILL]
    assert "<3>onboard: stuck: working -> faulty: hung: a cycle had not ended after 0.5 s" in manager.journal
    assert re.search(r'stuck_sampler\.py", line \d+ in work', manager.journal), "where it hung"
    assert sorted(path.name for path in (bench / "out").glob("*.mcap")) == ["log-2.mcap", "log-3.mcap", "log.mcap"]


def test_what_a_manager_is_told_stands_in_lines_and_one_that_is_away_is_lamented_once(tmp_path: Path) -> None:
    said: list[str] = []
    environment = {
        "NOTIFY_SOCKET": str(tmp_path / "notify"),
        "WATCHDOG_USEC": "3000000",
        "WATCHDOG_PID": "1",
        "HOME": "/",
    }
    manager = ServiceManager.of_this_process(environment, said.append)
    assert environment == {"HOME": "/"}, "children are not to speak for the service"
    assert manager.watchdog_s is None, "it is another process that is watched"
    manager.ready()
    manager.status("away")
    assert said == ["the service manager cannot be notified: No such file or directory"]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as received:
        received.bind(str(tmp_path / "notify"))
        manager.extend(10.0)
        manager.alive()
        for text in ("two\nlines", "two\nlines", "one"):
            manager.status(text)
        manager.stopping()
        reported = [received.recv(4096).decode() for _ in range(4)]
    assert reported == ["EXTEND_TIMEOUT_USEC=10000000", "STATUS=two lines", "STATUS=one", "STOPPING=1"]
    manager.close()
    manager.ready()
    assert len(said) == 1


def reloaded(manager: FakeManager, bench: Path, change: tuple[str, str]) -> list[str]:
    """What was told from a reload on, until the service is ready again."""
    file = bench / "bench.yaml"
    file.write_text(file.read_text().replace(*change))
    before = len(manager.lines(0))
    os.kill(manager.process.pid, signal.SIGHUP)
    manager.until(lambda: "READY=1" in manager.lines(0)[before:], "the reload has ended")
    return manager.lines(0)[before:]


def test_a_reload_has_the_components_adopt_what_they_may_and_a_wrong_file_changes_nothing(bench: Path) -> None:
    with service(*arguments(), folder=bench) as manager:
        manager.await_line(0, "STATUS=bench is working: 2 of 2 components work; no autopilot is connected")
        begun_us = time.monotonic_ns() // 1000
        reported = reloaded(manager, bench, ("required: true}\n", "required: true, settings: {depth_m: 2.5}}\n"))
        [reload] = [line for line in reported if line.startswith("MONOTONIC_USEC=")]
        assert reported.index("RELOADING=1") < reported.index(reload) < reported.index("READY=1")
        assert begun_us <= int(reload.partition("=")[2]) <= time.monotonic_ns() // 1000
        assert (bench / "depth_m").read_text() == "2.5"
        reloaded(manager, bench, ("depth_m: 2.5", "depth_m: 7.5"))
        reloaded(manager, bench, ("depth_m: 7.5", "depth_m: 2.5"))
        reloaded(manager, bench, ("rate_hz: 10, required: true, s", "rate_hz: 20, required: true, timeout_s: 4, s"))
        assert (bench / "depth_m").read_text() == "2.5"
    text = [line for line in manager.journal.splitlines() if line.startswith(("<3>", "<5>"))]
    text = text[next(number for number, line in enumerate(text) if "reloaded: " in line) :]
    assert text == [
        "<5>onboard: reloaded: stuck: settings: adopted",
        "<3>onboard: bench.yaml:4:105: depth_m: expected a number <= 5.0 (7.5)",
        "<3>onboard: the platform file cannot be used: nothing was changed",
        "<5>onboard: reloaded: nothing has changed",
        "<5>onboard: reloaded: stuck: rate_hz: adopted",
        "<5>onboard: reloaded: stuck: timeout_s: takes effect at the next start",
    ]


def test_what_is_loaded_is_left_to_the_collector_no_more_once_all_are_up() -> None:
    exchange, is_beginning, settled = LocalExchange(), [True], list[str]()
    report = ServiceReport(
        ServiceManager("", None, settled.append),
        exchange,
        "quad",
        lambda: is_beginning[0],
        lambda: settled.append("once"),
    )
    publisher = Publisher(exchange, "quad", "command_server", 1)
    for t_s in (1.0, 2.0, 3.0):
        publisher.publish("quad/ci/summary", Summary(table=1, health=Health.WORKING, lines=[]), t_s)
        assert settled == ([] if is_beginning[0] else ["once"])
        is_beginning[0] = False
    report.close()


ASIDE = "  - {name: aside, class: 'stuck_sampler:StuckSampler', rate_hz: 10}\n"
REAL_TIME = os.SCHED_RR | os.SCHED_RESET_ON_FORK


def may_be_real_time() -> bool:
    """Tries it in a thread of its own."""
    try:
        with ThreadPoolExecutor(1) as trial:
            trial.submit(take_real_time_priority).result()
    except Refused:
        return False
    return True


def threads(process: int) -> list[int]:
    """The threads of a process."""
    return [int(thread.name) for thread in Path(f"/proc/{process}/task").iterdir()]


def policies(process: int) -> list[int]:
    """The scheduling policies of a process's threads."""
    return [os.sched_getscheduler(thread) for thread in threads(process)]


def test_required_components_of_a_higher_rate_go_first_and_all_go_after_the_loop() -> None:
    given = [rate_priority(rate_hz) for rate_hz in (0.1, 1.0, 2.0, 10.0, 20.0, 50.0, 100.0, 1000.0, 1e5)]
    assert given == [1, 1, 2, 4, 5, 6, 7, 9, 9]
    assert given[-1] < REAL_TIME_PRIORITY


@pytest.mark.skipif(not may_be_real_time(), reason="this user may have no real-time priority")
def test_the_loop_and_the_required_components_alone_have_real_time_priority_where_that_is_asked_for(
    bench: Path,
) -> None:
    (bench / "bench.yaml").write_text(PLATFORM + ASIDE)
    program = Program([*arguments(), "--real-time"], bench)
    try:
        end_s = time.monotonic() + 60.0
        while (
            REAL_TIME not in (found := policies(program.process.pid)) or os.sched_getscheduler(program.process.pid) == 0
        ):
            assert time.monotonic() < end_s, program.text
            time.sleep(0.05)
        assert found.count(REAL_TIME) == 3, "the loop, stuck and command_server"
        priorities = sorted(os.sched_getparam(thread).sched_priority for thread in threads(program.process.pid))
        assert priorities[-3:] == [4, 4, 10], "both components at 10 Hz, below the loop"
        assert found.count(os.SCHED_OTHER) == len(found) - 3 > 0
        while float((bench / "switch_s").read_text() or 1.0) != pytest.approx(REAL_TIME_SWITCH_S, rel=0.01):
            assert time.monotonic() < end_s, "other threads keep the interpreter for longer"
            time.sleep(0.05)
    finally:
        program.interrupt()
        program.end()
        program.close()


@pytest.mark.skipif(os.geteuid() != 0, reason="takes a right from root")
def test_without_the_right_real_time_priority_is_refused_before_anything_begins(bench: Path) -> None:
    without = ["setpriv", "--bounding-set=-sys_nice"]
    program = Program([*arguments(), "--real-time"], bench, before=without)
    try:
        assert program.end() == 2
        assert "it needs LimitRTPRIO=10 as a service, or `ulimit -r 10`" in program.text
        assert not (bench / "out").exists()
    finally:
        program.close()
