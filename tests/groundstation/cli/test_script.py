"""Commands of a script to the headless station: their grammar, their times, and lines of them that come in."""

import asyncio
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.groundstation.scripted_platform import ScriptedPlatform, refused

from gloc3.clock import run_virtual
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import Steer, Verb
from gloc3_groundstation.cli.headless import Headless
from gloc3_groundstation.cli.script import ScriptCommand, parse_command, read_lines
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.reporting.lines import CommandData, NarrationLine
from gloc3_groundstation.station.station import Station

PLAN = CheckedPlan(name="hold.yaml", title="cargo hold", text="mission: cargo hold\n")


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ("pause@30s", ScriptCommand(verb=Verb.PAUSE, at_s=30.0)),
        ("resume", ScriptCommand(verb=Verb.RESUME)),
        (" skip sweep.wall @ 1.5 ", ScriptCommand(verb=Verb.SKIP, target="sweep.wall", at_s=1.5)),
        ("abort sweep@60s", ScriptCommand(verb=Verb.ABORT, target="sweep", at_s=60.0)),
    ],
)
def test_a_command_is_a_verb_perhaps_a_target_and_a_time(text: str, command: ScriptCommand) -> None:
    assert parse_command(text) == command


@pytest.mark.parametrize("text", ["", "hold", "pause@", "pause@soon", "pause@-1s", "start@3s", "skip a b", "pause@1e9"])
def test_what_is_no_command_is_refused_with_the_form(text: str) -> None:
    with pytest.raises(Refused, match="one is VERB"):
        parse_command(text)


def test_a_skip_needs_something_to_skip() -> None:
    with pytest.raises(Refused, match="what to skip"):
        parse_command("skip@3s")


def flown(*commands: str, arrange: Callable[[ScriptedPlatform, Headless], None] | None = None) -> list[NarrationLine]:
    """What is told of a run with these commands, on a platform whose mission is done 60 s after its start."""
    reported: list[NarrationLine] = []

    async def main() -> None:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        station = Station(exchange, platform.loop, "255", 11)
        platform.loop.call_later(1.2, platform.speak_every, 0.5)
        platform.loop.call_later(80.0, platform.advance, "done")
        run = Headless(station, reported.append, platform="heron")
        for text in commands:
            run.command(parse_command(text))
        if arrange is not None:
            arrange(platform, run)
        try:
            await run.fly(PLAN, wait_s=20.0)
        finally:
            station.close()
        steered = [(one.verb, one.target) for one in platform.requests if isinstance(one, Steer)]
        assert steered == [(Verb.START, ""), *((one.verb, one.target) for one in commands_of(reported))]

    run_virtual(main())
    return reported


def told(lines: list[NarrationLine]) -> list[NarrationLine]:
    return [line for line in lines if line.kind == "command"]


def commands_of(lines: list[NarrationLine]) -> list[CommandData]:
    return [line.data for line in lines if isinstance(line.data, CommandData)]


def test_commands_are_sent_at_their_times_after_the_start_and_told() -> None:
    lines = flown("resume@20s", "pause@10s", "skip sweep.wall@30")
    started_s = next(line.t_s for line in lines if line.text == "the mission is started")
    assert [line.text for line in told(lines)] == [
        "pause the mission: accepted",
        "resume the mission: accepted",
        "skip sweep.wall: accepted",
    ]
    assert [line.t_s - started_s for line in told(lines)] == pytest.approx([10.0, 20.0, 30.0], abs=0.3)
    assert commands_of(lines)[2] == CommandData(verb="skip", target="sweep.wall", is_accepted=True, reason="")


def test_a_refused_command_is_told_and_ends_nothing() -> None:
    def arrange(platform: ScriptedPlatform, run: Headless) -> None:
        del run
        answer = refused("it is not paused")
        platform.loop.call_later(25.0, platform.answer_next, Steer, answer)

    lines = flown("resume@30s", arrange=arrange)
    (line,) = told(lines)
    assert line.text == "warning: resume the mission: refused: it is not paused"
    assert line.data == CommandData(verb="resume", target="", is_accepted=False, reason="it is not paused")
    assert lines[-1].text.startswith("'cargo hold': done")


def test_a_command_that_comes_while_the_mission_runs_is_sent_at_once() -> None:
    def arrange(platform: ScriptedPlatform, run: Headless) -> None:
        platform.loop.call_later(40.0, run.command, parse_command("abort"))

    (line,) = told(flown(arrange=arrange))
    assert line.t_s == pytest.approx(40.0, abs=0.7)


def test_a_command_that_comes_before_the_start_waits_for_it() -> None:
    lines = flown("pause")
    assert told(lines)[0].t_s >= next(line.t_s for line in lines if line.text == "the mission is started")


def lines_of(descriptor: int, write: Callable[[], None] | None = None) -> list[str]:
    async def main() -> list[str]:
        loop, found = asyncio.get_running_loop(), list[str]()
        ended = asyncio.Event()

        def receive(line: str) -> None:
            found.append(line)
            if line == "end":
                ended.set()

        stop = read_lines(loop, descriptor, receive)
        if write is not None:
            write()
        await asyncio.wait_for(ended.wait(), 5.0)
        stop()
        return found

    return asyncio.run(main())


@pytest.mark.sockets
def test_lines_are_read_from_a_pipe_as_they_come_the_last_without_its_end() -> None:
    read_end, write_end = os.pipe()

    def write() -> None:
        os.write(write_end, b"pause@1s\n\nresu")
        os.write(write_end, b"me@2s\nend")
        os.close(write_end)

    try:
        assert lines_of(read_end, write) == ["pause@1s", "resume@2s", "end"]
    finally:
        os.close(read_end)


def test_lines_are_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "script"
    file.write_text("pause@1s\nend\n")
    with file.open() as opened:
        assert lines_of(opened.fileno()) == ["pause@1s", "end"]
