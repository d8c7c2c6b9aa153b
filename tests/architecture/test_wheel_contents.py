"""One wheel holds the four packages whole, with what goes by name in them, and nothing else."""

import subprocess
import sys
import tomllib
from pathlib import Path
from zipfile import ZipFile

import pytest

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
PACKAGES = ("common/gloc3", "onboard/gloc3_onboard", "groundstation/gloc3_groundstation", "sitl/gloc3_sitl")
BY_NAME = (
    *(f"{Path(package).name}/py.typed" for package in PACKAGES),
    *(f"gloc3/mission/examples/{name}.yaml" for name in ("hop", "inspection", "patrol", "survey")),
    *(
        f"gloc3_onboard/platforms/{name}.yaml"
        for name in ("boat", "copter", "hummingbird", "pelican", "pelican_rtk", "rover", "submarine")
    ),
    "gloc3_onboard/platforms/bases/vehicle.yaml",
    "gloc3_sitl/world/worlds/hold.yaml",
    "gloc3_sitl/aircraft/aerosonde/aerosonde.xml",
    "gloc3_sitl/aircraft/pelican/pelican.xml",
    "gloc3_sitl/aircraft/quadplane/quadplane.xml",
)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> ZipFile:
    """The wheel, built from the tree as it is."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (file,) = folder.iterdir()
    return ZipFile(file)


def test_the_wheel_is_the_four_packages_and_nothing_else(wheel: ZipFile) -> None:
    sources = {
        str(path.relative_to((ROOT / package).parent))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    packed = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert packed == sources
    assert set(BY_NAME) <= packed


def test_the_wheel_tells_its_extras_licence_and_entry_points(wheel: ZipFile) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (info,) = {name.partition("/")[0] for name in wheel.namelist() if ".dist-info/" in name}
    metadata = wheel.read(f"{info}/METADATA").decode()
    for extra in ("groundstation", "sitl"):
        assert f"Provides-Extra: {extra}" in metadata
    assert f"Requires-Python: {project['requires-python']}" in metadata
    assert {f"{info}/licenses/LICENSE", f"{info}/licenses/NOTICE"} <= set(wheel.namelist())
    points = wheel.read(f"{info}/entry_points.txt").decode()
    assert "gloc3 = gloc3.cli.start:main" in points
    assert all(f"[{group}]" in points for group in project["entry-points"])
