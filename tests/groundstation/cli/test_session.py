"""A run of the station in wall time: Ctrl-C ends it cleanly and says what becomes of the vehicle."""

import asyncio
import os
import signal
from collections.abc import Callable
from typing import Any

import pytest

from gloc3_groundstation.assembly import StationSetup
from gloc3_groundstation.cli.ending import Ending
from gloc3_groundstation.cli.run_output import RunOutput
from gloc3_groundstation.cli.session import HeadlessOptions, Session, SessionOptions
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.reporting.lines import NarrationLine

URL = "udpin://127.0.0.1:0"
PLAN = CheckedPlan(name="hold.yaml", title="cargo hold", text="mission: cargo hold\n")


def run(report: Callable[[NarrationLine], None], **options: Any) -> int:
    """The exit code of a run without a terminal."""
    with Ending() as ending:
        session = Session(StationSetup(boot=1), SessionOptions(urls=(URL,), **options), ending)
        return asyncio.run(session.narrate(HeadlessOptions(wait_s=10.0), RunOutput(report))).exit_code


@pytest.mark.sockets
@pytest.mark.parametrize(("plan", "code"), [(None, 0), (PLAN, 130)])
def test_ctrl_c_ends_it_with_a_word(plan: CheckedPlan | None, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    reported: list[NarrationLine] = []

    def report(line: NarrationLine) -> None:
        reported.append(line)
        if "listening" in line.text:
            os.kill(os.getpid(), signal.SIGINT)

    assert run(report, plan=plan) == code
    assert reported[-1].text == "stopped"
    assert capsys.readouterr().err.count("\n") == len(reported)


@pytest.mark.sockets
def test_foxglove_is_served_where_it_was_asked_for_and_the_place_is_told() -> None:
    reported: list[str] = []

    def report(line: NarrationLine) -> None:
        reported.append(line.text)
        if "Foxglove" in line.text:
            os.kill(os.getpid(), signal.SIGINT)

    assert run(report, foxglove_port=0) == 0
    assert any(text.startswith("Foxglove is served, view only: ws://127.0.0.1:") for text in reported)
