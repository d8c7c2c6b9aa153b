"""The Debian package for arm64 on a Debian of its own, by an emulated processor (qemu-user); nothing is installed here."""

import platform
import re
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.commands.programs import program

from gloc3_sitl.demo.demo import free_ports

QEMU = "qemu-user-static"
ENTER = """\
set -e
mount --make-rprivate /
mount -t proc proc "$0/proc"
mount --rbind /dev "$0/dev"
exec chroot "$0" /qemu /opt/gloc3/current/bin/python /opt/gloc3/current/bin/gloc3 "$@"
"""
APT = """\
Dir::State::lists "{0}/lists";
Dir::Cache "{0}/cache";
Dir::State::status "{0}/status";
APT::Architecture "arm64";
APT::Architectures {{ "arm64"; }};
APT::Sandbox::User "root";
"""
MISSION = """\
mission: a hop
platform: copter
frame: site
tasks:
  go:
    actions:
      up: {take_off: {height_m: 3}}
      over: {go_to: {position_m: [5, 0, 3]}, after: [up]}
      down: {land: {}, after: [over]}
"""
HOME = "-35.363261,149.165230,584,0"
"""Origin of the platform's frame `site`."""
MISSION_S = 900.0
START_S = 300
"""Time within which the emulated process must come up, s: it loads ten times slower than here."""


def why_not() -> str:
    """Why there can be no emulation here; empty where there can."""
    missing = [tool for tool in ("apt-get", "dpkg-deb", "unshare", "chroot") if shutil.which(tool) is None]
    return f"{', '.join(missing)} is not installed" if missing else ""


class Emulated:
    """A Debian for arm64 in a folder, with the package and what it depends on, and no more.

    Args:
        folder: which is empty.
        package: the Debian package.
    """

    def __init__(self, folder: Path, package: Path) -> None:
        self.root = folder / "root"
        self._folder, self._package = folder, package

    def make(self) -> None:
        """Fetches and unpacks it all."""
        apt, root = self._folder / "apt", self.root
        for path in (apt / "lists" / "partial", apt / "cache" / "archives" / "partial", root / "proc", root / "dev"):
            path.mkdir(parents=True)
        (apt / "status").touch()
        config = self._folder / "apt.conf"
        config.write_text(APT.format(apt))
        depends = self._run("dpkg-deb", "--field", str(self._package), "Depends")
        names = [re.split(r"[ (]", one.strip())[0] for one in depends.split(",")]
        for words in (
            ["update", "-qq"],
            ["install", "-y", "-qq", "--download-only", "--no-install-recommends", *names],
        ):
            self._run("env", f"APT_CONFIG={config}", "apt-get", *words)
        for file in [*(apt / "cache" / "archives").glob("*.deb"), self._package]:
            self._run("dpkg-deb", "--extract", str(file), str(root))
        version = self._run("dpkg-deb", "--field", str(self._package), "Package").strip().removeprefix("gloc3-")
        (root / "opt/gloc3/current").symlink_to(version)
        qemu = self._folder / "qemu"
        qemu.mkdir()
        self._run("env", "-C", str(qemu), "apt-get", "download", "-qq", QEMU)
        (file,) = qemu.glob("*.deb")
        self._run("dpkg-deb", "--extract", str(file), str(qemu))
        shutil.copy(qemu / "usr/bin/qemu-aarch64-static", root / "qemu")
        for name in ("tmp", "data"):
            (root / name).mkdir(exist_ok=True)

    def command(self, *arguments: str) -> list[str]:
        """The command that runs gloc3 there."""
        return [
            "unshare",
            "--mount",
            "--pid",
            "--fork",
            "--kill-child",
            "bash",
            "-c",
            ENTER,
            str(self.root),
            *arguments,
        ]

    @contextmanager
    def running(self, *arguments: str) -> Iterator["subprocess.Popen[bytes]"]:
        """Runs gloc3 there until the end of the block."""
        process = subprocess.Popen(self.command(*arguments), stdin=subprocess.DEVNULL)
        try:
            yield process
        finally:
            process.kill()
            process.wait()

    @staticmethod
    def _run(*command: str) -> str:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{' '.join(command)}: {done.stderr[-500:]}"
        return done.stdout


def flown(package: Path) -> dict[str, Any]:
    """Version, check of a platform, and a mission that the emulated onboard process flies for a station outside."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        debian = Emulated(folder, package)
        debian.make()
        found: dict[str, Any] = {"here": platform.machine()}
        for name, words in {"version": ["--version"], "check": ["platform", "check", "pelican"]}.items():
            begin_s = time.monotonic()
            done = subprocess.run(debian.command(*words), capture_output=True, text=True, check=False)
            found[name] = (done.stdout or done.stderr).strip()[-120:]
            found[f"{name}_s"] = time.monotonic() - begin_s
        autopilot, ground = free_ports(2, socket.SOCK_DGRAM)
        links = ("--autopilot", f"udpin://127.0.0.1:{autopilot}", "--station", f"udpout://127.0.0.1:{ground}")
        simulated = (
            "sitl",
            "--vehicle",
            "copter",
            f"--home={HOME}",
            "--link",
            f"companion=udpout://127.0.0.1:{autopilot}",
        )
        station = (
            "station",
            "--headless",
            "--mission",
            "hop.yaml",
            "--wait",
            str(START_S),
            "--link",
            f"udpin://127.0.0.1:{ground}",
        )
        (folder / "hop.yaml").write_text(MISSION, encoding="utf-8")
        with (
            program(*simulated, folder=folder),
            debian.running("onboard", "copter", *links, "--out", "/data"),
            program(*station, folder=folder) as running,
        ):
            found["station"] = running.end(MISSION_S)
            found["last"] = running.lines[-1] if running.lines else ""
    return found
