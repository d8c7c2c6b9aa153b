"""A platform on two computers: the second has another clock, is lost, and comes back."""

import os
import signal
import socket
import subprocess
import time
from itertools import groupby
from pathlib import Path
from typing import Any

import pytest
from tests.commands.programs import Program, program
from tests.onboard.fake_manager import service

from gloc3.log.reader import LogReader
from gloc3.platform.reader import whole_text
from gloc3_onboard.service.status import ServiceStatus
from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]

AHEAD_S = 100_000
NAMESPACE = ("unshare", "--time", "--monotonic", str(AHEAD_S))


def can_have_another_clock() -> bool:
    try:
        return subprocess.run([*NAMESPACE, "true"], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def platform(folder: Path) -> None:
    """The Pelican with its limiter on another computer, and a standby of it at home."""
    text = whole_text("pelican_rtk")
    text = text.replace("{name: limiter,", "{name: limiter, host: vision, process: own,")
    (folder / "p.yaml").write_text(text.replace("components:\n", "hosts: {vehicle: {}, vision: {}}\ncomponents:\n", 1))


def network(folder: Path) -> None:
    """Certificates and network files of both."""
    (port,) = free_ports(1, socket.SOCK_STREAM)
    for words in (
        ("init", "net"),
        ("add", "net", "pelican.vehicle", "--role", "platform", "--listen", f"127.0.0.1:{port}"),
        ("add", "net", "pelican.vision", "--role", "platform"),
    ):
        with program("network", *words, folder=folder) as done:
            assert done.end() == 0, done.text


def states(entries: list[Any], name: str) -> list[str]:
    """The states that a component told one after the other."""
    reported = [e.envelope.payload.state for e in entries if e.envelope.topic == f"pelican/components/{name}/status"]
    return [str(state) for state, _ in groupby(reported)]


def onboard(folder: Path, host: str, *more: str) -> list[str]:
    return ["onboard", "p.yaml", "--host", host, "--network", f"net/pelican.{host}/network.yaml", "--out", "out", *more]


def is_lost(line: str) -> bool:
    return "host vision is lost" in line


def is_here(line: str) -> bool:
    return "host vision is here" in line


@pytest.mark.skipif(not can_have_another_clock(), reason="no time namespace can be made here: it needs Linux and root")
def test_a_host_with_another_clock_keeps_the_platform_s_time_is_lost_and_is_taken_back_quietly(tmp_path: Path) -> None:
    platform(tmp_path)
    network(tmp_path)
    links = ("--autopilot", "udpin://127.0.0.1:0", "--station", "udpout://127.0.0.1:9")
    with program(*onboard(tmp_path, "vehicle", *links), folder=tmp_path) as vehicle:
        with program(*onboard(tmp_path, "vision"), folder=tmp_path, before=NAMESPACE) as vision:
            vehicle.await_line(is_here)
            vision.await_line(lambda line: "components; log in" in line)
            await_logged(tmp_path, "limiter", "working", vehicle)
            vision.interrupt(signal.SIGKILL)
            vision.end()
        vehicle.await_line(is_lost)
        with program(*onboard(tmp_path, "vision"), folder=tmp_path, before=NAMESPACE) as vision:
            vehicle.await_line(is_here, behind=1 + next(n for n, line in enumerate(vehicle.lines) if is_lost(line)))
            await_logged(tmp_path, "limiter", "quiet", vehicle)
            for program_ in (vision, vehicle):
                os.kill(program_.process.pid, signal.SIGTERM)
                assert program_.end() == 0, program_.text
    with LogReader(tmp_path / "out" / "log-vehicle.mcap") as reader:
        entries = list(reader.entries())
    reported = [e.envelope for e in entries if e.envelope.topic == "pelican/hosts/vision"]
    assert {round(one.payload.clock_offset_s, 1) for one in reported} == {-AHEAD_S}
    here = [e.envelope.t_s for e in entries if e.envelope.topic == "pelican/components/hold/status"]
    assert all(min(here) - 1.0 < one.t_s < max(here) + 1.0 for one in reported), "its stamps are in the platform's time"
    assert states(entries, "limiter_standby")[:5] == ["idle", "standby", "working", "quiet", "working"]
    assert states(entries, "limiter")[-3:] == ["working", "quiet", "None"], "it came back, and then left in order"


def test_a_second_host_reports_its_components_and_the_vehicle_so_that_an_update_can_check_it(tmp_path: Path) -> None:
    platform(tmp_path)
    network(tmp_path)
    links = ("--autopilot", "udpin://127.0.0.1:0", "--station", "udpout://127.0.0.1:9")
    line = "STATUS=pelican-vision is working: 1 of 1 components work; no autopilot is connected"
    with (
        program(*onboard(tmp_path, "vehicle", *links), folder=tmp_path) as vehicle,
        service(*onboard(tmp_path, "vision"), folder=tmp_path, watchdog_s=30.0) as vision,
    ):
        vision.await_line(0, "READY=1")
        vision.await_line(0, line)
        vehicle.interrupt(signal.SIGKILL)
        vehicle.end()
        vision.until(lambda: "autopilot" not in vision.lines(0)[-1], "old news of the vehicle are dropped")
    status = ServiceStatus.parse(line.removeprefix("STATUS="))
    assert status is not None
    assert (status.failing, status.is_disarmed) == (0, None), "it may be armed: only --force restarts it"


def await_logged(folder: Path, component: str, state: str, vehicle: Program) -> None:
    """Waits until a state stands in the log that is being written."""
    end_s = time.monotonic() + 60.0
    while time.monotonic() < end_s:
        with LogReader(folder / "out" / "log-vehicle.mcap") as reader:
            if states(list(reader.entries()), component)[-1:] == [state]:
                return
        time.sleep(0.5)
    pytest.fail(f"{component} did not become {state}: {vehicle.text}")
