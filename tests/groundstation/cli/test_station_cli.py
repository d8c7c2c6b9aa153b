"""The command `gloc3 station`: wrong use is told at once, before any link is opened."""

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator, FormatChecker

from gloc3.errors import InputError, Refused
from gloc3_groundstation.cli.station import app

PUBLISHED = Path(__file__).parents[3] / "docs" / "schema" / "station-lines.schema.json"
VALIDATOR = Draft202012Validator(json.loads(PUBLISHED.read_text()), format_checker=FormatChecker())


def run(*arguments: str) -> object:
    return app(list(arguments), exit_on_error=False, print_error=False, result_action="return_value")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--json"], "--json goes with --headless"),
        (["--start"], "need a --mission"),
        (["--headless", "--command", "pause@3s"], "--command and --commands go with --headless and a --mission"),
        (["--headless", "--mission", "hop", "--command", "hover@3s"], "'hover@3s' is no command; one is VERB"),
        (["--headless", "--do", "arm"], "--do goes with --headless and a --platform"),
        (["--platform", "1", "--do", "arm"], "--do goes with --headless and a --platform"),
        (["--headless", "--platform", "1", "--do", "take_off"], "take_off: height above home, m is expected"),
        (["--headless", "--platform", "1", "--do", "arm", "--within", "0"], "--within must be above 0"),
        (["--headless", "--take-over"], "--take-over goes with --headless and a --mission that is started, or --do"),
        (["--far-away-ok"], "--far-away-ok goes with --headless and a --mission"),
        (["--headless", "--wait", "0"], "--wait must be above 0"),
        (["--headless", "--station-id", "1"], "--station-id must be from 200 to 255"),
        (["--headless", "--mission", "nowhere.yaml"], "there is no mission file 'nowhere.yaml'"),
        (["--headless", "--link", "udp://1.2.3.4:5"], "use udpin:// to listen or udpout:// to send"),
        ([], "there is no terminal here; use --headless, or --web for a browser"),
        (["--web", "--headless"], "with --headless there is none"),
        (["--web", "--web-port", "65536"], "--web-port must be from 0 to 65535"),
        (["--headless", "--foxglove-port", "-1"], "--foxglove-port must be from 0 to 65535"),
    ],
)
def test_wrong_use_is_refused_with_the_reason(arguments: list[str], reason: str) -> None:
    with pytest.raises(Refused, match=reason):
        run(*arguments)


def test_a_mission_of_a_name_that_nothing_has_is_wrong_use() -> None:
    with pytest.raises(InputError, match="no such mission"):
        run("--headless", "--mission", "nope")


def lines_of(text: str) -> list[dict[str, Any]]:
    """What is on stdout, each line by the published schema."""
    lines = [json.loads(line) for line in text.splitlines()]
    for line in lines:
        assert [error.message for error in VALIDATOR.iter_errors(line)] == []
    return lines


def test_a_mission_that_does_not_pass_the_check_ends_with_1_and_its_findings_as_data(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text("mission: x\nframe: hold\ntasks: {}\n")
    assert run("--headless", "--json", "--mission", str(file)) == 1
    reported = capsys.readouterr()
    assert "bad.yaml:3" in reported.err
    *findings, end = lines_of(reported.out)
    assert {(one["kind"], one["data"]["file"]) for one in findings} == {("finding", str(file))}
    assert 3 in [one["data"]["line"] for one in findings]
    assert all(one["text"] in reported.err for one in findings)
    assert (end["event"], end["outcome"], end["exit_code"]) == ("end", "failed", 1)


@pytest.mark.sockets
def test_a_platform_that_never_comes_ends_with_5(capsys: pytest.CaptureFixture[str]) -> None:
    link = ("--link", "udpin://127.0.0.1:0")
    assert run("--headless", "--json", "--mission", "hop", *link, "--wait", "0.05") == 5
    reported = capsys.readouterr()
    assert "listening on udpin://127.0.0.1:0" in reported.err
    assert "pelican did not respond" in reported.err, "the mission is written for it"
    *lines, end = lines_of(reported.out)
    assert lines[-1]["data"]["severity"] == "error"
    assert (end["event"], end["outcome"], end["exit_code"]) == ("end", "not_heard", 5)


def test_wrong_use_is_the_last_line_too(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(Refused):
        run("--headless", "--json", "--wait", "0")
    (end,) = lines_of(capsys.readouterr().out)
    assert (end["outcome"], end["exit_code"], end["text"]) == ("wrong_use", 2, "--wait must be above 0 seconds")


def test_a_terminal_prints_no_data(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(Refused):
        run("--json")
    assert capsys.readouterr().out == ""


def test_the_published_schema_is_what_the_command_makes(tmp_path: Path) -> None:
    file = tmp_path / "lines.json"
    assert run("schema", "--out", str(file)) == 0
    assert file.read_text(encoding="utf-8") == PUBLISHED.read_text(encoding="utf-8"), "run `make schema`"


@pytest.mark.sockets
def test_a_bad_configuration_file_is_told_with_its_place_and_the_defaults_are_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "station.toml"
    file.write_text('theme = "dark"\nlink = []\n')
    arguments = ("--config", str(file), "--link", "udpin://127.0.0.1:0", "--wait", "0.05")
    assert run("--headless", "--mission", "hop", *arguments) == 5
    reported = capsys.readouterr().err
    assert f"warning: {file}:2:1: unknown setting 'link' (did you mean 'links'?); the station runs with" in reported
    assert file.read_text() == 'theme = "dark"\nlink = []\n'


def test_the_help_teaches_a_first_flight_with_keys_that_are_so(capsys: pytest.CaptureFixture[str]) -> None:
    from gloc3_groundstation.tui.app import StationApp
    from gloc3_groundstation.tui.keys import MISSION_KEYS
    from gloc3_groundstation.tui.screens.mission import MissionScreen
    from gloc3_groundstation.tui.screens.preflight import PreflightScreen
    from gloc3_groundstation.tui.screens.table import SCREENS

    run("--help")
    reported = " ".join(capsys.readouterr().out.split())
    for words in (
        "3, then o: opens",
        "8: shows whether",
        "s: uploads it and starts it",
        "p pauses, r resumes, a aborts",
    ):
        assert words in reported
    assert {row.key: row.screen for row in SCREENS}.items() >= {"3": MissionScreen, "8": PreflightScreen}.items()
    rows = (*MISSION_KEYS, *MissionScreen.BINDINGS, *StationApp.BINDINGS)
    bound = {key for row in rows for key in (row[0] if isinstance(row, tuple) else row.key).split(",")}
    assert bound >= {"o", "s", "p", "r", "a", "space", "q"}
