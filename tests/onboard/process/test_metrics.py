"""Metrics for Prometheus: the format, as its own parser reads it, from messages and from a running process."""

import re
from pathlib import Path
from urllib.request import urlopen

import pytest
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families
from tests.onboard.fake_manager import service
from tests.onboard.service.test_service import PLATFORM, STUCK, arguments

from gloc3.cli.program import run
from gloc3.component.lci import State
from gloc3.exchange import Publisher
from gloc3.exchange.base import LocalExchange
from gloc3.messages.envelope import ComponentStatus, Kind
from gloc3.messages.link_traffic import LinkTraffic
from gloc3.messages.readiness import ComputerState, LinkCondition
from gloc3.messages.summaries import VehicleSummary
from gloc3_onboard.process.metrics import PlatformMetrics, is_loopback, parse_address

Samples = dict[tuple[str, tuple[tuple[str, str], ...]], float]


def samples(text: str) -> Samples:
    """Every sample, by its name and labels; a family without a type or help fails."""
    found: Samples = {}
    for family in text_string_to_metric_families(text):
        assert family.documentation, family.name
        assert family.type != "unknown", family.name
        for one in family.samples:
            key = (one.name, tuple(sorted(one.labels.items())))
            assert key not in found, key
            found[key] = one.value
    return found


def test_messages_become_metrics() -> None:
    exchange = LocalExchange()
    metrics = PlatformMetrics(exchange, "quad")
    publisher = Publisher(exchange, "quad", "test", 1)
    status = ComponentStatus(
        name='po"se', kind=Kind.PROCESSOR, state=State.WORKING, rate_hz=19.5, overruns=3, dropped=2
    )
    publisher.publish("quad/components/pose/status", status, 1.0)
    gone = ComponentStatus(name="laser", kind=Kind.SAMPLER, state=None, is_required=True, silent=["laser"])
    publisher.publish("quad/components/laser/status", gone, 1.0)
    traffic = LinkTraffic(bytes_in=1234, lost=5, dropped={"telemetry": 2, "link": 1})
    links = [LinkCondition("udpout://127.0.0.1:14550", "", traffic=traffic)]
    publisher.publish("quad/computer", ComputerState(disk_free_mb=2.5, links=links), 1.0)
    vehicle = VehicleSummary(
        t_s=1.0,
        mode="Hold",
        is_armed=True,
        landed="in_air",
        battery_percent=80,
        position_m=(0.0, 0.0, 1.0),
        speed_m_s=1.5,
        heading_deg=0,
        is_pose_valid=False,
        has_pilot_control=False,
        is_autopilot_connected=True,
    )
    publisher.publish("quad/ci/vehicle", vehicle, 1.0)
    registry = CollectorRegistry()
    registry.register(metrics)
    found = samples(generate_latest(registry).decode())
    pose, laser = ("component", 'po"se'), ("component", "laser")
    assert found["gloc3_component_state", (pose, ("kind", "DP"), ("state", "working"))] == 1.0
    assert found["gloc3_component_state", (pose, ("kind", "DP"), ("state", "faulty"))] == 0.0
    assert found["gloc3_component_state", (laser, ("kind", "SS"), ("state", "absent"))] == 1.0
    assert found["gloc3_component_rate_hertz", (pose,)] == 19.5
    assert found["gloc3_component_overruns_total", (pose,)] == 3.0
    assert found["gloc3_component_dropped_total", (pose,)] == 2.0
    assert found["gloc3_component_silent_topics", (laser,)] == 1.0
    assert found["gloc3_component_required", (laser,)] == 1.0
    link = (("link", "udpout://127.0.0.1:14550"),)
    assert found["gloc3_link_received_bytes_total", link] == 1234.0
    assert found["gloc3_link_dropped_frames_total", link] == 3.0
    assert found["gloc3_log_disk_free_bytes", ()] == 2.5e6
    assert found["gloc3_vehicle_armed", ()] == 1.0
    assert found["gloc3_vehicle_pose_valid", ()] == 0.0
    metrics.close()


def scraped(url: str) -> Samples:
    with urlopen(url, timeout=10.0) as answer:
        assert answer.headers["Content-Type"].startswith("text/plain; version=")
        return samples(answer.read().decode())


@pytest.mark.sockets
def test_a_process_serves_them_while_it_runs(tmp_path: Path) -> None:
    (tmp_path / "stuck_sampler.py").write_text(STUCK)
    (tmp_path / "bench.yaml").write_text(PLATFORM)
    with service(*arguments(), "--metrics", "127.0.0.1:0", folder=tmp_path) as manager:
        manager.await_line(0, "STATUS=bench is working: 2 of 2 components work")
        (port,) = re.findall(r"metrics: http://127\.0\.0\.1:(\d+)", manager.journal)
        url = f"http://127.0.0.1:{port}/metrics"
        cycles = ("gloc3_component_cycles_total", (("component", "stuck"),))
        manager.until(lambda: scraped(url).get(cycles, 0.0) > 0.0, "cycles are counted")
        found = scraped(url)
    labels = (("component", "stuck"), ("kind", "SS"), ("state", "working"))
    assert found["gloc3_component_state", labels] == 1.0
    assert found["gloc3_health", (("health", "working"),)] == 1.0
    assert found["process_resident_memory_bytes", ()] > 1e7
    assert found["gloc3_vehicle_autopilot_connected", ()] == 0.0


@pytest.mark.parametrize(
    "text", ["9100", "127.0.0.1", "127.0.0.1:port", "127.0.0.1:99999", "http://127.0.0.1:1", ":9100"]
)
def test_what_is_no_address_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["onboard", "copter", "--metrics", text]) == 2
    assert "HOST:PORT" in capsys.readouterr().err


def test_addresses_are_told_apart() -> None:
    assert parse_address("[::1]:9100") == ("::1", 9100)
    assert [is_loopback(host) for host in ("127.0.0.1", "::1", "localhost", "0.0.0.0", "10.0.0.1")] == [
        True, True, True, False, False
    ]  # fmt: skip
