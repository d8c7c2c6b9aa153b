"""What other people's ground stations are told by the onboard computer."""

import asyncio
from pathlib import Path

from gloc3.clock import run_virtual
from gloc3.exchange import LocalExchange, Publisher
from gloc3.mavlink.codec import Encoder, MavlinkMessage, Parser
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.statustext import StatusTextReceiver
from gloc3.messages.envelope import Event, Severity
from gloc3_onboard.companion.autopilot_reporter import MOST_TEXTS, PERIOD_S, AutopilotReporter, computer_status
from gloc3_onboard.process.vitals import Vitals, VitalSigns

OWN = Address(1, 191)
HALF_BUSY = "cpu  50 0 30 {idle} 20 0 0 0 0 0\ncpu0 1 1 1 1\n"


def reported(events: list[Event], for_s: float, least: Severity = Severity.WARNING) -> list[tuple[int, str]]:
    """The texts that stations hear of events that happen at once."""
    received: list[MavlinkMessage] = []

    async def work() -> None:
        loop = asyncio.get_running_loop()
        exchange = LocalExchange()
        reporter = AutopilotReporter(exchange, "pelican", OWN, loop, received.append)
        reporter.least_severity = least
        publisher = Publisher(exchange, "pelican", "camera", 1)
        for event in events:
            publisher.publish("pelican/components/camera/event", event, loop.time())
        await asyncio.sleep(for_s)
        reporter.close()
        publisher.publish("pelican/components/camera/event", events[0], loop.time())
        await asyncio.sleep(2.0 * PERIOD_S)

    run_virtual(work())
    receiver, encoder, parser = StatusTextReceiver(Address(255, 190)), Encoder(*OWN), Parser(is_datagram=True)
    for message in received:
        for frame in parser.receive(encoder.encode(message)):
            decoded = frame.decode()
            assert decoded is not None
            assert decoded.name == "STATUSTEXT"
            receiver.receive(decoded, OWN, 0.0)
    return [(text.severity, text.text) for text in receiver.events()]


def test_warnings_and_worse_are_status_texts_of_any_length() -> None:
    long = "no frame for 1.0 s, the device has gone away; it is tried again, and again, and again"
    texts = reported(
        [
            Event(severity=Severity.ERROR, text=long),
            Event(severity=Severity.INFO, text="standby -> working"),
            Event(severity=Severity.WARNING, text="two lights"),
        ],
        1.0,
    )
    assert texts == [(3, f"camera: {long}"), (4, "camera: two lights")]


def test_a_storm_of_texts_is_cut_short_and_counted() -> None:
    storm = [Event(severity=Severity.WARNING, text=f"number {number}") for number in range(MOST_TEXTS + 7)]
    texts = reported(storm, PERIOD_S + 1.0)
    assert [text for _, text in texts[:-1]] == [f"camera: number {number}" for number in range(MOST_TEXTS)]
    assert texts[-1] == (4, "and 7 more")


def test_how_severe_an_event_must_be_can_be_changed() -> None:
    events = [Event(severity=Severity.INFO, text="standby -> working"), Event(severity=Severity.ERROR, text="gone")]
    assert reported(events, 1.0, Severity.INFO) == [(6, "camera: standby -> working"), (3, "camera: gone")]
    assert reported(events, 1.0, Severity.CRITICAL) == []


def test_what_is_known_is_told_in_the_protocols_units_and_the_rest_as_unknown() -> None:
    vitals = Vitals(
        uptime_s=12.5,
        cpu_percent=37,
        memory_used_mib=900,
        memory_total_mib=4000,
        disk_used_mib=10,
        disk_total_mib=20,
    )
    known, unknown = computer_status(vitals, 5.0), computer_status(Vitals(), 5.0)
    assert (known.uptime, known.ram_usage, known.ram_total) == (12_500, 900, 4000)
    assert (known.cpu_combined[0], known.cpu_combined[1], known.cpu_cores) == (37, 255, bytes([255] * 8))
    assert (known.storage_usage[0], known.storage_total[0]) == (10, 20)
    assert (unknown.cpu_combined[0], unknown.ram_total, unknown.temperature_board) == (255, 0xFFFFFFFF, 127)


def test_this_computer_tells_its_figures(tmp_path: Path) -> None:
    signs = VitalSigns(tmp_path / "not" / "there yet")
    assert signs.sample().cpu_percent is None
    found = signs.sample()
    assert found.uptime_s > 0.0
    assert 0 < found.memory_used_mib < found.memory_total_mib
    assert 0 < found.disk_used_mib <= found.disk_total_mib


def test_the_processors_load_is_that_since_the_last_look(tmp_path: Path) -> None:
    signs = VitalSigns(tmp_path, tmp_path)
    (tmp_path / "stat").write_text("cpu  0 0 0 0 0 0 0 0 0 0\n")
    assert signs.sample().cpu_percent is None
    (tmp_path / "stat").write_text(HALF_BUSY.format(idle=60))
    assert signs.sample().cpu_percent == 50
    assert signs.sample().cpu_percent is None, "no time has passed"


def test_a_computer_that_tells_nothing_or_rubbish_is_no_error(tmp_path: Path) -> None:
    for name in ("stat", "meminfo", "uptime"):
        (tmp_path / name).write_text("rubbish")
    found = VitalSigns(tmp_path, tmp_path).sample()
    assert (found.uptime_s, found.cpu_percent, found.memory_total_mib) == (0.0, None, 0)
