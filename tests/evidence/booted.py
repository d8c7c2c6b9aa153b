"""A systemd of our own, in namespaces of its own: the unit is run by the real service manager, with all its fences."""

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SYSTEMD = Path("/lib/systemd/systemd")
TOOLS = ("unshare", "nsenter", "systemctl", "journalctl", "systemd-analyze")
MINIMAL = "[Unit]\nDescription=What this systemd is for\nDefaultDependencies=no\n"
BOOT = """\
set -e
mount --make-rprivate /
mount -t tmpfs tmpfs /run
mount -t proc proc /proc
mkdir -p /run/over/{upper,work} /run/systemd/system /run/lock
mount -t overlay overlay -o lowerdir=/etc,upperdir=/run/over/upper,workdir=/run/over/work /etc
for folder in /var/lib /var/log /srv; do mount -t tmpfs tmpfs $folder; done
rm -f /etc/machine-id; echo 0123456789abcdef0123456789abcdef > /etc/machine-id
cp "$1" /run/systemd/system/own.target
exec env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin container=other \
    /lib/systemd/systemd --system --unit=own.target --log-target=null --show-status=0
"""
BOOT_S = 30.0


def why_not() -> str:
    """Why there can be none here; empty where there can."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing or not SYSTEMD.exists():
        return f"{', '.join(missing) or SYSTEMD} is not installed"
    return "" if os.geteuid() == 0 else "namespaces with a systemd in them need root"


class Booted:
    """A systemd that has come up."""

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        self._process = process
        self._pid = 0

    def await_up(self) -> None:
        """Waits until it answers."""
        end_s = time.monotonic() + BOOT_S
        while time.monotonic() < end_s:
            children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children").read_text().split()
            self._pid = int(children[0]) if children else 0
            if self._pid and self.run("systemctl", "is-system-running").stdout.strip() in ("running", "degraded"):
                return
            assert self._process.poll() is None, "systemd has ended"
            time.sleep(0.1)
        raise AssertionError("systemd has not come up")

    def run(self, *command: str) -> "subprocess.CompletedProcess[str]":
        """Runs a command where that systemd is."""
        where = ["nsenter", "-t", str(self._pid), "-m", "-p", "-u", "-i", "-C"]
        return subprocess.run([*where, *command], capture_output=True, text=True, check=False)

    def request(self, *command: str) -> str:
        """What a command says; one that fails fails the evidence."""
        done = self.run(*command)
        assert done.returncode == 0, f"{' '.join(command)}: {done.stderr or done.stdout}"
        return done.stdout.strip()

    def property(self, unit: str, name: str) -> str:
        """A property of a unit."""
        return self.request("systemctl", "show", "-p", name, "--value", unit)

    def until(self, unit: str, name: str, value: str, within_s: float) -> float:
        """Waits until a unit's property has a value; how long that took, in seconds."""
        begin_s = time.monotonic()
        while self.property(unit, name) != value:
            assert time.monotonic() - begin_s < within_s, f"{name} of {unit} is {self.property(unit, name)!r}"
            time.sleep(0.05)
        return time.monotonic() - begin_s


@contextmanager
def booted() -> Iterator[Booted]:
    """One that is gone with everything in it at the end of the block."""
    with tempfile.NamedTemporaryFile("w", suffix=".target") as target:
        target.write(MINIMAL)
        target.flush()
        spaces = ["--fork", "--kill-child", "--pid", "--mount", "--uts", "--ipc", "--cgroup"]
        process = subprocess.Popen(["unshare", *spaces, "bash", "-c", BOOT, "boot", target.name])
        try:
            found = Booted(process)
            found.await_up()
            yield found
        finally:
            process.kill()
            process.wait()
