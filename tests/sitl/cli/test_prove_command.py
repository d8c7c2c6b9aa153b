"""`gloc3 prove`: what it lists, refuses, shows and replays."""

import json
from io import StringIO
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from gloc3.cli.program import run
from gloc3.errors import InputError, Refused
from gloc3_sitl.cli.prove import ProveOptions, as_lines, prove
from gloc3_sitl.cli.prove_table import render
from gloc3_sitl.proof.campaign import SearchProgress
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.found import FoundCase
from gloc3_sitl.proof.invariant import BrokenInvariant
from gloc3_sitl.proof.standard_invariants import STANDARD

CASE = FlightCase(mission="hop", platform="pelican_rtk", faults=("crash:pose@8..",))
FOUND = FoundCase(
    broken=BrokenInvariant(invariant="it_ends", t_s=12.0, text="still armed"),
    case=CASE,
    command=CASE.command(),
    folder="runs/prove/found/01-it_ends",
    cause=("must hold: Every flight ends.", "was so:    12.00 s  still armed"),
)
PROGRESS = SearchProgress(
    mission="hop",
    platform="pelican_rtk",
    seed=0,
    flights=32,
    simulated_s=7200.0,
    reached={"event": 40, "mode": 9},
    covered={"crash": {"hop.up": 3, "hop.down": 1}, "wind": {"before the start": 2}},
    phases=["before the start", "hop.up", "hop.stay", "hop.down"],
    states={"done": 30, "failed": 2},
    broken={"it_ends": 1},
    found=[FOUND],
)


def test_the_invariants_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["prove", "--invariants"]) == 0
    out = capsys.readouterr().out
    assert all(f"{kind.name}: {kind.sentence}" in out for kind in STANDARD)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (ProveOptions(), "name a mission"),
        (ProveOptions(fly=True), "name a mission"),
        (ProveOptions(replay=Path("none.json")), "cannot be read"),
    ],
)
def test_wrong_use_is_refused(options: ProveOptions, says: str) -> None:
    with pytest.raises(Refused, match=says):
        prove("", options)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (ProveOptions(fly=True), "--fly goes with --static"),
        (ProveOptions(flights=0), "--flights must be 1 or more"),
        (ProveOptions(minutes=0.0), "--minutes must be more than 0"),
        (ProveOptions(shrink=-1), "--shrink must be 0 or more"),
        (ProveOptions(seed=-1), "--seed must be 0 or more"),
        (ProveOptions(jobs=-3), "--jobs must be 1 or more"),
        (ProveOptions(static=True, flights=3), "about the search, not about --static"),
        (ProveOptions(static=True, ignore=["it_ends"]), "about the search, not about --static"),
        (ProveOptions(ignore=["it_end"]), "did you mean 'it_ends'"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: ProveOptions, says: str) -> None:
    with pytest.raises(Refused, match=says):
        prove("hop", options)


def test_a_world_that_does_not_exist_is_wrong_use() -> None:
    with pytest.raises(InputError, match="no world named 'nope'"):
        prove("hop", ProveOptions(static=True, world="nope"))


def test_a_finding_is_told_with_its_commands_and_its_cause() -> None:
    text = "\n".join(as_lines(PROGRESS))
    assert "32 flights, 2.0 h simulated" in text
    assert "gloc3 fly hop --platform pelican_rtk --fault crash:pose@8.." in text
    assert "gloc3 prove --replay runs/prove/found/01-it_ends/replay.json" in text
    assert "was so:    12.00 s  still armed" in text


def test_the_live_picture_shows_what_is_covered() -> None:
    console = Console(width=120, record=True, file=StringIO())
    console.print(render(PROGRESS, 200))
    text = console.export_text()
    assert "1 it_ends" in text
    row = next(line.split() for line in text.splitlines() if line.split()[:1] == ["crash"])
    assert row == ["crash", "0", "3", "0", "1", "4"]


@pytest.mark.flight
def test_a_static_proof_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    run(["prove", "hop", "--platform", "pelican_rtk", "--static"])
    out = capsys.readouterr().out
    assert "limiter dies, always: limiter_standby takes over within 0.1 s" in out


@pytest.mark.flight
def test_a_replay_file_is_flown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "replay.json"
    file.write_text(FlightCase(mission="hop", platform="pelican_rtk").line())
    out = tmp_path / "runs" / "prove"
    assert run(["prove", "--replay", str(file), "--json", "--out", str(out)]) == 0
    assert json.loads(capsys.readouterr().out)["state"] == "done"
    assert (out / "log.mcap").is_file()


@pytest.mark.flight
def test_a_replayed_flight_that_does_not_begin_has_not_held(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "replay.json"
    file.write_text(FlightCase(mission="hop", platform="pelican_rtk", faults=("crash:limiter@0.5..60",)).line())
    assert run(["prove", "--replay", str(file)]) == 1
    assert "not started" in capsys.readouterr().out


def test_what_was_broken_and_holds_when_it_is_flown_again_is_told() -> None:
    progress = msgspec.structs.replace(PROGRESS, found=[])
    assert as_lines(progress)[-1] == "  broken   1 it_ends: the flights hold when they are flown again"
