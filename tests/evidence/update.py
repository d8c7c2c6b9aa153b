"""`gloc3 update` under a real systemd: a version that works, one that does not, one that is refused, and back."""

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from tests.evidence.booted import Booted, booted, why_not
from tests.evidence.page import ROOT, Bar, Figure, Progress
from tests.evidence.service import FOLDER, GLOC3, ON_SOCKETS, UNIT
from tests.onboard.service.test_service import PLATFORM, STUCK
from tests.release.sbom import PROJECT

HOME = "/srv/gloc3"
FIRST, GOOD, BAD, REFUSED = str(PROJECT["version"]), "7.2.0", "7.3.0", "7.4.0"
SAMPLER = f"import gloc3\nassert gloc3.__version__ != '{REFUSED}', 'not with this version'\n{STUCK}".replace(
    "    def initialize(self, settings):",
    f"    def initialize(self, settings):\n        assert gloc3.__version__ != '{BAD}', 'broken'",
)
"""A sampler that version BAD cannot bring up, and version REFUSED cannot load."""


def reversioned(wheel: Path, version: str) -> None:
    """The wheel as another version of itself, beside it."""
    with ZipFile(wheel) as old, ZipFile(wheel.with_name(wheel.name.replace(FIRST, version)), "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name.endswith(("/METADATA", "gloc3/__init__.py")):
                content = re.sub(rf'(Version: |__version__ = "){FIRST}'.encode(), rf"\g<1>{version}".encode(), content)
            new.writestr(name.replace(f"gloc3-{FIRST}.dist-info", f"gloc3-{version}.dist-info"), content)


def dependencies(folder: Path) -> Path:
    """What is installed here but GLOC3 itself, as a folder for PYTHONPATH: nothing is fetched."""
    (site,) = (Path(place) for place in sys.path if place.endswith("site-packages"))
    folder.mkdir()
    for path in site.iterdir():
        if "gloc3" not in path.name:
            (folder / path.name).symlink_to(path)
    return folder


class Computer:
    """A service that runs the version in use below HOME."""

    def __init__(self, systemd: Booted, wheels: Path, path: str) -> None:
        self._systemd, self._wheels, self._path = systemd, wheels, path

    def gloc3(self, program: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """Runs gloc3 there."""
        return self._systemd.run("env", f"PYTHONPATH={self._path}", program, *arguments)

    def update(self, version: str, *options: str, program: str = f"{HOME}/current/bin/gloc3") -> dict[str, Any]:
        """Updates by a wheel; what came of it."""
        wheel = [str(self._wheels / f"gloc3-{version}-py3-none-any.whl")] if version else []
        pid, begin_s = self._systemd.property(UNIT, "MainPID"), time.monotonic()
        done = self.gloc3(
            program,
            "update",
            *wheel,
            f"--home={HOME}",
            f"--wheels={self._wheels}",
            "--extras=",
            "--within=40",
            *options,
        )
        took_s = time.monotonic() - begin_s
        time.sleep(1.0)
        end_s = time.monotonic() + 30.0
        while "2 of 2" not in self._systemd.property(UNIT, "StatusText") and time.monotonic() < end_s and pid != "0":
            time.sleep(0.2)
        main = self._systemd.property(UNIT, "MainPID")
        words = self._systemd.run("cat", f"/proc/{main}/cmdline").stdout.split("\0") if main != "0" else [""]
        return {
            "code": done.returncode,
            "said": done.stderr,
            "s": took_s,
            "runs": words[0].removeprefix(f"{HOME}/").partition("/")[0],
            "status": self._systemd.property(UNIT, "StatusText"),
            "is_same": main == pid,
        }


def life(progress: Progress) -> dict[str, Any]:
    """First installation, update, roll-back, refusal and the way back."""
    with tempfile.TemporaryDirectory() as folder, booted() as systemd:
        wheels = Path(folder)
        wheels.chmod(0o755)  # the service's user reads it
        build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(wheels)]
        subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
        (wheel,) = wheels.glob("*.whl")
        for version in (GOOD, BAD, REFUSED):
            reversioned(wheel, version)
        path = f"{FOLDER}:{dependencies(wheels / 'site')}"
        write = ["sh", "-c", 'mkdir -p "$(dirname "$1")" && printf %s "$2" > "$1"', "write"]
        for name, text in {
            f"{FOLDER}/bench.yaml": PLATFORM,
            f"{FOLDER}/stuck_sampler.py": SAMPLER,
            f"/run/systemd/system/{UNIT}.service.d/bench.conf": "[Unit]\nDefaultDependencies=no\n"
            f"[Service]\nEnvironment=PYTHONPATH={path}\nPrivateTmp=no\n",
        }.items():
            systemd.request(*write, name, text)
        systemd.request("systemctl", "start", "systemd-journald")
        computer = Computer(systemd, wheels, path)
        found: dict[str, Any] = {"first": computer.update(FIRST, program=GLOC3)}
        installed = computer.gloc3(
            f"{HOME}/current/bin/gloc3", "onboard", "install", f"{FOLDER}/bench.yaml", *ON_SOCKETS
        )
        assert installed.returncode == 0, installed.stderr
        systemd.request("systemctl", "start", UNIT)
        progress.report("the first version is up")
        found["unforced"] = computer.update(GOOD)
        found["good"] = computer.update(GOOD, "--force")
        found["bad"] = computer.update(BAD, "--force")
        found["refused"] = computer.update(REFUSED, "--force")
        found["back"] = computer.update("", "--back", "--force")
        found["list"] = computer.gloc3(f"{HOME}/current/bin/gloc3", "update", f"--home={HOME}").stdout
    return found


def run(progress: Progress) -> list[Figure]:
    """The figures of the page."""
    if reason := why_not():
        return [Figure("under a real systemd", f"not tried: {reason}", "tried", False)]
    found = progress.part("life", lambda: life(progress))

    def figure(title: str, name: str, code: int, runs: str) -> list[Figure]:
        is_met = found[name]["code"] == code
        word = "2 of 2 components work"
        return [
            Figure(f"{title}: exit code", str(found[name]["code"]), str(code), is_met),
            Figure("… the service runs", found[name]["runs"] or "-", runs or "-", found[name]["runs"] == runs),
            *([Figure("… its status", found[name]["status"], word, word in found[name]["status"])] if runs else []),
            Figure("… took, in s", f"{found[name]['s']:.0f}"),
        ]

    refused = found["refused"]
    return [
        *figure("first version, from a wheel", "first", 0, ""),
        *figure("a version that works, without an autopilot and without --force", "unforced", 2, FIRST),
        *figure("a version that works", "good", 0, GOOD),
        *figure("a version whose required component does not come up", "bad", 1, GOOD),
        Figure("… says", "going back", "going back", f"going back to gloc3 {GOOD}" in found["bad"]["said"]),
        *figure("a version that cannot load a component", "refused", 2, GOOD),
        Figure("… the service was not restarted", str(refused["is_same"]), "True", refused["is_same"]),
        *figure("--back", "back", 0, FIRST),
        Figure("the list names the version in use", FIRST, FIRST, f"{FIRST}  in use" in found["list"]),
    ]


BARS = (
    Bar(
        "update",
        "An update that does not work takes itself back",
        "Under a real systemd (in namespaces of its own) `gloc3 update` installs another version beside the one in use, checks "
        "it, switches, restarts the service, and goes back by itself when the service does not come up as it was.",
        run,
    ),
)
