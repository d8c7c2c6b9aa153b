"""The examples under docs/examples, as programs of their own, against the simulated vehicle."""

import subprocess
import sys
from pathlib import Path

import pytest
from tests.groundstation.real_terminal import real_vehicle
from tests.groundstation.services.test_services_with_sitl import simulated

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"

pytestmark = [pytest.mark.sockets, pytest.mark.flight]


def ran(folder: Path, name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(EXAMPLES / name), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=200.0)


def test_a_mission_is_flown_and_followed_and_another_is_paused_in_between(tmp_path: Path) -> None:
    with real_vehicle(tmp_path) as (link, _, _):
        done = ran(tmp_path, "fly_a_mission.py", link, "hop")
        assert done.returncode == 0, done.stderr
        assert "components work; mission" in done.stdout.splitlines()[0]
        assert "disarmed, on ground" in done.stdout
        assert done.stdout.splitlines()[-1] == "done"
        done = ran(tmp_path, "react_to_events.py", link, "hop")
        assert done.returncode == 0, done.stderr
        lines = done.stdout.splitlines()
        states = [line.removeprefix("mission 'hop': ").split()[0] for line in lines if line.startswith("mission")]
        assert states[-3:] == ["paused", "running", "done"], done.stdout
        assert "paused armed" in lines


def test_a_vehicle_without_a_companion_is_commanded_and_its_refusal_is_an_exception(tmp_path: Path) -> None:
    with simulated("px4") as port:
        done = ran(tmp_path, "command_a_vehicle.py", f"udpout://127.0.0.1:{port}", "take_off 3", "land", "mode FLOAT")
        lines = done.stdout.splitlines()
        assert [line.partition(" -> ")[0] for line in lines] == ["take_off 3", "land"], done.stderr
        assert lines[0].startswith("take_off 3 -> armed, in air")
        assert (done.returncode, done.stderr.startswith("not done: it has no mode 'FLOAT'")) == (1, True)


def test_every_example_is_run_here() -> None:
    text = Path(__file__).read_text()
    assert [file.name for file in EXAMPLES.glob("*.py") if f'"{file.name}"' not in text] == []
