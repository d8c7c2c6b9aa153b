"""A component that ends its process is faulty with the signal and the last words, and nobody else feels it."""

import os
import resource
import signal
from itertools import pairwise
from pathlib import Path

import pytest
from tests.onboard.hosts.rig import TICKER, Rig, rig

from gloc3.component.lci import State
from gloc3.log.reader import LogReader
from gloc3.messages.envelope import ComponentStatus

pytestmark = pytest.mark.sockets

PROMPT_S = 1.0
"""What takes some milliseconds on a computer that has nothing else to do."""


def rows(fate: Path) -> str:
    """A ticker and its standby, each in a process of its own."""
    ticks = f'class: "{TICKER}", rate_hz: 50, ports: {{height: height}}'
    return (
        f"  - {{name: ticker, {ticks}, process: one, settings: {{fate: {fate}}},"
        " on_fault: {standby: ticker_standby, reinitialize: {times: 3, back_off_s: 0.1}}}\n"
        f"  - {{name: ticker_standby, {ticks}, process: two, begin: quiet, standby_for: ticker}}\n"
    )


async def both_up(found: Rig) -> None:
    await found.until(lambda: found.state("ticker") is State.WORKING, "the ticker works")
    await found.until(lambda: found.state("ticker_standby") is State.QUIET, "its standby is quiet")
    await found.until(lambda: len(found.received.get("height", [])) > 40, "the ticker is heard")


@pytest.mark.parametrize(
    ("death", "cause"),
    [
        ("segfault", "process one ended by SIGSEGV: Segmentation fault in string_at"),
        ("kill", "process one ended by SIGKILL"),
        ("137", "process one ended with code 137"),
    ],
)
async def test_a_crash_is_faulty_at_once_with_its_words_the_standby_takes_over_and_it_comes_back(
    death: str, cause: str, tmp_path: Path
) -> None:
    fate = tmp_path / "fate"
    async with rig(rows(fate), tmp_path) as found:
        await both_up(found)
        pid, first_boot = found.child("one").pid, found.received["height"][-1][1].source.boot
        if death == "kill":
            os.kill(pid, signal.SIGKILL)
        else:
            fate.write_text(death)
        await found.until(lambda: found.state("ticker") is State.FAULTY, "it is faulty")
        at_s, status = next((t_s, one) for t_s, one in found.statuses if one.state is State.FAULTY)
        last_s = max(t_s for t_s, height in found.received["height"] if height.source.boot == first_boot)
        assert at_s - last_s < PROMPT_S
        assert status.cause.startswith(cause)
        await found.until(lambda: found.state("ticker_standby") is State.WORKING, "the standby takes over")
        elapsed_s, _ = found.first("ticker_standby", State.WORKING, at_s)
        assert elapsed_s - at_s < PROMPT_S
        await found.until(lambda: found.state("ticker") is State.QUIET, "it comes back, and stays quiet")
        assert found.child("one").pid not in (0, pid)
        assert found.child("one").restarts == 1
        statuses = [t_s for t_s, one in found.statuses if one.name == "command_server"]
        assert max(b - a for a, b in pairwise(statuses)) < 1.0 + PROMPT_S, "the rest never stops"
        since_s = found.statuses[-1][0]
        await found.until(lambda: found.received["height"][-1][0] > since_s, "heights go on")
        reported = [event.payload for _, event in found.received["components/ticker/event"]]
        assert any(cause in event.text for event in reported)
    assert not found.child("one").pid
    with LogReader(tmp_path / "log-main-one.mcap") as before, LogReader(tmp_path / "log-main-one-2.mcap") as after:
        assert not before.is_finished, "it was killed"
        assert [entry.envelope.payload for entry in before.entries("height")], "and its log can be read"
        assert after.is_finished


async def test_a_child_whose_loop_does_not_turn_is_ended_and_its_dump_tells_where_it_was(tmp_path: Path) -> None:
    fate = tmp_path / "fate"
    async with rig(rows(fate), tmp_path) as found:
        await both_up(found)
        fate.write_text("hang")
        await found.until(lambda: found.state("ticker") is State.FAULTY, "it is faulty")
        cause = found.child("one").cause
        assert cause.startswith("process one did not run its loop for 2 s and was ended: Aborted")
        await found.until(lambda: found.state("ticker") is State.QUIET, "it comes back")


async def test_a_child_that_cannot_begin_is_faulty_with_what_it_said_until_no_attempt_is_left(tmp_path: Path) -> None:
    row = (
        f'  - {{name: ticker, class: "{TICKER}", rate_hz: 50, process: one,'
        " on_fault: {reinitialize: {times: 1, back_off_s: 0.1}}}\n"
    )
    (tmp_path / "log-main-one-999999.mcap").touch()
    async with rig(row, tmp_path) as found:
        await found.until(lambda: found.child("one").restarts == 1, "it is tried again")
        await found.until(lambda: not found.child("one").pid, "in vain")
        assert "have been numbered up to 999999; move them elsewhere" in found.child("one").cause
        assert found.state("ticker") is State.FAULTY


async def test_the_host_tells_its_processes_with_their_components_and_last_words(tmp_path: Path) -> None:
    async with rig(rows(tmp_path / "fate"), tmp_path) as found:
        await both_up(found)
        os.kill(found.child("two").pid, signal.SIGKILL)
        await found.until(lambda: found.state("ticker_standby") is State.FAULTY, "it is faulty")
        number = len(found.received["hosts/main"])
        await found.until(lambda: len(found.received["hosts/main"]) > number, "the host tells")
        main, one, two = found.received["hosts/main"][-1][1].payload.processes
        assert (main.name, main.pid, main.components) == ("", os.getpid(), ["command_server"])
        assert (one.name, one.phase, one.components) == ("one", "up", ["ticker"])
        assert (two.name, two.phase, two.pid) == ("two", "away", 0)
        assert two.last_words == "process two ended by SIGKILL"
        statuses = [one for _, one in found.statuses if one.name == "ticker" and isinstance(one, ComponentStatus)]
        assert statuses[-1].state is State.WORKING


async def test_the_logs_of_all_child_processes_that_have_stopped_are_named(tmp_path: Path) -> None:
    """No file may grow any more, as on a full disk."""
    async with rig(rows(tmp_path / "fate"), tmp_path) as found:
        await both_up(found)
        assert found.keeper.log_problems() == []
        for child in found.keeper.children:
            resource.prlimit(child.pid, resource.RLIMIT_FSIZE, (1, 1))
        await found.until(lambda: len(found.keeper.log_problems()) > 1, "both are named")
        assert [text.partition(": ")[0] for text in found.keeper.log_problems()] == ["one", "two"]
        assert all("File too large" in text for text in found.keeper.log_problems())
