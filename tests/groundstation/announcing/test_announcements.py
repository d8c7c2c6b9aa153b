"""Alerts that are announced: each once, worse ones again, returning ones after a while; spoken one at a time."""

import asyncio
import stat
import time
from pathlib import Path

import pytest
from msgspec.structs import replace

from gloc3.messages.envelope import Severity
from gloc3_groundstation.announcing import speech
from gloc3_groundstation.announcing.announcements import REPEAT_S, Announcements, severity_of
from gloc3_groundstation.announcing.speech import Speech
from gloc3_groundstation.station.alerts import Alert, Alerts


def alert(what: str, severity: Severity, text: str, platform: str = "heron") -> Alert:
    return Alert(platform=platform, what=what, severity=severity, text=text, since_s=0.0, last_s=0.0)


def alerts(*all_: Alert) -> Alerts:
    return Alerts({one.key: one for one in all_})


def test_levels_are_the_mildest_severity_that_is_announced() -> None:
    assert [severity_of(level) for level in ("off", "critical", "error", "warning")] == [
        None, Severity.CRITICAL, Severity.ERROR, Severity.WARNING
    ]  # fmt: skip


def test_a_new_alert_is_announced_once_and_again_when_it_is_worse() -> None:
    said = list[str]()
    announcements = Announcements(bell=Severity.WARNING, speech=Severity.ERROR, speak=said.append)
    low = alert("battery", Severity.WARNING, "battery at or below 30 %")
    assert announcements.update(alerts(low), 0.0)
    assert said == [], "a warning rings only"
    assert not announcements.update(alerts(low), 10.0)
    assert announcements.update(alerts(replace(low, severity=Severity.CRITICAL, text="battery at or below 15 %")), 20.0)
    assert said == ["heron, critical: battery at or below 15 %"]
    assert not announcements.update(alerts(alert("x", Severity.ERROR, "seen", "")), 21.0), "one ring in two seconds"
    assert said[1:] == ["station, error: seen"]


def test_one_that_flaps_or_is_acknowledged_is_quiet() -> None:
    announcements = Announcements(bell=Severity.ERROR)
    lost = alert("link", Severity.ERROR, "no messages from it")
    assert announcements.update(alerts(lost), 0.0)
    rings = [announcements.update(alerts(replace(lost, count=2 + n)), 3.0 * n) for n in range(1, 10)]
    assert not any(rings)
    assert announcements.update(alerts(replace(lost, count=20)), REPEAT_S + 1.0)
    assert not announcements.update(alerts(replace(lost, count=21, is_acknowledged=True)), 3.0 * REPEAT_S)
    announcements.update(alerts(), 3.0 * REPEAT_S + 1.0)
    assert announcements.update(alerts(lost), 4.0 * REPEAT_S), "after it was acknowledged and over, it is new"


def program(folder: Path, body: str) -> Path:
    path = folder / "spd-say"
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@pytest.mark.thorough  # other processes
async def test_texts_are_spoken_one_at_a_time_newest_first_without_repeats(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(tmp_path, f'echo "begin $*" >> {tmp_path}/said; sleep 0.2; echo end >> {tmp_path}/said')
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    found = speech.find_program()
    assert found == ("spd-say", "--wait")
    failed = list[str]()
    speaker = Speech(found, failed.append)
    begin_s = time.monotonic()
    for text in ("one", "two", "two", "three\x1b[2J", "one", "--help"):
        speaker.speak(text)
    assert time.monotonic() - begin_s < 0.1, "nobody waits for it"
    async with asyncio.timeout(20.0):
        while speaker._task is not None:
            await asyncio.sleep(0.02)
    lines = (tmp_path / "said").read_text().splitlines()
    assert lines[::2] == [
        f"begin --wait {text}" for text in ("help", "three\N{REPLACEMENT CHARACTER}[2J", "two", "one")
    ]
    assert set(lines[1::2]) == {"end"}
    assert failed == []


@pytest.mark.thorough  # other processes
async def test_a_program_that_fails_is_reported_once(tmp_path: Path) -> None:
    failed = list[str]()
    speaker = Speech((str(program(tmp_path, "exit 3")),), failed.append)
    for text in ("one", "two"):
        speaker.speak(text)
    async with asyncio.timeout(20.0):
        while speaker._task is not None:
            await asyncio.sleep(0.02)
    assert len(failed) == 1
    assert "it ends with 3" in failed[0]


def test_a_computer_without_such_a_program_has_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert speech.find_program() is None
