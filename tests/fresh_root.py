"""A computer of its own to install on: this one's files below a layer that is gone at the end, in namespaces."""

import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

SETUP = """\
set -e
mount --make-rprivate /
mount -t tmpfs tmpfs /mnt
mkdir -p /mnt/upper /mnt/work /mnt/root
mount -t overlay overlay -o lowerdir=/,upperdir=/mnt/upper,workdir=/mnt/work /mnt/root
mount -t proc proc /mnt/root/proc
mount --rbind /dev /mnt/root/dev
mkdir -p /mnt/root/srv/given
mount --rbind "$1" /mnt/root/srv/given
exec chroot /mnt/root /bin/sh -ec "cd /srv/given; $2"
"""


def why_not() -> str:
    """Why there can be none here; empty where there can."""
    missing = [tool for tool in ("unshare", "chroot", "mount") if shutil.which(tool) is None]
    if missing:
        return f"{', '.join(missing)} is not installed"
    return "" if os.geteuid() == 0 else "a root of its own needs root"


def run_in_fresh_root(
    script: str, folder: Path, environment: Mapping[str, str] | None = None
) -> "subprocess.CompletedProcess[str]":
    """Runs a script of the shell there, in a folder that is this one's.

    Args:
        script: for sh, which ends at the first command that fails.
        folder: seen as /srv/given.
        environment: variables; PATH is that of a system.
    """
    spaces = ["unshare", "--mount", "--pid", "--fork", "--kill-child"]
    return subprocess.run(
        [*spaces, "bash", "-c", SETUP, "fresh", str(folder), script],
        env={"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", **(environment or {})},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
