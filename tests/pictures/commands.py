"""Pictures in the docs that commands of `gloc3` write: of missions, of flights, and of an inspection's report."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

import cv2

ROOT: Final = Path(__file__).parents[2]
GLOC3: Final = str(Path(sys.executable).with_name("gloc3"))
FLOOR: Final = ROOT / "sitl/gloc3_sitl/world/worlds/hold.yaml"
CONTACT_WIDTH_PX: Final = 960
JPEG_QUALITY: Final = 75


def missions(folder: Path, scratch: Path) -> None:
    """The plan view of an example mission, with its order over time."""
    _run("mission", "show", "inspection", "--svg", str(folder / "mission-inspection.svg"))


def inspection(folder: Path, scratch: Path) -> None:
    """The path of an inspection, and the report of its pictures."""
    run = scratch / "inspection"
    _run("fly", "inspection", "--out", str(run), "--quiet")
    shutil.copy(run / "path.svg", folder.parent / "inspection.svg")
    _run("log", "report", str(run), "--wall", f"{FLOOR}#floor", "--farthest", "6", "--oblique", "68")
    shutil.copy(run / "report/coverage.svg", folder / "report-coverage.svg")
    sheet = cv2.imread(str(run / "report/contact.png"))
    assert sheet is not None
    sheet = sheet[: sheet.shape[0] * 4 // 9]  # the upper rows
    height, width = sheet.shape[:2]
    small = cv2.resize(sheet, (CONTACT_WIDTH_PX, height * CONTACT_WIDTH_PX // width), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "report-contact.jpg"), small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def components(folder: Path, scratch: Path) -> None:
    """The states of the components of a flight in which two of them fail."""
    run = scratch / "hop"
    _run("fly", "hop", "--fault", "crash:limiter@8", "--fault", "crash:height@9..13", "--out", str(run), "--quiet")
    _run("log", "plot", str(run), "components", "--out", str(folder / "components.svg"))


def found(folder: Path, scratch: Path) -> None:
    """The flight that `gloc3 prove` once found to go wrong."""
    run = scratch / "found"
    _run(
        "fly",
        "hop",
        "--platform",
        "pelican_rtk",
        "--seed",
        "2",
        "--fault",
        "crash:autopilot_driver@3.9",
        "--out",
        str(run),
        "--quiet",
    )
    shutil.copy(run / "path.svg", folder / "proof-found.svg")


def _run(*arguments: str) -> None:
    subprocess.run([GLOC3, *arguments], check=True, stdout=subprocess.DEVNULL)
