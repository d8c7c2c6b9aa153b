"""Replay: a component answers recorded inputs as it did, and a changed one shows what its change does."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
import pytest

from gloc3.clock import Clock
from gloc3.component.component import DataProcessor, SensorSampler, function
from gloc3.component.deployment import ComponentRow
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, NoSettings, Settings
from gloc3.component.test_bench import PLATFORM, Bench
from gloc3.errors import Refused
from gloc3.log.reader import LogReader
from gloc3.log.record import Recorder
from gloc3.log.replay import render_replay, replay
from gloc3.messages.envelope import Message
from gloc3.messages.topics import TopicRow, TopicTable
from gloc3.platform.platform import Platform, Vehicle


class Reading(Message, frozen=True):
    height_m: float


class Level(Message, frozen=True):
    height_m: float
    label: str = ""


class Raise(Message, frozen=True):
    by_m: float


class SmootherSettings(Settings, frozen=True):
    gain: Annotated[float, Bounds(0.0, 1.0)] = 0.25


class Smoother(DataProcessor[SmootherSettings]):
    """Follows its input slowly; can be raised by function."""

    reading = Input(Reading)
    level = Output(Level)

    def initialize(self, settings: SmootherSettings) -> None:
        self.gain, self.height_m, self.offset_m = settings.gain, 0.0, 0.0

    @function("raise")
    def raise_(self, request: Raise, now_s: float) -> Raise:
        self.offset_m += request.by_m
        return request

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        latest = inbox.latest(self.reading)
        if latest is None:
            return []
        self.height_m += self.gain * (latest.payload.height_m - self.height_m)
        return [Level(height_m=self.height_m + self.offset_m + now_s, label="high" if self.height_m > 2.0 else "low")]


TOPICS = TopicTable({"reading": TopicRow(Reading, 20.0), "level": TopicRow(Level, 10.0)})
PERIODIC = ComponentRow(name="smoother", class_name=f"{__name__}:Smoother", rate_hz=10.0)
TRIGGERED = ComponentRow(name="smoother", class_name=f"{__name__}:Smoother", trigger="reading")


def platform(row: ComponentRow) -> Platform:
    return Platform(platform=PLATFORM, vehicle=Vehicle(type="quadrotor", mass_kg=1.0), components=(row,))


def record(
    file: Path, row: ComponentRow, topics: TopicTable = TOPICS, chosen: dict[str, bool | float] | None = None
) -> LogReader:
    """A log of the component at work; readings come at the very moments of its cycles, too."""
    with Bench(topics=topics) as bench:
        recorder = Recorder(file, Clock(bench.loop), topics, {"platform": PLATFORM}, chosen=chosen)
        recorder.attach(bench.exchange, bench.loop)
        bench.run(0.3)
        bench.host(row, Smoother)
        for index in range(40):
            bench.send("reading", Reading(height_m=0.1 * index))
            bench.run(0.05)
            if index == 20:
                assert bench.call("smoother", "raise", by_m=0.5).is_accepted
        recorder.close()
    return LogReader(file, topics.types)


@pytest.mark.parametrize("row", [PERIODIC, TRIGGERED], ids=["periodic", "triggered"])
def test_the_same_component_answers_the_same(tmp_path: Path, row: ComponentRow) -> None:
    with record(tmp_path / "log.mcap", row) as reader:
        result = replay(reader, platform(row), "smoother", TOPICS)
    (found,) = result.comparisons
    assert found.topic == f"{PLATFORM}/level"
    assert found.recorded == found.matched >= 20
    assert result.is_same, render_replay(result)
    assert max(found.differences.values()) < 1e-9


def test_other_settings_show_their_effect(tmp_path: Path) -> None:
    other = msgspec.structs.replace(PERIODIC, settings={"gain": 1.0})
    with record(tmp_path / "log.mcap", PERIODIC) as reader:
        result = replay(reader, platform(other), "smoother", TOPICS)
    (found,) = result.comparisons
    assert not found.is_same
    assert found.differences["height_m"] > 0.5
    assert found.mismatches["label"] > 2
    text = render_replay(result)
    assert "DIFFERS" in text
    assert "height_m" in text


@pytest.mark.parametrize(
    ("name", "row", "reason"),
    [
        ("smother", PERIODIC, "did you mean 'smoother'"),
        ("smoother", msgspec.structs.replace(PERIODIC, devices={"device": "camera"}), "reads a device \\(camera\\)"),
        ("other", msgspec.structs.replace(PERIODIC, name="other"), "did not start in this log"),
    ],
)
def test_what_cannot_be_replayed_is_refused_with_the_reason(tmp_path: Path, name: str, row: Any, reason: str) -> None:
    with record(tmp_path / "log.mcap", PERIODIC) as reader, pytest.raises(Refused, match=reason):
        replay(reader, platform(row), name, TOPICS)


HIDDEN = TopicTable({"reading": TopicRow(Reading, 20.0, is_logged=False), "level": TopicRow(Level, 10.0)})
UNSEEN = TopicTable({"reading": TopicRow(Reading, 20.0), "level": TopicRow(Level, 10.0, is_logged=False)})


class Gauge(SensorSampler[NoSettings]):
    """Publishes the readings."""

    reading = Output(Reading)

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        return []


def with_gauge(row: ComponentRow, chosen: dict[str, bool | float] | None = None) -> Platform:
    gauge = ComponentRow(name="gauge", class_name=f"{__name__}:Gauge", rate_hz=20.0)
    vehicle = Vehicle(type="quadrotor", mass_kg=1.0)
    return Platform(platform=PLATFORM, vehicle=vehicle, components=(row, gauge), log=chosen or {})


def test_an_input_that_was_not_recorded_is_named_with_the_remedy(tmp_path: Path) -> None:
    with (
        record(tmp_path / "log.mcap", PERIODIC, HIDDEN) as reader,
        pytest.raises(Refused, match=r"its input reading was not recorded\. `log: \{reading: true\}` in the platform"),
    ):
        replay(reader, with_gauge(PERIODIC), "smoother", HIDDEN)


def test_an_output_that_was_not_recorded_is_no_difference(tmp_path: Path) -> None:
    with record(tmp_path / "log.mcap", PERIODIC, UNSEEN) as reader:
        result = replay(reader, with_gauge(PERIODIC), "smoother", UNSEEN)
    assert result.comparisons == []
    assert not result.is_same
    (note,) = result.notes
    assert re.fullmatch(r"bench/level: \d+ replayed; it was not recorded, so there is nothing to compare with", note)


def test_an_input_of_which_only_some_messages_were_recorded_is_named(tmp_path: Path) -> None:
    chosen: dict[str, bool | float] = {"reading": 5.0}
    with record(tmp_path / "log.mcap", PERIODIC, TOPICS, chosen) as reader:
        result = replay(reader, with_gauge(PERIODIC, chosen), "smoother", TOPICS)
    assert result.notes == ["bench/reading: 11 of 40 messages are in the log"]
    assert not result.is_same
