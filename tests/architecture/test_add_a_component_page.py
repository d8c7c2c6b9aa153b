"""Follows `docs/add-a-component.md` to the letter: writes its files, installs them, runs its test, loads its platform."""

import importlib
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.package_of_page import install

from gloc3.cli.component import app
from gloc3.component.deployment import problems_of
from gloc3.component.description import describe, find_class, installed
from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.messages.topics import TopicTable
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform

pytestmark = pytest.mark.thorough

PAGE = Path(__file__).parents[2] / "docs" / "add-a-component.md"
FILES = dict(
    re.findall(r"^`([\w./-]+)`:\n\n```\w+\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The integrator's package, written from the page and installed as pip would install it."""
    for name, text in FILES.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    install(FILES["pyproject.toml"], tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if name.partition(".")[0] in ("reef", "test_sonar"):
            del sys.modules[name]


def _tests(package: Path) -> dict[str, Callable[[], None]]:
    sys.path.insert(0, str(package / "tests"))
    try:
        module = importlib.import_module("test_sonar")
    finally:
        sys.path.remove(str(package / "tests"))
    return {name: test for name, test in vars(module).items() if name.startswith("test_")}


def _platform(package: Path) -> Platform:
    return load_platform(str(package / "reef.yaml"), is_loading_classes=True)


def test_the_page_has_one_file_one_test_one_row_and_the_entry_points() -> None:
    assert list(FILES) == ["reef/sonar.py", "tests/test_sonar.py", "reef.yaml", "pyproject.toml", "reef/topics.py"]
    assert all(len(text.splitlines()) <= 100 for text in FILES.values())


def test_the_pages_own_test_passes_under_the_real_host(package: Path) -> None:
    tests = _tests(package)
    assert len(tests) == 2
    for test in tests.values():
        test()


def test_the_pages_own_test_catches_a_component_that_is_wrong(package: Path) -> None:
    file = package / "reef" / "sonar.py"
    file.write_text(FILES["reef/sonar.py"].replace("range_m is None or ", ""), encoding="utf-8")
    failed = 0
    for test in _tests(package).values():
        try:
            test()
        except AssertionError:
            failed += 1
    assert failed == 1


def test_the_pages_platform_is_right_and_its_row_fits_class_topics_and_settings(package: Path) -> None:
    platform = _platform(package)
    assert list(problems_of(platform.components, TopicTable.installed())) == []
    (row,) = platform.components
    assert describe(row.load_class(), TopicTable.installed()).settings[1].doc == ("Longest valid range, in metres.")


def test_the_pages_row_runs_as_it_stands_with_the_device_from_its_entry_point(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (row,) = _platform(package).components
    with Bench(topics=TopicTable.installed()) as bench:
        component = row.create({})
        device = vars(component)["_device"]
        assert type(device).__name__ == "SerialSonar"
        monkeypatch.setattr(device, "open", lambda port: None)
        monkeypatch.setattr(device, "_last_m", 3.42)
        bench.host(row, lambda: component)
        bench.run(1.0)
        assert bench.last("bottom").height_m == 3.42
        assert bench.last("components/sonar/internal").items["echoes"] == len(bench.all("bottom"))
        monkeypatch.setattr(device, "_last_m", 31.0)
        bench.run(1.0)
        assert (bench.last("bottom").is_valid, bench.state("sonar")) == (False, State.WORKING)


def test_the_pages_component_and_message_are_found_by_their_entry_points(
    package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert installed()["sonar"] == "reef.sonar:SonarSampler"
    assert find_class("sonar").__name__ == "SonarSampler"
    row = TopicTable.installed().row("reef/echo_strength")
    assert row is not None
    assert row.message.__name__ == "EchoStrength"
    for arguments in (["describe", "sonar"], ["list", "--platform", str(package / "reef.yaml")]):
        assert app(arguments, exit_on_error=False, result_action="return_value") == 0
        assert "sonar" in capsys.readouterr().out


@pytest.mark.parametrize("command", re.findall(r"^\$ (gloc3 .*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE))
def test_the_commands_of_the_page_exist(command: str) -> None:
    name = command.split()[1]
    from gloc3.cli.program import SUMMARIES

    assert name in SUMMARIES


def test_the_pages_device_reads_lines_in_a_thread_of_its_own(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Line:
        """A serial port that gives three lines and is then unplugged."""

        def __init__(self, port: str, rate: int, timeout: float) -> None:
            self.lines = [b"3.42\n", b"noise\n", b"2.5\n"]
            self.is_open = True

        def readline(self) -> bytes:
            if not self.lines:
                self.is_open = False
                raise OSError("unplugged")
            seen.append(device.range_m())
            return self.lines.pop(0)

        def close(self) -> None:
            self.is_open = False

    import serial

    seen: list[float | None] = []
    monkeypatch.setattr(serial, "Serial", Line)
    monkeypatch.setattr("threading.Thread", Immediate)
    device = importlib.import_module("reef.sonar").SerialSonar()
    device.close()
    device.open("/dev/ttyUSB0")
    assert seen == [None, 3.42, None]
    assert device.range_m() is None
    device.open("/dev/ttyUSB1")
    device.close()


class Immediate:
    """A thread that runs at once, so that nothing has to be waited for."""

    def __init__(self, target: Callable[..., None], args: tuple[Any, ...], daemon: bool) -> None:
        self.start = lambda: target(*args)
