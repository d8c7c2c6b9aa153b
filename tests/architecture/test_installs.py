"""What a plain installation and each extra promise: nothing is imported that they do not bring, and others are named.

The wheel is built from the sdist, as an installer without the repository does; libraries that an extra brings are hidden
by a finder, which is as if they were not installed.
"""

import os
import re
import subprocess
import sys
import tarfile
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from gloc3.cli.program import EXTRAS

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
HIDE = """
import sys
class Hider:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {hidden!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Hider())
from gloc3.cli.program import run
sys.exit(run(sys.argv[1:]))
"""

pytestmark = pytest.mark.thorough


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", re.split(r"[\s<>=!\[;@]", name)[0]).lower()


def modules_of(*extras: str) -> set[str]:
    """Top-level modules of packages that these extras bring, and the plain installation does not."""
    plain = {canonical(each) for each in PROJECT["dependencies"]}
    wanted = {canonical(each) for extra in extras for each in PROJECT["optional-dependencies"][extra]} - plain
    return {
        module
        for module, packages in packages_distributions().items()
        if {canonical(each) for each in packages} & wanted
    }


def gloc3(*arguments: str, without: tuple[str, ...], cwd: Path) -> subprocess.CompletedProcess[str]:
    """The program, where the packages of these extras are not installed."""
    hidden = modules_of(*without)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", HIDE.format(hidden=hidden), *arguments]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=900, check=False)


ALL = tuple(PROJECT["optional-dependencies"])


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (("station", "--web"), "groundstation"),
        (("station", "--headless", "--foxglove", "--wait", "0.1"), "groundstation"),
        (("demo", "hop"), "sitl"),
        (("fly", "hop"), "sitl"),
        (("sitl",), "sitl"),
    ],
)
def test_a_plain_installation_names_the_extra_that_a_command_needs(
    arguments: tuple[str, ...], extra: str, tmp_path: Path
) -> None:
    found = gloc3(*arguments, without=ALL, cwd=tmp_path)
    assert "Traceback" not in found.stderr
    assert f"gloc3[{extra}]" in found.stderr
    assert found.returncode != 0


def test_a_headless_station_runs_in_a_plain_installation(tmp_path: Path) -> None:
    alone = ("--headless", "--link", "udpin://127.0.0.1:0", "--platform", "1", "--do", "hold", "--wait", "0.5")
    found = gloc3("station", *alone, without=ALL, cwd=tmp_path)
    assert "listening on" in found.stderr
    assert "Traceback" not in found.stderr
    assert "gloc3[" not in found.stderr, found.stderr


def test_a_mission_is_flown_with_the_extra_that_is_advised_and_no_other(tmp_path: Path) -> None:
    others = tuple(extra for extra in ALL if extra != "sitl")
    found = gloc3("fly", "hop", "--quiet", without=others, cwd=tmp_path)
    assert found.returncode == 0, found.stderr
    assert "hop: done" in found.stdout


def test_every_extra_that_is_advised_has_the_library() -> None:
    packages = packages_distributions()
    for module, extra in EXTRAS.items():
        brought = {canonical(each) for each in PROJECT["optional-dependencies"][extra]}
        found = {canonical(each) for each in packages.get(module, [])}
        assert found & brought, f"{module} is not brought by gloc3[{extra}]"


def test_the_sdist_has_what_its_makefile_needs_and_builds_the_same_wheel(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build", "-d"]
    subprocess.run([*build, str(tmp_path / "sdist"), "-t", "sdist"], cwd=ROOT, check=True, capture_output=True)
    (archive,) = (tmp_path / "sdist").glob("*.tar.gz")
    with tarfile.open(archive) as file:
        file.extractall(tmp_path / "source", filter="data")
    (source,) = (tmp_path / "source").iterdir()
    for name in ("Makefile", "requirements.txt", "requirements-fuzz.txt", ".ci/run", "tests/conftest.py"):
        assert (source / name).is_file(), name
    subprocess.run([*build, str(tmp_path / "wheel"), "-t", "wheel"], cwd=source, check=True, capture_output=True)
    (wheel,) = (tmp_path / "wheel").glob("*.whl")
    subprocess.run([*build, str(tmp_path / "direct"), "-t", "wheel"], cwd=ROOT, check=True, capture_output=True)
    (direct,) = (tmp_path / "direct").glob("*.whl")
    assert names_in(wheel) == names_in(direct)


def names_in(wheel: Path) -> list[str]:
    from zipfile import ZipFile

    with ZipFile(wheel) as file:
        return sorted(file.namelist())
