"""Somebody who has only the site: the tutorials in a fresh environment, and three tasks whose steps the site teaches."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from tests.commands.fresh import fresh_environment, unpacked_wheel
from tests.data_folders import MISSIONS
from tests.evidence.page import ROOT, Bar, Figure, Progress
from tests.evidence.suites import run_tests
from tests.house.site import anchor_of
from tests.tutorials import PAGES, Reader, do, run

INSTALL: Final = "pip install --editable ."
DOCS: Final = ROOT / "docs"
FIRST: Final = PAGES / "first-flight.md"
PLAN: Final = MISSIONS / "px4" / "MC_mission_box.plan"
"""A plan of PX4's repository, for a multirotor."""
LANDINGS: Final = {"battery": "battery=0.1@6", "link": "link_loss@6..60", "cable": "cable_loss@6..30"}
"""Why the flights of the third task have landed, which the walker does not know."""
GENERATED: Final = {
    "docs/where-things-are.md": "tests/architecture/test_rooms.py",
    "docs/walks.md": "tests/architecture/test_walks.py",
    "docs/public-api.md": "tests/architecture/test_public_api.py",
    "docs/troubleshooting.md": "tests/architecture/test_troubleshooting_page.py",
    "docs/when-it-dies.md": "tests/architecture/test_explanation_pages.py",
    "docs/performance.md": "tests/architecture/test_explanation_pages.py",
    **{
        f"docs/reference/{path.name}": "tests/architecture/test_reference_pages.py"
        for path in sorted((DOCS / "reference").iterdir())
    },
    "docs/pictures/rooms.svg": "tests/architecture/test_rooms.py",
    "NOTICE": "tests/architecture/test_project_files.py",
    "docs/schema/mission.schema.json": "tests/common/mission/test_mission_schema.py",
    "docs/schema/platform.schema.json": "tests/onboard/cli/test_platform_schema.py",
    "docs/schema/station-lines.schema.json": "tests/groundstation/cli/test_station_cli.py",
    "docs/evidence/README.md": "tests/architecture/test_evidence_pages.py",
}
"""Files that are made from the code, and the tests, part of `make test` and so of every CI run, that make them again and compare."""
OTHERS: Final = {
    "every page is in the site, which is built without a warning": "tests/architecture/test_site.py",
    "every link and anchor leads somewhere": "tests/architecture/test_links_in_the_docs.py",
    "every command and option that is quoted exists": "tests/architecture/test_commands_in_the_docs.py",
}


class Step(NamedTuple):
    """One step of a task: what the site shows, with the reader's own names in place of the example's."""

    link: str
    """The page below `docs`, and the anchor of the section that teaches it."""
    shown: str
    """The command in this section, or the file whose text it gives."""
    put: Mapping[str, str] = {}
    """What the reader writes in place of what."""
    expected: str = ""
    """What the output has to match somewhere; empty for a file."""


class Task(NamedTuple):
    """A question, what is given, and the steps that solve it."""

    name: str
    question: str
    steps: Sequence[Step]
    given: Callable[[Reader], None] = lambda reader: None


def give_plan(reader: Reader) -> None:
    """Puts the plan there."""
    shutil.copy(PLAN, reader.folder / "box.plan")


def give_flight(fault: str, reader: Reader) -> None:
    """Leaves the log of a flight that has landed."""
    run(f"gloc3 fly hop --fault {fault} --out flight", reader)


_BOX: Final = {"field": "box"}
_LEAK: Final = {"[12, 7, 1]": "[6, 4, 1]"}
_LIMIT: Final = {"1500": "1200"}
_SENSOR: Final = "tutorials/own-sensor.md"
_DAY: Final = {"runs/today": "flight"}
TASKS: Final = (
    Task(
        "plan",
        "fly this .plan on a rover",
        (
            Step(
                "missions.md#plans-of-other-programs",
                "gloc3 mission check field.plan --platform rover",
                _BOX,
                "box.plan is fit to fly",
            ),
            Step(
                "missions.md#plans-of-other-programs",
                "gloc3 mission show field.plan --platform rover",
                _BOX,
                "follow_waypoints 4 waypoints",
            ),
            Step(
                "missions.md#plans-of-other-programs",
                "gloc3 fly field.plan --platform rover --out field",
                _BOX,
                r"box: done\n(?:.*\n)*.*passed +4 of 4 waypoints",
            ),
        ),
        give_plan,
    ),
    Task(
        "sensor",
        "add a CO2 sensor and react to it",
        (
            Step(f"{_SENSOR}#the-sampler", "gas/co2.py"),
            Step(f"{_SENSOR}#the-reaction", "gas/search.py"),
            Step(f"{_SENSOR}#the-platform", "sniffer.yaml"),
            Step(f"{_SENSOR}#install-it", "pyproject.toml"),
            Step(f"{_SENSOR}#install-it", INSTALL, {}, "Successfully installed gas"),
            Step(f"{_SENSOR}#install-it", "gloc3 platform check sniffer.yaml", {}, "can be used"),
            Step(f"{_SENSOR}#a-leak-in-the-world", "leaky.yaml", _LEAK),
            Step(f"{_SENSOR}#search-it", "search.yaml", _LIMIT),
            Step(
                f"{_SENSOR}#search-it",
                "gloc3 fly search.yaml --platform sniffer.yaml --world leaky.yaml --out found",
                {},
                r"search.lines done: leak ended\n(?:.*\n)*search: done",
            ),
            Step(
                f"{_SENSOR}#look-at-the-readings",
                "gloc3 log convert found --to csv --topic co2",
                {},
                "log-co2.csv: .* rows",
            ),
        ),
    ),
    *(
        Task(
            f"landing-{name}",
            "why did this flight land?",
            (
                Step("logs.md#why-did-it-land", "gloc3 log info runs/today", _DAY, "duration"),
                Step(
                    "logs.md#why-did-it-land",
                    "gloc3 log why runs/today land",
                    _DAY,
                    rf"because\n.*injected: fault {re.escape(fault)} ",
                ),
            ),
            partial(give_flight, fault),
        )
        for name, fault in LANDINGS.items()
    ),
)


def section(link: str) -> str:
    """The text of the section that a link leads to, that of its sections too.

    Raises:
        LookupError: there is none.
    """
    page, _, anchor = link.partition("#")
    text = (DOCS / page).read_text(encoding="utf-8") if (DOCS / page).is_file() else ""
    headings = list(re.finditer(r"^(#+) (.+)$", text, re.MULTILINE))
    for number, heading in enumerate(headings):
        if anchor == anchor_of(heading[2]):
            after = (one.start() for one in headings[number + 1 :] if len(one[1]) <= len(heading[1]))
            return text[heading.end() : next(after, len(text))]
    raise LookupError(f"{link} leads nowhere")


def taught(step: Step) -> str:
    """What the reader of a step's section writes: a command, or the text of a file.

    Raises:
        LookupError: the section does not show it.
    """
    text = section(step.link)
    if step.expected:
        if step.shown not in text:
            raise LookupError(f"{step.link} does not show {step.shown!r}")
        given = step.shown
    else:
        file = re.search(rf"^`{re.escape(step.shown)}`:\n\n```\w+\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
        if file is None:
            raise LookupError(f"{step.link} does not give {step.shown}")
        given = file[1]
    for example, own in step.put.items():
        given = given.replace(example, own)
    return given


@contextmanager
def fresh() -> Iterator[Reader]:
    """A reader with an empty folder and a new environment, in which GLOC3 is installed from its wheel."""
    with tempfile.TemporaryDirectory() as name:
        environment = fresh_environment(Path(name) / "venv", unpacked_wheel(Path(name)))
        home = Path(name) / "home"
        home.mkdir()
        yield Reader(home, {**environment, "XDG_CONFIG_HOME": str(home), "COLUMNS": "120"})


def install() -> dict[str, Any]:
    """Installs the project's own sdist as the first tutorial says, with all that it requires, and flies by it."""
    found = re.search(
        r"^## Install\n.*?^```bash\n(.*?)^```$", FIRST.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    assert found is not None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", name]
        subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
        with tarfile.open(next(folder.glob("*.tar.gz"))) as archive:
            archive.extractall(folder / "source", filter="data")
        (source,) = (folder / "source").iterdir()
        variables = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
        begin_s = time.perf_counter()
        command = ["bash", "-e", "-c", f"{found[1]}gloc3 fly hop --quiet"]
        done = subprocess.run(command, cwd=source, env=variables, check=False, capture_output=True, text=True)
        wrong = "" if done.returncode == 0 and "hop: done" in done.stdout else _short(done.stdout + done.stderr)
        return {"wrong": wrong, "took_s": time.perf_counter() - begin_s}


def tutorial(page: str) -> dict[str, Any]:
    """Does a tutorial in a fresh environment."""
    with fresh() as reader:
        begin_s, wrong = time.perf_counter(), ""
        try:
            do(page, reader)
        except (AssertionError, subprocess.SubprocessError) as error:
            wrong = _short(str(error)) or "no command was done"
        return {"wrong": wrong, "took_s": time.perf_counter() - begin_s}


def solve(task: Task) -> list[str]:
    """Takes the steps of a task in a fresh environment; what is wrong with each, empty where nothing is."""
    with fresh() as reader:
        task.given(reader)
        return [take(step, reader) for step in task.steps]


def take(step: Step, reader: Reader) -> str:
    """Takes a step; what is wrong with it."""
    try:
        given = taught(step)
        if not step.expected:
            (reader.folder / step.shown).parent.mkdir(parents=True, exist_ok=True)
            (reader.folder / step.shown).write_text(given, encoding="utf-8")
            return ""
        output = run(given, reader)
    except (LookupError, AssertionError, subprocess.SubprocessError) as error:
        return _short(str(error))
    return "" if re.search(step.expected, output) else f"printed {_short(output)}"


def walk(progress: Progress) -> list[Figure]:
    """The bar."""
    installed = progress.part("install", install)
    figures = [_done("installation of the sdist with all that it requires, and a flight by it", installed)]
    for page in sorted(path.stem for path in PAGES.glob("*.md")):
        progress.report(page)
        figures.append(_done(f"[{page}](../tutorials/{page}.md)", progress.part(page, partial(tutorial, page))))
    for task in TASKS:
        progress.report(task.name)
        for step, wrong in zip(task.steps, progress.part(task.name, partial(solve, task)), strict=True):
            name = f"{task.question} ({task.name}): [{step.link}](../{step.link}): `{step.shown}`"
            figures.append(Figure(name, _cell(wrong or "done"), "done", not wrong))
    checks = {f"{file} is as the code makes it": test for file, test in GENERATED.items()} | OTHERS
    outcomes = progress.part("tests", lambda: run_tests("strangers-walk", list(checks.values())))["outcomes"]
    for name, test in checks.items():
        found = [outcome for each, outcome in outcomes.items() if each.partition(":")[0] == Path(test).stem]
        value = f"{found.count('passed')} of {len(found)} tests of `{test}`"
        figures.append(Figure(name, value, "all pass", bool(found) and set(found) == {"passed"}))
    return figures


def _done(name: str, found: Mapping[str, Any]) -> Figure:
    value = _cell(found["wrong"]) or f"done in {found['took_s']:.0f} s"
    return Figure(name, value, "done", not found["wrong"])


def _short(text: str) -> str:
    return " ".join(text.split())[-300:]


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


BARS: Final = (
    Bar(
        "strangers-walk",
        "With the site alone, a newcomer does every tutorial and solves three tasks",
        "The project's sdist is installed as the first tutorial says. Then each tutorial is done literally, each in a new environment "
        "with GLOC3 from its wheel, whose requirements are those of the tests: its files and commands are used as they are. Each of the "
        "three tasks is solved in such an environment by steps that the linked section shows; the reader replaces only names and values "
        "of the example. The plan is PX4's `MC_mission_box.plan`. The third task is solved for three flights, and the answer has to name "
        "the fault that was injected. Times are wall time on a shared machine.",
        walk,
    ),
)
