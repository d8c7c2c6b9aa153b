"""`gloc3 station --headless --do …` against the simulated vehicle: done, refused, and not heard, by exit code and data."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.groundstation.services.test_services_with_sitl import simulated

pytestmark = [pytest.mark.sockets, pytest.mark.flight]


def ran(folder: Path, url: str, *arguments: str) -> tuple[int, list[dict[str, Any]]]:
    """The exit code of a run, and its lines."""
    command = [
        sys.executable,
        "-m",
        "gloc3",
        "station",
        "--headless",
        "--json",
        "--no-record",
        "--link",
        url,
        *arguments,
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=200.0)
    return done.returncode, [json.loads(line) for line in done.stdout.splitlines()]


def outcomes(lines: list[dict[str, Any]]) -> list[tuple[str, str]]:
    return [(line["data"]["command"], line["data"]["outcome"]) for line in lines if line["kind"] == "order"]


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_a_bare_vehicle_is_commanded_step_by_step_and_a_refusal_ends_the_run(style: str, tmp_path: Path) -> None:
    with simulated(style) as port:
        url = f"udpout://127.0.0.1:{port}"
        code, lines = ran(
            tmp_path, url, "--platform", "1", "--do", "arm", "--do", "take_off 5", "--do", "hold", "--do", "land"
        )
        assert outcomes(lines) == [("arm", "done"), ("take off 5", "done"), ("hold", "done"), ("land", "done")]
        assert (code, lines[-1]["outcome"]) == (0, "done")
        up = next(line for line in lines if line["text"].startswith("take off 5: done"))
        assert "armed, in air" in up["text"]
        name = {"px4": "px4-1", "ardupilot": "ardupilot-1"}[style]
        code, lines = ran(tmp_path, url, "--platform", name, "--do", "mode FLOAT", "--do", "arm")
        assert outcomes(lines) == [("mode FLOAT", "refused")]
        (order,) = (line for line in lines if line["kind"] == "order")
        assert order["text"].startswith("error: mode FLOAT: refused: it has no mode 'FLOAT'")
        assert order["text"].endswith("; not sent: arm")
        assert (code, lines[-1]["outcome"], lines[-1]["exit_code"]) == (4, "refused", 4)


def test_a_selection_of_vehicles_is_commanded_at_the_same_time_with_a_line_for_each(tmp_path: Path) -> None:
    with simulated("px4") as first, simulated("ardupilot") as second:
        both = (f"udpout://127.0.0.1:{first}", "--link", f"udpout://127.0.0.1:{second}")
        names = ("--platform", "px4-1", "--platform", "nobody", "--platform", "ardupilot-1")
        code, lines = ran(tmp_path, *both, *names, "--wait", "8", "--do", "arm")
        found = {line["platform"]: line["data"]["outcome"] for line in lines if line["kind"] == "order"}
        assert found == {"px4-1": "done", "nobody": "not_heard", "ardupilot-1": "done"}
        assert (code, lines[-1]["outcome"]) == (5, "not_heard")
        code, lines = ran(tmp_path, *both, "--platform", "all", "--do", "disarm")
        found = {line["platform"]: line["data"]["outcome"] for line in lines if line["kind"] == "order"}
        assert found == {"px4-1": "done", "ardupilot-1": "done"}
        assert (code, lines[-1]["text"]) == (0, "done")


def test_a_vehicle_that_is_not_there_is_not_heard(tmp_path: Path) -> None:
    code, lines = ran(tmp_path, "udpin://127.0.0.1:0", "--platform", "7", "--wait", "0.2", "--do", "arm")
    assert (code, lines[-1]["outcome"]) == (5, "not_heard")


def test_a_submarine_has_landed_when_it_is_at_the_surface(tmp_path: Path) -> None:
    with simulated("ardupilot", "--vehicle", "auv") as port:
        url, dive = f"udpout://127.0.0.1:{port}", ("--do", "mode GUIDED", "--do", "go_to 47.39775 8.5456 -3")
        code, lines = ran(tmp_path, url, "--platform", "1", "--within", "6", "--do", "arm", *dive)
        done = [("arm", "done"), ("mode GUIDED", "done"), ("go to 47.39775 8.5456 -3", "failed")]
        assert (code, outcomes(lines)) == (1, done), "it has no position under water"
        code, lines = ran(tmp_path, url, "--platform", "1", "--within", "30", "--do", "land")
        assert (code, outcomes(lines)) == (0, [("land", "done")])
        assert "armed" in lines[-2]["text"]
        assert "mode ALT_HOLD" in lines[-2]["text"]
