"""A flight's log with all sensor data: every odometer answers a replay as it did, and the log is changed from the ground."""

from pathlib import Path

import pytest
from tests.flight.card import ONE_STYLE, Card

from gloc3.errors import Refused
from gloc3.log.reader import LogReader
from gloc3.log.replay import render_replay, replay
from gloc3.messages.command_interface import CallFunction, Outcome
from gloc3.messages.topics import TopicTable
from gloc3.platform.reader import load_platform, read_platform

ODOMETERS = ("features", "stereo_odometry", "ground_odometry", "laser_odometry", "optical_follower", "pose")
RECORDED = """
platform: heron
extends: pelican
log: {camera/*: true, imu: true, laser: true, features/*: true, driver: 2}
"""


def close_log(flight: Card) -> None:
    recorder = flight.flight.log.recorder
    assert recorder is not None
    recorder.close()


@ONE_STYLE
def test_every_odometer_is_replayed_from_a_log_with_its_inputs(flight: Card, tmp_path: Path) -> None:
    flight.begin("hop", is_started=False, platform=RECORDED, out=tmp_path / "run")
    flight.wait(0.2)
    close_log(flight)
    topics = TopicTable.installed()
    with LogReader(tmp_path / "run" / "log.mcap", topics.types) as reader:
        platform = read_platform(reader.attachments["platform.yaml"], "platform.yaml")
        for name in ODOMETERS:
            result = replay(reader, platform, name, topics)
            assert result.is_same, f"{name}:\n{render_replay(result)}"
            assert all(found.matched > 20 for found in result.comparisons if "fusion/" not in found.topic)
        states = [entry.envelope.t_s for entry in reader.entries("driver")]
        assert len(states) == pytest.approx(2.0 * (states[-1] - states[0]), abs=1.5)


@ONE_STYLE
def test_what_is_recorded_is_changed_from_the_ground(flight: Card, tmp_path: Path) -> None:
    flight.begin("hop", is_started=False, platform="pelican", out=tmp_path / "run")
    call = CallFunction(component="computer", function="log_topics", arguments={"topics": {"imu": True}})
    begin_s = flight.now_s
    reply = flight.request(call)
    assert reply.outcome is Outcome.ACCEPTED, reply.reason
    assert reply.result == {"topics": {"imu": True}}
    flight.wait(0.5)
    wrong = CallFunction(component="computer", function="log_topics", arguments={"topics": {"imus": True}})
    assert "did you mean 'imu'" in flight.request(wrong).reason
    close_log(flight)
    topics = TopicTable.installed()
    with LogReader(tmp_path / "run" / "log.mcap", topics.types) as reader:
        first = next(reader.entries("imu"))
        assert begin_s <= first.now_s <= begin_s + 0.3
        with pytest.raises(Refused, match="its input laser was not recorded"):
            replay(reader, load_platform("pelican"), "laser_odometry", topics)
