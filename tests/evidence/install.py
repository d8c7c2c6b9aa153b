"""Installation: fresh environments for each Python and extra, both kinds of computers, Debian package and container."""

import os
import platform
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.evidence import emulated
from tests.evidence.page import Bar, Figure, Progress
from tests.fresh_root import run_in_fresh_root, why_not
from tests.release.build import DOCKERFILE, package, release
from tests.release.closure import LOCK, closure, locked
from tests.release.debian import TARGETS
from tests.release.sbom import PROJECT

VERSION = str(PROJECT["version"])
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
COMPUTERS = {"x86_64": "x86_64-manylinux_2_28", "aarch64": "aarch64-manylinux_2_28"}
EXTRAS: dict[str, list[list[str]]] = {
    "": [["--version"], ["platform", "check", "pelican"], ["mission", "check", "hop", "--platform", "pelican_rtk"]],
    "groundstation": [["-c", "import foxglove, mavsdk, gloc3_groundstation.tui.app, gloc3_groundstation.web.server"]],
    "sitl": [["fly", "hop", "--quiet"]],
    "logs": [["log", "--help"]],
    "gpio": [["component", "describe", "payload"]],
    "laser": [["onboard", "--help"]],
    "video": [["onboard", "--help"], ["-c", "import av; av.CodecContext.create('libx264', 'w')"]],
    "token": [["network", "--help"], ["-c", "import pkcs11"]],
    "joystick": [["station", "--help"]],
}
"""Commands of gloc3, or of Python, that must end well with each extra alone."""
AARCH64 = 183
"""Of ELF's e_machine."""


def uv(*arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "uv", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def environments(wheel: Path) -> dict[str, list[str]]:
    """What went wrong in a fresh environment of each Python here with each extra."""
    found: dict[str, list[str]] = {}
    constraints = wheel.parent / "versions.txt"
    constraints.write_text(re.sub(r" \\\n +--hash=\S+", "", LOCK.read_text()), encoding="utf-8")
    for python in PYTHONS:
        place_of = uv("python", "find", "--no-python-downloads", python)
        if place_of.returncode != 0:
            continue
        for extra, commands in EXTRAS.items():
            with tempfile.TemporaryDirectory() as folder:
                place = Path(folder) / "env"
                named = f"gloc3[{extra}] @ {wheel.as_uri()}" if extra else str(wheel)
                steps = [uv("venv", "--python", place_of.stdout.strip(), str(place))]
                into = ["--python", str(place / "bin" / "python")]
                steps += [uv("pip", "install", *into, "-c", str(constraints), named), uv("pip", "check", *into)]
                for command in commands if steps[1].returncode == 0 else ():
                    run = [str(place / "bin" / ("python" if command[0] == "-c" else "gloc3")), *command]
                    steps.append(subprocess.run(run, cwd=folder, capture_output=True, text=True, check=False))
                found[f"Python {python}, gloc3{f'[{extra}]' if extra else ''}"] = [
                    f"{shlex.join(map(str, step.args[-3:]))}: {step.stderr.strip()[-200:]}"
                    for step in steps
                    if step.returncode != 0 or "Traceback" in step.stderr
                ]
    return found


def wheels() -> dict[str, str]:
    """Whether every locked requirement has a wheel: of each computer, Python and extra; empty where it has."""
    found = {}
    for computer, name in COMPUTERS.items():
        for python in PYTHONS[:-1]:
            for extra in EXTRAS:
                with tempfile.TemporaryDirectory() as folder:
                    file = Path(folder) / "requirements.txt"
                    file.write_text(locked(closure([extra] if extra else [])), encoding="utf-8")
                    where = ["--python-platform", name, "--python-version", python, "--target", folder]
                    install = ["pip", "install", "--dry-run", "--no-build", "--require-hashes", *where]
                    done = uv(*install, "-r", str(file))
                missing = re.findall(r"([\w.-]+)==\S+ has no (?:usable )?wheels", done.stderr)
                found[f"{computer}, Python {python}, gloc3{f'[{extra}]' if extra else ''}"] = (
                    "" if done.returncode == 0 else ", ".join(missing) or done.stderr.strip()[-200:]
                )
    return found


def debian(place: Path) -> dict[str, Any]:
    """The package for this computer, installed without a network; and what the one for aarch64 holds."""
    (wheel,) = place.glob("*.whl")
    own, other = (
        next(each for each in TARGETS if each.python == "3.11" and each.architecture == name)
        for name in ("amd64", "arm64")
    )
    found: dict[str, Any] = {}
    file = package(own, VERSION, place / "requirements-vehicle.txt", wheel)
    script = f"unshare --net dpkg --install {file.name}\ngloc3 --version\ngloc3 platform check pelican >/dev/null\necho works"
    done = run_in_fresh_root(script, place)
    found["amd64"] = "works" if "works" in done.stdout.split() else (done.stdout + done.stderr)[-300:]
    file = package(other, VERSION, place / "requirements-vehicle.txt", wheel)
    found["emulated"] = {} if emulated.why_not() else emulated.flown(file)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["dpkg-deb", "--extract", str(file), folder], check=True)
        heads = [(path, path.read_bytes()[:20]) for path in Path(folder).rglob("*.so*") if not path.is_symlink()]
        others = [str(path.name) for path, head in heads if head[:4] == b"\x7fELF" and head[18] != AARCH64]
        found["libraries"], found["foreign"] = len(heads), others
    return found


def container(place: Path) -> str:
    """The container file's commands in a file system of their own; what went wrong, or nothing."""
    text = DOCKERFILE.read_text(encoding="utf-8")
    (copied,) = re.findall(r"^COPY (.*) (\S+)$", text, re.MULTILINE)
    commands = re.findall(r"^RUN (.*)$", text, re.MULTILINE)
    # the image's Python has no manager of packages beside pip; here an environment stands for it
    script = ["python3 -m venv /image", "export PATH=/image/bin:$PATH", f"mkdir -p {copied[1]}"]
    script += [f"cp {copied[0]} {copied[1]}", *commands, "gloc3 --version", "gloc3 platform check rov"]
    kept = {name: os.environ[name] for name in os.environ if name.startswith(("PIP_", "SSL_"))}
    done = run_in_fresh_root("\n".join(script).replace("${VERSION}", VERSION), place, kept)
    return "" if done.returncode == 0 else (done.stdout + done.stderr)[-300:]


def run(progress: Progress) -> list[Figure]:
    """The figures of the page."""
    with tempfile.TemporaryDirectory() as folder:
        place = release(Path(folder), key=None, with_debian=False, report=progress.report)
        (wheel,) = place.glob("*.whl")
        of_pythons = progress.part("environments", lambda: environments(wheel))
        of_computers = progress.part("wheels", wheels)
        figures = [
            Figure(f"fresh environment: {name}", "; ".join(wrong) or "works", "works", not wrong)
            for name, wrong in of_pythons.items()
        ]
        for name, missing in of_computers.items():
            expected = "jsbsim" if name.startswith("aarch64") and name.endswith("[sitl]") else ""
            figures.append(
                Figure(
                    f"wheels for {name}",
                    f"none of {missing}" if missing else "all",
                    f"none of {expected}" if expected else "all",
                    missing == expected,
                )
            )
        if reason := why_not():
            return [*figures, Figure("Debian package and container", f"not tried: {reason}", "tried", False)]
        packages = progress.part("debian", lambda: debian(place))
        wrong = progress.part("container", lambda: container(place))
    foreign, arm64 = packages["foreign"], packages["emulated"]
    return [
        *figures,
        Figure(
            "Debian package for amd64, installed with no network",
            packages["amd64"],
            "works",
            packages["amd64"] == "works",
        ),
        Figure(
            "Debian package for arm64: libraries that are none of aarch64",
            f"{len(foreign)} of {packages['libraries']}",
            "0",
            not foreign,
        ),
        *_emulated(arm64),
        Figure(f"commands of the container file, on {platform.machine()}", wrong or "work", "work", not wrong),
    ]


def _emulated(arm64: dict[str, Any]) -> list[Figure]:
    if not arm64:
        return [Figure("Debian package for arm64, emulated", f"not tried: {emulated.why_not()}", "tried", False)]
    title = f"Debian package for arm64 with what it depends on, emulated on {arm64['here']}"
    is_flown = arm64["station"] == 0
    return [
        Figure(
            f"{title}: gloc3 --version", arm64["version"], f"gloc3 {VERSION}", arm64["version"] == f"gloc3 {VERSION}"
        ),
        Figure("… took, in s", f"{arm64['version_s']:.1f}"),
        Figure("… checks the Pelican's platform file", arm64["check"], "can be used", "can be used" in arm64["check"]),
        Figure("… took, in s", f"{arm64['check_s']:.1f}"),
        Figure("… flies a mission for a station and a simulator outside", arm64["last"], "done", is_flown),
    ]


BARS = (
    Bar(
        "install",
        "Installation",
        "Fresh environments of every Python on this machine, with each extra alone, run what the extra is for; every locked "
        "requirement has a wheel for both kinds of computers, but JSBSim for aarch64; the Debian package installs without a "
        "network, and the container file's commands work. The package for arm64 flies a mission on an emulated processor.",
        run,
    ),
)
