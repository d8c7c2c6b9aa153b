"""The parts of a release: wheel, sdist, lock, Debian packages, container file, bill of materials, notes, checksums, signature."""

import hashlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from tests.house.notice import ROOT
from tests.release.closure import VEHICLE, closure, locked
from tests.release.debian import TARGETS, Target, install_for, lay, pack
from tests.release.notes import is_tagged, notes, obstacles
from tests.release.sbom import PROJECT, bill

from gloc3_onboard.service.release_files import CHECKSUMS, NAMESPACE

REQUIREMENTS: Final = "requirements-vehicle.txt"
NOTES: Final = "RELEASE-NOTES.md"
DOCKERFILE: Final = Path(__file__).parent / "Dockerfile"

Report = Callable[[str], None]


def release(folder: Path, *, key: Path | None, with_debian: bool, report: Report) -> Path:
    """Builds everything into a folder of its version, which is replaced; returns that folder.

    Args:
        folder: for the version's folder.
        key: private key that signs the checksums.
        with_debian: whether Debian packages are made.
        report: called with a line for each part.

    Raises:
        ValueError: the version is not ready; says why.
    """
    version = str(PROJECT["version"])
    tagged = is_tagged(version)
    if found := list(obstacles(version, is_tagged=tagged)):
        raise ValueError("\n".join(found))
    place = folder / f"gloc3-{version}"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    for kind in ("sdist", "wheel"):
        build = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(place)]
        subprocess.run(build, cwd=ROOT, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    (wheel,) = place.glob("*.whl")
    requirements = place / REQUIREMENTS
    requirements.write_text(locked(closure(VEHICLE)), encoding="utf-8")
    shutil.copy(DOCKERFILE, place)
    (place / f"gloc3-{version}.cdx.json").write_text(bill(), encoding="utf-8")
    (place / NOTES).write_text(notes(version), encoding="utf-8")
    for target in TARGETS if with_debian else ():
        report(f"Debian package: {package(target, version, requirements, wheel).name}")
    files = sorted(path for path in place.iterdir() if path.is_file())
    (place / CHECKSUMS).write_text(checksums(files), encoding="ascii")
    for path in files:
        report(f"{path.stat().st_size / 1e6:8.1f} MB  {path}")
    if not tagged:
        report(f"not the released version: no tag v{version} names this commit")
    if key is None:
        report("unsigned: no key is given (make release KEY=FILE, a private key of OpenSSH)")
    else:
        report(f"signed: {sign(place / CHECKSUMS, key)}")
    return place


def package(target: Target, version: str, requirements: Path, wheel: Path) -> Path:
    """Makes the Debian package of a target, beside the wheel."""
    with tempfile.TemporaryDirectory() as place:
        site, tree = Path(place) / "site", Path(place) / "tree"
        install_for(target, requirements, wheel, site)
        lay(target, version, site, tree)
        return pack(target, version, tree, wheel.parent)


def checksums(files: Iterable[Path]) -> str:
    """Checksums of files, as sha256sum(1) reads them."""
    return "".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files)


def sign(file: Path, key: Path) -> Path:
    """Signs a file with a key of OpenSSH; returns the signature's file."""
    sign = ["ssh-keygen", "-q", "-Y", "sign", "-f", str(key), "-n", NAMESPACE, str(file)]
    subprocess.run(sign, check=True, stderr=subprocess.DEVNULL)
    return file.with_name(f"{file.name}.sig")
