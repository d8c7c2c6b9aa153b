"""The shell completes what the program has: the script is run by a real bash."""

import shutil
import subprocess
from pathlib import Path

import pytest

from gloc3.cli.program import run
from gloc3.installed import installed_points

pytestmark = pytest.mark.thorough

ASK = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}
_gloc3
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The script for bash."""
    file = tmp_path_factory.mktemp("completion") / "gloc3.bash"
    if shutil.which("bash") is None:
        pytest.skip("there is no bash here")
    return file


def completed(script: Path, *words: str) -> set[str]:
    found = subprocess.run(["bash", "-c", ASK, "ask", str(script), *words], capture_output=True, text=True, check=True)
    return set(found.stdout.split())


def test_commands_options_and_choices_are_completed(script: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["completion", "bash"]) == 0
    script.write_text(capsys.readouterr().out)
    assert completed(script, "gloc3", "") == {point.name for point in installed_points("gloc3.commands")}
    assert completed(script, "gloc3", "log", "con") == {"convert"}
    assert completed(script, "gloc3", "log", "convert", "--to", "") >= {"kml", "gpx", "csv", "parquet", "rosbag2"}
    assert "--origin" in completed(script, "gloc3", "log", "convert", "--")


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_a_script_too(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["completion", shell]) == 0
    assert "convert" in capsys.readouterr().out
