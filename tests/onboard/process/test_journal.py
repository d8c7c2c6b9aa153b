"""Entries for systemd's journal: the native protocol, as its documentation has it, and lines where there is no journal."""

import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from gloc3.exchange import Publisher
from gloc3.exchange.base import LocalExchange
from gloc3.messages.envelope import Event, Severity
from gloc3_onboard.process.event_narration import EventNarration
from gloc3_onboard.process.journal import SystemdJournal


def fields(data: bytes) -> dict[str, str]:
    """The fields of an entry, read as the documentation of the protocol says."""
    found = {}
    while data:
        line, _, data = data.partition(b"\n")
        name, equals, value = line.partition(b"=")
        if not equals:
            (size,) = struct.unpack("<Q", data[:8])
            value, data = data[8 : 8 + size], data[9 + size :]
        found[name.decode()] = value.decode()
    return found


@pytest.fixture
def received(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as found:
        found.bind(str(tmp_path / "journal"))
        found.settimeout(1.0)
        yield found


def narrated(path: Path, event: Event) -> list[str]:
    """Publishes an event of the component `pose`; the lines that did not go to the journal."""
    exchange, lines = LocalExchange(), list[str]()
    journal = SystemdJournal("gloc3-quad", str(path))
    narration = EventNarration(exchange, "quad", ["*"], lambda severity, text: lines.append(text), journal)
    Publisher(exchange, "quad", "pose", 1).publish("quad/components/pose/event", event, 1.0)
    narration.close()
    return lines


def test_an_event_is_one_entry_with_its_component(received: socket.socket, tmp_path: Path) -> None:
    event = Event(
        severity=Severity.ERROR, text="working -> faulty: \x1b[2J", details="Traceback\n  line", cause="pose_lost"
    )
    assert narrated(tmp_path / "journal", event) == []
    found = fields(received.recv(65_536))
    assert found == {
        "MESSAGE": "onboard: pose: working -> faulty: \N{REPLACEMENT CHARACTER}[2J\nTraceback\n  line",
        "PRIORITY": "3",
        "SYSLOG_IDENTIFIER": "gloc3-quad",
        "PLATFORM": "quad",
        "COMPONENT": "pose",
        "EVENT": "working -> faulty: \N{REPLACEMENT CHARACTER}[2J",
        "CAUSE": "pose_lost",
    }


def test_what_only_informs_is_no_entry(received: socket.socket, tmp_path: Path) -> None:
    assert narrated(tmp_path / "journal", Event(severity=Severity.INFO, text="initialized")) == []
    received.setblocking(False)
    with pytest.raises(BlockingIOError):
        received.recv(1)


def test_without_a_journal_the_lines_go_where_they_went_before(tmp_path: Path) -> None:
    event = Event(severity=Severity.ERROR, text="hung", details="a\nb")
    assert narrated(tmp_path / "none", event) == ["pose: hung", "    a", "    b"]
