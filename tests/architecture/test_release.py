"""What `make release` leaves: packages that install and make room for each other, licences, checksums, a container."""

import json
import re
import shlex
import subprocess
import sys
from importlib import resources
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import jsonschema
import pytest
from packaging.requirements import Requirement
from referencing import Registry
from referencing.jsonschema import DRAFT7
from tests.fresh_root import run_in_fresh_root, why_not
from tests.house.notice import UNLOCKED
from tests.release.build import DOCKERFILE, NOTES, REQUIREMENTS, checksums, release, sign
from tests.release.closure import VEHICLE, closure, locked
from tests.release.debian import TARGETS, lay, pack
from tests.release.notes import CHANGES, PLACES, obstacles
from tests.release.sbom import PROJECT, bill

from gloc3.messages.vehicle import Style
from gloc3_onboard.checks.tables import table_of
from gloc3_onboard.cli.onboard import app
from gloc3_onboard.service.release_files import CHECKSUMS, NAMESPACE

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
PYTHON = f"{sys.version_info.major}.{sys.version_info.minor}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A release without the Debian packages, which need the network."""
    return release(tmp_path_factory.mktemp("dist"), key=None, with_debian=False, report=lambda _: None)


def test_a_release_has_every_part_and_checksums_that_hold(folder: Path) -> None:
    version = PROJECT["version"]
    names = {f"gloc3-{version}-py3-none-any.whl", f"gloc3-{version}.tar.gz", f"gloc3-{version}.cdx.json"}
    assert {path.name for path in folder.iterdir()} == {*names, REQUIREMENTS, DOCKERFILE.name, NOTES, CHECKSUMS}
    check = ["sha256sum", "--check", "--strict", CHECKSUMS]
    assert subprocess.run(check, cwd=folder, capture_output=True, check=False).returncode == 0
    (folder / "changed").write_text("1")
    line = checksums([folder / "changed"])
    (folder / "changed").write_text("2")
    done = subprocess.run(check[:-1], cwd=folder, input=line, capture_output=True, check=False, text=True)
    assert "changed: FAILED" in done.stdout
    (folder / "changed").unlink()


def test_the_notes_of_a_release_need_no_other_page(folder: Path) -> None:
    text = (folder / NOTES).read_text(encoding="utf-8")
    assert text.startswith(f"# GLOC3 {PROJECT['version']}\n")
    assert re.findall(r"^### (.+)$", text, re.MULTILINE) == [
        "What you can do with it",
        "What you need",
        "Before you update",
        "Known limits",
    ]
    assert "](" not in text


def test_the_oldest_firmware_is_that_of_the_checks() -> None:
    px4, ardupilot = (".".join(map(str, table_of(style).least_firmware[:2])) for style in (Style.PX4, Style.ARDUPILOT))
    for page in ("release-notes.md", "tutorials/first-vehicle.md"):
        assert f"PX4 {px4} or ArduPilot {ardupilot}, or newer" in (ROOT / "docs" / page).read_text(encoding="utf-8")


def test_changelog_notes_code_and_container_are_of_the_version_of_the_project() -> None:
    assert list(obstacles(PROJECT["version"], is_tagged=False)) == []


@pytest.mark.parametrize("name", PLACES)
def test_a_file_of_another_version_stops_the_release(name: str, tmp_path: Path) -> None:
    for each in PLACES:
        (tmp_path / each).parent.mkdir(parents=True, exist_ok=True)
        text = (ROOT / each).read_text(encoding="utf-8")
        (tmp_path / each).write_text(text if each != name else text.replace(PROJECT["version"], "9.9.9"))
    (found,) = obstacles(PROJECT["version"], is_tagged=False, root=tmp_path)
    assert found == f"{name} is for version 9.9.9, pyproject.toml for {PROJECT['version']}"


def test_a_tagged_version_has_a_date(tmp_path: Path) -> None:
    for each in PLACES:
        (tmp_path / each).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / each).write_text((ROOT / each).read_text(encoding="utf-8"))
    version = PROJECT["version"]
    heading = f"## {version} ("
    text = (tmp_path / CHANGES).read_text(encoding="utf-8")
    (tmp_path / CHANGES).write_text(
        re.sub(rf"^{re.escape(heading)}.*$", f"{heading}unreleased)", text, flags=re.MULTILINE)
    )
    (found,) = obstacles(version, is_tagged=True, root=tmp_path)
    assert found.startswith(f"{CHANGES} has no date for {version}")
    (tmp_path / CHANGES).write_text(text.replace(f"{heading}unreleased)", f"{heading}2026-12-01)"))
    assert list(obstacles(version, is_tagged=True, root=tmp_path)) == []


def test_a_signature_holds_for_the_signed_file_alone(tmp_path: Path) -> None:
    key, file, signers = tmp_path / "key", tmp_path / CHECKSUMS, tmp_path / "signers"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
    signers.write_text(f"release@gloc3 {key.with_suffix('.pub').read_text()}")
    file.write_text("checksums")
    signature = sign(file, key)
    verify = ["ssh-keygen", "-Y", "verify", "-f", str(signers), "-I", "release@gloc3", "-n", NAMESPACE]
    verify += ["-s", str(signature)]
    assert subprocess.run(verify, input=b"checksums", capture_output=True, check=False).returncode == 0
    assert subprocess.run(verify, input=b"others", capture_output=True, check=False).returncode != 0


def test_the_lock_for_vehicles_pins_all_that_a_vehicle_needs_by_hashes() -> None:
    names = set(closure(VEHICLE)) - {"gloc3"}
    entries = re.split(r"\n(?=[a-z0-9])", locked(names).strip())
    assert {Requirement(entry.partition(" \\")[0]).name for entry in entries} == names
    assert all("--hash=sha256:" in entry for entry in entries)
    assert {"pymavlink", "eclipse-zenoh", "gpiod", "textual"} <= names
    assert not {"jsbsim", "pytest", "mypy"} & names, "neither simulation nor tools"


def validator() -> jsonschema.Draft7Validator:
    """Of CycloneDX's own schema, with those that it refers to."""
    folder = resources.files("cyclonedx.schema._res")
    of = {path.name: json.loads(path.read_text()) for path in folder.iterdir() if path.name.endswith(".schema.json")}
    base = "http://cyclonedx.org/schema/"
    known = [(base + name, DRAFT7.create_resource(content)) for name, content in of.items()]
    return jsonschema.Draft7Validator(
        of["bom-1.6.SNAPSHOT.schema.json"], registry=Registry[Any]().with_resources(known)
    )


def test_the_bill_of_materials_is_valid_and_states_every_licence() -> None:
    found = json.loads(bill())
    validator().validate(found)
    assert not validator().is_valid({**found, "components": [{"name": "nameless"}]}), "a wrong one is found"
    licences = {one["name"]: json.dumps(one["licenses"]) for one in found["components"]}
    stated = [Requirement(one) for one in PROJECT["dependencies"]]
    stated += [Requirement(one) for extra in PROJECT["optional-dependencies"].values() for one in extra]
    assert {one.name.lower() for one in stated} - set(UNLOCKED) <= set(licences)
    assert "LGPL" in licences["pymavlink"]
    assert "LGPL" in licences["jsbsim"]
    assert "EPL-2.0" in licences["eclipse-zenoh"]
    needs = {one["ref"]: one.get("dependsOn", []) for one in found["dependencies"]}
    (top,) = (ref for ref in needs if ref.startswith("pkg:pypi/gloc3@"))
    assert any(ref.startswith("pkg:pypi/pymavlink@") for ref in needs[top])


def test_a_plain_installation_has_wheels_for_aarch64_and_simulation_has_none(tmp_path: Path) -> None:
    for extras, missing in ((), ""), (("sitl",), "jsbsim"):
        file = tmp_path / "requirements.txt"
        file.write_text(locked(closure(extras)))
        where = ["--python-platform", "aarch64-manylinux_2_28", "--python-version", PYTHON, "--target", str(tmp_path)]
        install = ["pip", "install", "--dry-run", "--no-build", "--require-hashes", *where, "-r", str(file)]
        done = subprocess.run([sys.executable, "-m", "uv", *install], capture_output=True, text=True, check=False)
        if "Failed to fetch" in done.stderr or "error sending request" in done.stderr:
            pytest.skip("the package index cannot be reached")
        assert (done.returncode == 0) == (not missing), done.stderr
        assert missing in done.stderr


@pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")
def test_debian_packages_of_two_versions_stand_beside_each_other(folder: Path, tmp_path: Path) -> None:
    (target,) = (each for each in TARGETS if each.python == "3.11" and each.architecture == "amd64")
    (wheel,) = folder.glob("*.whl")
    for version in ("1.0.0", "1.1.0"):
        with ZipFile(wheel) as file:
            file.extractall(tmp_path / "site", [name for name in file.namelist() if "/mission/" not in name])
        lay(target, version, tmp_path / "site", tmp_path / version)
        assert pack(target, version, tmp_path / version, tmp_path).name.startswith(f"gloc3-{version}_{version}+debian")
    unit = (
        "printf '[Service]\\nExecStart=/opt/gloc3/current/bin/gloc3 onboard x\\n' > /etc/systemd/system/gloc3-x.service"
    )
    steps = [
        "dpkg --force-depends --install gloc3-1.0.0_*.deb",
        "echo first $(readlink /opt/gloc3/current) $(readlink -f /usr/bin/gloc3)",
        "gloc3 --version",
        "dpkg --force-depends --install gloc3-1.1.0_*.deb",
        "echo second $(readlink /opt/gloc3/current)",
        unit,
        "dpkg --remove gloc3-1.0.0 && echo it went || echo it stays",
        "ln -sfn 1.1.0 /opt/gloc3/current",
        "dpkg --remove gloc3-1.0.0 && test ! -e /opt/gloc3/1.0.0 && echo removed",
        "rm /etc/systemd/system/gloc3-x.service",
        "dpkg --remove gloc3-1.1.0 && test ! -e /opt/gloc3 && test ! -e /usr/bin/gloc3 && echo nothing is left",
    ]
    done = run_in_fresh_root("\n".join(steps), tmp_path, {"PYTHONPATH": ":".join(filter(None, sys.path))})
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert "first 1.0.0 /opt/gloc3/1.0.0/bin/gloc3" in lines
    assert f"gloc3 {PROJECT['version']}" in lines
    assert "gloc3 1.0.0 stays in use; to change: gloc3 update 1.1.0" in lines
    assert "second 1.0.0" in lines
    assert "it stays" in lines
    assert "gloc3 1.0.0 is in use by gloc3-x.service" in done.stderr
    assert {"removed", "nothing is left"} <= set(lines)


def instructions() -> list[tuple[str, str]]:
    """The container file's instructions."""
    text = re.sub(r"\\\n", " ", DOCKERFILE.read_text())
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(name, rest) for name, _, rest in (line.partition(" ") for line in lines)]


def test_the_container_copies_what_a_release_has_and_starts_with_options_that_exist(folder: Path) -> None:
    version = PROJECT["version"]
    of = dict(instructions())
    assert of["ARG"] == f"VERSION={version}"
    for name in of["COPY"].replace("${VERSION}", version).split()[:-1]:
        assert (folder / name).is_file(), name
    assert json.loads(of["ENTRYPOINT"]) == ["gloc3"]
    first, *rest = json.loads(of["CMD"])
    assert first == "onboard"
    _, bound, unused, _ = app.parse_known_args(rest)
    assert unused == []
    options = bound.kwargs["options"]
    options.check()
    assert str(options.out) == "/data"


def test_the_container_has_the_labels_of_a_blueos_extension() -> None:
    labels = {}
    for name, rest in instructions():
        if name == "LABEL":
            ((key, _, value),) = (word.partition("=") for word in shlex.split(rest))
            labels[key] = value
    assert labels["version"] == "${VERSION}"
    assert re.fullmatch(r"core >= \d+\.\d+", labels["requirements"])
    assert labels["type"] in {"device-integration", "example", "theme", "other"}
    host = json.loads(labels["permissions"])["HostConfig"]
    assert host["NetworkMode"] == "host", "the autopilot's link is on BlueOS's loopback"
    assert "Privileged" not in host
    authors, company, tags = (json.loads(labels[name]) for name in ("authors", "company", "tags"))
    assert all({"name", "email"} <= set(author) for author in authors)
    assert {"name", "about", "email"} <= set(company)
    assert len(tags) <= 10
    assert isinstance(json.loads(labels["links"]), dict)
