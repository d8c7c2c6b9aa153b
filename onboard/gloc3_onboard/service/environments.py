"""Versions of GLOC3 on a computer: an environment each, side by side, and a link to the one in use."""

import fcntl
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from gloc3.errors import Refused
from gloc3.store import replace_link
from gloc3_onboard.service.release_files import SIGNERS, verify

HOME: Final = Path("/opt/gloc3")
CURRENT: Final = "current"
PREVIOUS: Final = "previous"
EXTRAS: Final = ("gpio", "groundstation", "laser")
"""Extras that a new environment gets, as the Debian package has them."""
_UNFINISHED: Final = ".unfinished"
_VERSION: Final = re.compile(r"\d+(\.\d+)*((a|b|rc)\d+)?(\.post\d+)?(\.dev\d+)?(\+[a-z0-9.]+)?")
_PARTIAL: Final = ("half-installed", "unpacked", "half-configured")
"""States of a package whose installation has ended half-way."""
_LINES: Final = 6
"""Last lines of a failed command that a refusal quotes."""

Report = Callable[[str], None]


class Environments:
    """The versions below a folder.

    Args:
        home: the folder.
        report: called with each step.
    """

    def __init__(self, home: Path, report: Report) -> None:
        self.home: Final = home
        self._report = report
        keys = home / SIGNERS
        self._signers = keys if keys.exists() else None

    @property
    def versions(self) -> list[str]:
        """Versions that are installed."""
        found = (path.parent for path in self.home.glob("*/pyvenv.cfg") if not path.parent.is_symlink())
        return sorted(path.name for path in found if not (path / _UNFINISHED).exists())

    @property
    def current(self) -> str:
        """The version in use; empty for none."""
        return self._target(CURRENT)

    @property
    def previous(self) -> str:
        """The version that was in use before; empty for none."""
        return self._target(PREVIOUS)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keeps other updates away until the end of the block; folders that it made and that are empty then go again.

        Raises:
            Refused: one is going on, or the folder cannot be written.
        """
        made = [folder for folder in (self.home, *self.home.parents) if not folder.exists()]
        try:
            self.home.mkdir(parents=True, exist_ok=True)
            folder = os.open(self.home, os.O_RDONLY | os.O_DIRECTORY)
        except OSError as error:
            raise Refused(f"{self.home} cannot be written: {error.strerror}; run it with sudo") from error
        try:
            if not os.access(self.home, os.W_OK):
                raise Refused(f"{self.home} cannot be written; run it with sudo")
            try:
                fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise Refused(f"another update of {self.home} is going on") from error
            yield
        finally:
            with suppress(OSError):  # one that is not empty stays
                for each in made:
                    each.rmdir()
            os.close(folder)

    def program(self, version: str) -> Path:
        """The program of a version."""
        return self.home / version / "bin" / "gloc3"

    def bring(self, what: str, wheels: Path | None, extras: Sequence[str]) -> str:
        """Installs a version beside the others, if it is not there; returns it.

        Args:
            what: a wheel, a Debian package, or a version.
            wheels: folder with the wheels of its requirements; None for the package index.
            extras: of GLOC3; a Debian package has its own.

        Raises:
            Refused: it is not what was released, or cannot be installed; nothing of it stays.
        """
        file = Path(what)
        if file.suffix not in (".whl", ".deb") and not _VERSION.fullmatch(what):
            raise Refused(f"{what!r} is no wheel (FILE.whl), no Debian package (FILE.deb) and no version such as 1.2.0")
        if file.suffix in (".whl", ".deb") and not file.is_file():
            raise Refused(f"{file}: no such file")
        if file.suffix == ".deb":
            return self._install_package(file)
        version = file.name.split("-")[1] if file.suffix == ".whl" else what
        if self._is_installed(version):
            return version
        if file.suffix == ".whl":
            self._report(verify(file, self._signers))
        elif self._signers is not None:
            raise Refused(
                f"gloc3 {version} of the package index has no signature that {self._signers} could verify: "
                "give the wheel or the Debian package of the release"
            )
        self._install_wheel(f"{file.absolute()}" if file.suffix == ".whl" else version, version, wheels, extras)
        return version

    def check(self, version: str, commands: Sequence[Sequence[str]]) -> None:
        """Checks that a version runs, and that it accepts the commands of services.

        Raises:
            Refused: it does not.
        """
        found = self._run([str(self.program(version)), "--version"]).strip()
        if found != f"gloc3 {version}":
            raise Refused(f"{self.program(version)} says {found!r} instead of 'gloc3 {version}'")
        for command in commands:
            self._run([str(self.program(version)), *command])

    def switch(self, version: str, before: str) -> None:
        """Makes a version the one in use, at one go, and notes the one to go back to."""
        if before:
            replace_link(self.home / PREVIOUS, before)
        replace_link(self.home / CURRENT, version)
        self._report(f"gloc3 {version} is in use" + (f"; before: {before}" if before else ""))

    def _target(self, name: str) -> str:
        link = self.home / name
        return link.readlink().name if link.is_symlink() else ""

    def _is_installed(self, version: str) -> bool:
        if version not in self.versions:
            return False
        self._report(f"gloc3 {version} is installed in {self.home / version}")
        return True

    def _install_package(self, file: Path) -> str:
        self._report(verify(file, self._signers))
        name = self._run(["dpkg-deb", "--field", str(file), "Package"]).strip()
        if not name.startswith("gloc3-"):
            raise Refused(f"{file} is the package {name!r}, not one of GLOC3")
        version = name.removeprefix("gloc3-")
        if self._package_state(name) not in _PARTIAL and self._is_installed(version):
            return version
        try:
            self._run(["dpkg", "--install", str(file)])
        except BaseException:
            # dpkg unpacks a package before it finds that another one is missing
            with suppress(Refused):
                self._run(["dpkg", "--purge", name])
            raise
        if version not in self.versions:
            raise Refused(f"{file} has installed nothing in {self.home / version}; --home must be {HOME}")
        return version

    def _package_state(self, name: str) -> str:
        """State of a package, as dpkg-query(1) names it; empty for one that dpkg does not know."""
        with suppress(Refused):
            return self._run(["dpkg-query", "--show", "--showformat=${db:Status-Status}", name])
        return ""

    def _install_wheel(self, source: str, version: str, wheels: Path | None, extras: Sequence[str]) -> None:
        place = self.home / version
        shutil.rmtree(place, ignore_errors=True)
        os.umask(0o022)  # the service's user reads it
        place.mkdir(parents=True)
        (place / _UNFINISHED).touch()
        named = f"[{','.join(extras)}]" if extras else ""
        requirement = f"gloc3{named} @ file://{source}" if source.endswith(".whl") else f"gloc3{named}=={source}"
        offline = [] if wheels is None else ["--no-index", "--find-links", str(wheels.absolute())]
        options = ["--disable-pip-version-check", "--no-input", "--quiet", "--only-binary", ":all:"]
        try:
            self._run([sys.executable, "-m", "venv", str(place)])
            self._run([str(place / "bin" / "python"), "-m", "pip", "install", *options, *offline, requirement])
        except BaseException:
            shutil.rmtree(place, ignore_errors=True)
            raise
        (place / _UNFINISHED).unlink()

    def _run(self, command: Sequence[str]) -> str:
        """Runs a command and returns its output; one that fails is a refusal with its last lines."""
        self._report(" ".join(command))
        try:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        except OSError as error:
            raise Refused(f"{command[0]}: {error.strerror or error}") from error
        if done.returncode != 0:
            lines = (done.stderr.strip() or done.stdout.strip() or f"exit code {done.returncode}").splitlines()
            raise Refused("\n".join([f"{' '.join(command)} failed:", *lines[-_LINES:]]))
        return done.stdout
