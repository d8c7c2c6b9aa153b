"""What others need to join: templates, the workflow, commit hooks, and the licences of the dependencies."""

import re
import shlex
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.house import notice

ROOT = Path(__file__).parents[2]
FORMS = sorted(path for path in (ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml") if path.name != "config.yml")


def read(name: str | Path) -> Any:
    """A YAML file of the project."""
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def commands_of_make_check() -> list[str]:
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    sources = " ".join(re.findall(r"^SOURCES := (.*)$", text, re.MULTILINE))
    lines = re.findall(r"^\t(.*)$", text.partition("\ncheck:")[2].partition("\n\n")[0], re.MULTILINE)
    return [line.replace("$(BIN)", ".venv/bin").replace("$(SOURCES)", sources) for line in lines]


def test_commit_hooks_are_the_commands_of_make_check() -> None:
    (repo,) = read(".pre-commit-config.yaml")["repos"]
    assert repo["repo"] == "local"
    assert [hook["entry"] for hook in repo["hooks"]] == commands_of_make_check()
    assert all(hook["language"] == "system" and not hook["pass_filenames"] for hook in repo["hooks"])


def test_the_workflow_runs_the_checks_on_every_supported_python() -> None:
    job = read(".github/workflows/ci.yml")["jobs"]["run"]
    versions = job["strategy"]["matrix"]["python"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f">={versions[0]}" == project["requires-python"]
    stated = re.findall(r"3\.\d+", (ROOT / "docs/stability.md").read_text().partition("## Supported systems")[2])
    assert versions == stated
    runs = [shlex.split(step["run"]) for step in job["steps"] if "run" in step]
    assert runs == [["bash", ".ci/run"]]
    assert (ROOT / ".ci/run").exists()


@pytest.mark.parametrize("form", FORMS, ids=lambda path: path.name)
def test_forms_have_what_the_platform_requires(form: Path) -> None:
    content = read(form)
    assert content["name"]
    assert content["description"]
    fields = [one for one in content["body"] if one["type"] != "markdown"]
    assert len({one["id"] for one in fields}) == len(fields)
    assert all(one["attributes"]["label"] for one in fields)
    assert any(one.get("validations", {}).get("required") for one in fields)


def test_files_that_the_forms_and_the_template_name_exist() -> None:
    files = [*FORMS, ROOT / ".github/PULL_REQUEST_TEMPLATE.md"]
    named = {name for path in files for name in re.findall(r"\b(?:docs/)?[\w-]+\.md\b", path.read_text())}
    assert len(named) >= 5
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def test_every_declared_dependency_is_in_the_notice() -> None:
    rows = re.findall(r"^(\S+) {2,}(\S+) {2,}\S", notice.FILE.read_text(encoding="utf-8"), re.MULTILINE)
    assert dict(rows[1:]) == {name: extra or "-" for name, extra in notice.declared().items()}, "run `make docs`"


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="newer Pythons get other versions of some packages")
def test_the_licences_are_those_that_the_packages_state() -> None:
    assert notice.FILE.read_text(encoding="utf-8") == notice.text(), "run `make docs`"


def test_every_extra_is_in_the_lock_but_those_that_are_too_large_for_it() -> None:
    makefile, lock = ((ROOT / name).read_text(encoding="utf-8") for name in ("Makefile", "requirements.txt"))
    locked = re.findall(r"^LOCKED := (.*)$", makefile, re.MULTILINE)[0].split()
    extras = {extra for package, extra in notice.declared().items() if extra and package not in notice.UNLOCKED}
    assert sorted(locked) == sorted(extras)
    for package in notice.declared():
        is_in_lock = re.search(rf"^{re.escape(package)}(\[.*\])?==", lock, re.MULTILINE | re.IGNORECASE) is not None
        assert is_in_lock == (package not in notice.UNLOCKED), package
