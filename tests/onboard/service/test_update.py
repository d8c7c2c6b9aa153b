"""`gloc3 update`: versions side by side, checked and switched at one go, and back when a service does not come up."""

import asyncio
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fresh_root import run_in_fresh_root, why_not
from tests.release import debian
from tests.release.build import checksums, sign

from gloc3.cli.program import run
from gloc3.clock import passed, run_virtual
from gloc3.errors import Refused
from gloc3_onboard.service.environments import Environments
from gloc3_onboard.service.install import _program
from gloc3_onboard.service.release_files import CHECKSUMS, IDENTITY, SIGNERS, verify
from gloc3_onboard.service.status import ServiceStatus
from gloc3_onboard.service.unit import SystemdUnit, command_of, user_of
from gloc3_onboard.service.update import UnitState, Update, dry_run

DISARMED = "quad is working: 9 of 9 components work; disarmed, on ground, Hold"
UNIT = "gloc3-quad.service"


def lay(home: Path, version: str, code: int = 0) -> None:
    """An environment whose program notes what it is asked, and answers by a code."""
    program = home / version / "bin" / "gloc3"
    program.parent.mkdir(parents=True)
    (home / version / "pyvenv.cfg").touch()
    answer = (
        f'[ "$1" = --version ] && echo gloc3 {version} && exit 0\necho "$@" >> {home}/asked\necho no such option >&2\n'
    )
    program.write_text(f"#!/bin/sh\n{answer}exit {code}\n")
    program.chmod(0o755)


class Computer:
    """Versions, a unit, and what controls it: each version's service says something after its start."""

    def __init__(self, folder: Path, status: str = DISARMED) -> None:
        self.home, self.units, self.said = folder / "versions", folder / "units", list[str]()
        self.status, self.restarts, self.says = status, 0, dict[str, str]()
        self.environments = Environments(self.home, self.said.append)
        for version in ("1.0", "2.0"):
            lay(self.home, version)
        self.environments.switch("1.0", "")
        self.units.mkdir()
        command = (
            str(self.home / "current/bin/gloc3"),
            "onboard",
            "quad",
            "--station=udpout://10.0.0.1:14550?role=a b%",
        )
        (self.units / UNIT).write_text(SystemdUnit(name="quad", command=command, user="pilot").text())

    def read(self, unit: str) -> UnitState:
        assert unit == UNIT
        return UnitState(bool(self.status), self.restarts, self.status)

    def restart(self, unit: str) -> None:
        self.restarts, self.status = 0, ""
        version = self.environments.current
        asyncio.get_running_loop().call_later(3.0, self._up, version)

    def _up(self, version: str) -> None:
        if version == self.environments.current:
            self.status = self.says.get(version, DISARMED)
            self.restarts = 0 if self.status else 5

    def update(self) -> Update:
        return Update(self.environments, self, self.said.append, self.units)

    def switch(self, version: str) -> bool:
        return run_virtual(self.update().switch(version, 60.0))


def test_a_version_that_works_stays_in_use(tmp_path: Path) -> None:
    computer = Computer(tmp_path)
    assert computer.switch("2.0")
    assert (computer.environments.current, computer.environments.previous) == ("2.0", "1.0")
    assert (computer.home / "current/bin/gloc3").resolve() == (computer.home / "2.0/bin/gloc3").resolve()


@pytest.mark.parametrize(
    ("says", "reason"),
    [
        (
            "quad is faulty: 8 of 9 components work; disarmed, on ground, Hold",
            "does not work after 60 s (quad is faulty",
        ),
        ("", "has ended 5 times"),
        ("waiting for the other host", "does not work after 60 s (waiting"),
    ],
)
def test_a_version_that_does_not_work_is_taken_back(says: str, reason: str, tmp_path: Path) -> None:
    computer = Computer(tmp_path)
    computer.environments.switch("1.0", "0.9")
    computer.says["2.0"] = says
    assert not computer.switch("2.0")
    assert (computer.environments.current, computer.environments.previous) == ("1.0", "0.9"), "--back is as before"
    assert any(reason in text and "going back to gloc3 1.0" in text for text in computer.said)


def test_components_that_failed_before_may_fail_afterwards(tmp_path: Path) -> None:
    computer = Computer(tmp_path, DISARMED.replace("9 of 9", "8 of 9"))
    computer.says["2.0"] = computer.status
    assert computer.switch("2.0")


def test_an_interrupted_switch_goes_back_and_restarts_the_old_version(tmp_path: Path) -> None:
    computer = Computer(tmp_path)

    async def interrupted() -> None:
        task = asyncio.ensure_future(computer.update().switch("2.0", 60.0))
        await passed(2.0)
        assert computer.environments.current == "2.0"
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await passed(5.0)
        assert computer.status == DISARMED, "the old version is up"

    run_virtual(interrupted())
    assert computer.environments.current == "1.0"


@pytest.mark.parametrize(
    ("status", "is_forced", "reason"),
    [
        (DISARMED, False, ""),
        (DISARMED.replace("disarmed, on ground", "armed, on ground"), True, "Land and disarm"),
        (DISARMED.replace("disarmed, on ground", "armed, in air"), True, "Land and disarm"),
        ("quad is working: 2 of 2 components work; no autopilot is connected", False, "--force"),
        ("quad is working: 2 of 2 components work; no autopilot is connected", True, ""),
        ("4 components", False, "--force"),
    ],
)
def test_an_armed_vehicle_is_left_alone(status: str, is_forced: bool, reason: str, tmp_path: Path) -> None:
    update = Computer(tmp_path, status).update()
    if reason:
        with pytest.raises(Refused, match=reason):
            update.check("2.0", is_forced=is_forced)
    else:
        update.check("2.0", is_forced=is_forced)


def test_a_version_is_checked_with_the_options_of_each_service(tmp_path: Path) -> None:
    computer = Computer(tmp_path)
    computer.update().check("2.0", is_forced=False)
    expected = "onboard install quad --station=udpout://10.0.0.1:14550?role=a b% --user=pilot --dry-run"
    assert (computer.home / "asked").read_text() == f"{expected}\n"
    lay(computer.home, "3.0", code=2)
    with pytest.raises(Refused, match="no such option"):
        computer.update().check("3.0", is_forced=False)
    (computer.home / "4.0").symlink_to("2.0")
    with pytest.raises(Refused, match=r"says 'gloc3 2\.0' instead of 'gloc3 4\.0'"):
        computer.update().check("4.0", is_forced=False)


@given(
    st.lists(st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=1), min_size=1, max_size=4)
)
def test_a_unit_gives_its_command_back(words: list[str]) -> None:
    text = SystemdUnit(name="quad", command=("/opt/gloc3", *words), user="gloc3").text()
    assert command_of(text)[1:-2] == tuple(words)
    assert user_of(text) == "gloc3"
    assert dry_run(text)[-2:] == ["--user=gloc3", "--dry-run"]


@given(st.integers(0, 99), st.integers(0, 99), st.lists(st.sampled_from(["pose hung", "armed, in air, Hold"])))
def test_a_status_line_is_read_as_it_was_written(well: int, failing: int, details: list[str]) -> None:
    status = ServiceStatus(platform="quad", health="working", well=well, total=well + failing, details=tuple(details))
    assert ServiceStatus.parse(status.text()) == status
    assert status.failing == failing
    assert ServiceStatus.parse("stopping") is None


def test_a_unit_names_the_link_where_this_program_is_the_version_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computer = Computer(tmp_path)
    monkeypatch.setattr(sys, "prefix", str(computer.home / "1.0"))
    assert _program() == (str(computer.home / "current/bin/gloc3"),)
    monkeypatch.setattr(sys, "prefix", str(computer.home / "2.0"))
    assert "current" not in _program()[0]


def small_wheel(folder: Path, version: str, script: str = "gloc3") -> Path:
    """A wheel of that name with a program that prints its version."""
    file, info = folder / f"gloc3-{version}-py3-none-any.whl", f"gloc3-{version}.dist-info"
    with ZipFile(file, "w") as wheel:
        wheel.writestr("tiny.py", f"def main(): print('gloc3 {version}')\n")
        wheel.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: gloc3\nVersion: {version}\n")
        wheel.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{info}/entry_points.txt", f"[console_scripts]\n{script} = tiny:main\n")
        wheel.writestr(f"{info}/RECORD", "")
    return file


@pytest.mark.thorough
def test_a_wheel_becomes_an_environment_and_a_broken_one_leaves_nothing(tmp_path: Path) -> None:
    computer = Computer(tmp_path)
    wheel = small_wheel(tmp_path, "3.0")
    assert computer.environments.bring(str(wheel), tmp_path, ()) == "3.0"
    computer.environments.check("3.0", [])
    assert computer.environments.versions == ["1.0", "2.0", "3.0"]
    broken = tmp_path / "gloc3-4.0-py3-none-any.whl"
    broken.write_bytes(b"no zip")
    with pytest.raises(Refused, match="pip install"):
        computer.environments.bring(str(broken), tmp_path, ())
    assert not (computer.home / "4.0").exists()
    (computer.home / "5.0").mkdir()
    (computer.home / "5.0" / "pyvenv.cfg").touch()
    (computer.home / "5.0" / ".unfinished").touch()
    assert "5.0" not in computer.environments.versions, "a power cut left it"


def signed(folder: Path) -> Path:
    """Signs checksums of what is in a folder, as a release is; returns the file of allowed signers."""
    key = folder / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
    (folder / CHECKSUMS).write_text(checksums(folder.glob("gloc3-*")))
    sign(folder / CHECKSUMS, key)
    signers = folder / "allowed_signers"
    signers.write_text(f"{IDENTITY} {key.with_suffix('.pub').read_text()}")
    return signers


def test_a_signed_file_is_verified_and_another_is_refused(tmp_path: Path) -> None:
    wheel = small_wheel(tmp_path, "3.0")
    assert verify(wheel, None) == f"{wheel.name} is not verified: there is no {CHECKSUMS} beside it"
    with pytest.raises(Refused, match=rf"{CHECKSUMS}: No such file or directory"):
        verify(wheel, tmp_path / "allowed_signers")
    signers = signed(tmp_path)
    assert "signed by release@gloc3" in verify(wheel, signers)
    assert "signature is not verified" in verify(wheel, None)
    other = small_wheel(tmp_path, "4.0")
    with pytest.raises(Refused, match=f"has no line for {other.name}"):
        verify(other, signers)
    whole = wheel.read_bytes()
    wheel.write_bytes(whole[:-1])
    for keys in (signers, None):
        with pytest.raises(Refused, match="is not the released file"):
            verify(wheel, keys)
    (tmp_path / CHECKSUMS).write_text(checksums([wheel, other]))
    assert verify(other, None)
    with pytest.raises(Refused, match=r"SHA256SUMS\.sig does not hold"):
        verify(other, signers)


def test_a_stranger_s_signature_is_refused(tmp_path: Path) -> None:
    for name in ("ours", "theirs"):
        (tmp_path / name).mkdir()
        small_wheel(tmp_path / name, "3.0")
    signers, others = signed(tmp_path / "ours"), signed(tmp_path / "theirs")
    wheel = tmp_path / "ours/gloc3-3.0-py3-none-any.whl"
    assert verify(wheel, signers)
    with pytest.raises(Refused, match="does not hold"):
        verify(wheel, others)
    (wheel.parent / f"{CHECKSUMS}.sig").unlink()
    with pytest.raises(Refused, match=r"SHA256SUMS\.sig: No such file"):
        verify(wheel, signers)


def test_the_command_installs_nothing_that_is_not_signed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    home, wheel = Computer(tmp_path).home, small_wheel(tmp_path, "3.0")
    options = ["--home", str(home)]
    signed(tmp_path).rename(home / SIGNERS)
    wheel.write_bytes(b"another")
    assert run(["update", str(wheel), *options]) == 2
    assert "is not the released file" in capsys.readouterr().err
    assert run(["update", "3.0", *options]) == 2
    assert "has no signature" in capsys.readouterr().err
    assert not (home / "3.0").exists()


def small_package(folder: Path, version: str, needs: str = "") -> Path:
    """A Debian package of that version, with the scripts of a release and a program that prints its version."""
    target = next(each for each in debian.TARGETS if (each.python, each.architecture) == ("3.11", "amd64"))
    site, tree = folder / f"site-{version}", folder / f"tree-{version}"
    (site / "gloc3" / "cli").mkdir(parents=True)
    (site / "gloc3" / "__init__.py").touch()
    (site / "gloc3" / "cli" / "start.py").write_text(f"def main():\n    print('gloc3 {version}')\n")
    debian.lay(target, version, site, tree)
    if needs:
        target = target._replace(python=needs)
    return debian.pack(target, version, tree, folder)


@pytest.mark.thorough
@pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")
def test_a_debian_package_is_verified_installed_beside_the_other_and_one_that_cannot_be_leaves_nothing(
    tmp_path: Path,
) -> None:
    for version in ("1.0", "2.0"):
        small_package(tmp_path, version)
    small_package(tmp_path, "3.0", needs="9.9")
    signed(tmp_path)
    script = f"""
    update() {{ code=0; {sys.executable} -m gloc3 update "$@" 2>&1 || code=$?; echo "code: $code"; }}
    versions() {{ echo "versions: $(readlink /opt/gloc3/current) of $(cd /opt/gloc3; ls -d [0-9]* | xargs)"; }}
    mkdir -p /opt/gloc3 && cp allowed_signers /opt/gloc3/
    dpkg --install gloc3-1.0_*.deb
    update ./gloc3-2.0_*.deb; gloc3 --version; versions
    update ./gloc3-3.0_*.deb; versions; dpkg-query --show gloc3-3.0 2>&1 || true
    update --back; gloc3 --version
    dpkg --purge gloc3-2.0; dpkg --unpack gloc3-2.0_*.deb
    update ./gloc3-2.0_*.deb; dpkg-query --show --showformat '${{db:Status-Status}} again' gloc3-2.0; echo
    update 1.0; dpkg --purge gloc3-2.0; echo 1 >> $(ls gloc3-2.0_*.deb)
    update ./gloc3-2.0_*.deb; versions
    echo left: $(ls -A /opt/gloc3); dpkg --purge gloc3-1.0; echo left: $(ls -A /opt/gloc3)
    rm -r /opt/gloc3; update ./gloc3-3.0_*.deb; test -e /opt/gloc3 || echo nothing is left
    """
    done = run_in_fresh_root(script, tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line for line in lines if line.startswith(("code", "gloc3 2.0", "gloc3 1.0", "versions"))] == [
        "gloc3 2.0 is in use; before: 1.0",
        "code: 0",
        "gloc3 2.0",
        "versions: 2.0 of 1.0 2.0",
        "code: 2",
        "versions: 2.0 of 1.0 2.0",
        "gloc3 1.0 is in use; before: 2.0",
        "code: 0",
        "gloc3 1.0",
        "gloc3 2.0 is in use; before: 1.0",
        "code: 0",
        "gloc3 1.0 is installed in /opt/gloc3/1.0",
        "gloc3 1.0 is in use; before: 2.0",
        "code: 0",
        "code: 2",
        "versions: 1.0 of 1.0",
        "code: 2",
    ]
    assert [line for line in lines if "left:" in line] == ["left: 1.0 allowed_signers current", "left: allowed_signers"]
    assert "nothing is left" in lines
    assert "  Package python9.9 is not installed." in lines
    assert "dpkg-query: no packages found matching gloc3-3.0" in lines
    assert "installed again" in lines, "what was left half-way is installed"
    assert "is not the released file" in done.stdout


@pytest.mark.parametrize("what", ["newest", "-3", "gloc3-9.0.whl", "none.deb", "../1.0"])
def test_what_is_no_version_is_refused(what: str, tmp_path: Path) -> None:
    with pytest.raises(Refused, match=r"is no wheel|no such file"):
        Computer(tmp_path).environments.bring(what, None, ())


def test_two_updates_at_a_time_are_refused(tmp_path: Path) -> None:
    computer = Computer(tmp_path)
    with computer.environments.locked(), pytest.raises(Refused, match="going on"), computer.environments.locked():
        pass


def test_what_is_refused_leaves_no_folder_and_no_file(tmp_path: Path) -> None:
    for home in (tmp_path / "opt/gloc3", Computer(tmp_path).home):
        before = sorted(tmp_path.rglob("*"))
        assert run(["update", "newest", "--home", str(home)]) == 2
        assert sorted(tmp_path.rglob("*")) == before


def test_the_command_lists_and_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    home = Computer(tmp_path).home
    assert run(["update", "--home", str(home)]) == 0
    assert capsys.readouterr().out.splitlines()[:2] == ["1.0  in use", "2.0"]
    for words in (["--back"], ["--back", "1.0"], ["2.0", "--within", "0"]):
        assert run(["update", *words, "--home", str(home)]) == 2
