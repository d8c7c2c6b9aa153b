"""A log of version 0.1 is read by everything that reads logs."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from gloc3.log.cli import app
from gloc3.log.reader import LogReader
from gloc3.log.record import PLATFORM_FILE
from gloc3.log.replay import replay
from gloc3.messages.envelope import Message
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Pose
from gloc3.platform.reader import read_platform

from .released import LOG

MESSAGES = 2523


def run(*arguments: object) -> Any:
    return app([str(argument) for argument in arguments], exit_on_error=True, result_action="return_value")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A copy, because pictures lie beside the log."""
    return Path(shutil.copy(LOG, tmp_path))


def test_every_message_in_it_is_of_a_known_type() -> None:
    with LogReader(LOG) as reader:
        entries = list(reader.entries())
        assert not reader.losses()
    assert len(entries) == MESSAGES
    unknown = {entry.envelope.type for entry in entries if not isinstance(entry.envelope.payload, Message)}
    assert not unknown
    poses = [entry.envelope.payload for entry in entries if isinstance(entry.envelope.payload, Pose)]
    assert len(poses) > 200
    assert min(pose.position_ned_m[2] for pose in poses) == pytest.approx(-0.4, abs=0.1)


def test_info_summarizes_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", LOG) == 0
    text = capsys.readouterr().out
    assert "finished" in text
    assert "platform pelican, virtual time" in text
    assert "no warnings or errors" in text


def test_its_commands_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("commands", LOG) == 0
    text = capsys.readouterr().out
    assert "LoadMission" in text
    assert "Steer" in text


@pytest.mark.thorough  # draws pictures
@pytest.mark.parametrize("what", [("path",), ("components",), ("pose", "position_ned_m"), ("height",)], ids="-".join)
def test_it_is_plotted(log: Path, what: tuple[str, ...]) -> None:
    assert run("plot", log, *what) == 0
    assert list(log.parent.glob("*.svg"))


@pytest.mark.parametrize("component", ["hold", "limiter", "take_off"])
def test_a_component_is_replayed_on_it(component: str) -> None:
    """By the platform file in the log: how well the outputs agree is a matter of the component, not of the log."""
    topics = TopicTable.installed()
    with LogReader(LOG, topics.types) as reader:
        platform = read_platform(reader.attachments[PLATFORM_FILE], PLATFORM_FILE)
        comparisons = replay(reader, platform, component, topics).comparisons
    assert comparisons
    assert all(found.matched == found.recorded > 0 for found in comparisons)
