"""What holds for all tests: searches by hypothesis and whatever looks at pictures or scans count as thorough, and may
take their time on a busy machine; one commit searches the same cases each time (`--hypothesis-profile=search`: others);
stations record into a folder of the tests' own; Ctrl-C works; see `stalls`, too.
"""

import gc
import itertools
import os
import re
import signal
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from tests.data_folders import OUTSIDE, REASON
from tests.stalls import pytest_runtest_protocol, pytest_terminal_summary

__all__ = ["pytest_runtest_protocol", "pytest_terminal_summary"]

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy: its threads wait for each other in a busy loop

settings.register_profile("search", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("any machine", settings.get_profile("search"), derandomize=True)
settings.load_profile("any machine")


def pytest_addoption(parser: pytest.Parser) -> None:
    """What the full runs ask for."""
    parser.addoption("--every-style", action="store_true", help="fly each test in both styles of autopilot")
    parser.addoption("--part", default="0/1", help="take the files of one part of several, such as 0/2 and 1/2")


@pytest.fixture(autouse=True, scope="session")
def _own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


_numbers = itertools.count()


@pytest.fixture
def tmp_path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of the test's own; numbered here, because pytest looks through all folders for the next free name."""
    folder = tmp_path_factory.getbasetemp() / f"{re.sub(r'[^a-zA-Z0-9]', '_', request.node.name)[:30]}_{next(_numbers)}"
    folder.mkdir(mode=0o700)
    return folder


@pytest.fixture(autouse=True, scope="session")
def _is_interruptible() -> None:
    """A shell that starts a job in the background has it ignore Ctrl-C, and all programs that it starts."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


PERCEPTION = (
    "algorithms/vision/",
    "algorithms/scan_matching/",
    "algorithms/calibration/",
    "algorithms/fusion/",
    "pose_fusion",
    "odometry",
    "stereo",
    "onboard/calibrating/",
    "controllers/test_navigator",
)
"""In the paths of tests that fly along walls, or turn before boards, to see how well they are seen."""


LONG = (
    "proof/test_",
    "flight/test_log_of_sensors",
    "flight/test_flights_are_deterministic",
    "flight/test_flying_on_our_own_pose",
    "flight/test_among_obstacles",
    "flight/test_sources_that_fail",
    "flight/test_vtols",
    "flight/test_mission_screen_in_flight",
    "flight/test_soak",
    "service/test_update",
    "onboard/hosts/",
    "companion/test_stations_on_",
    "sitl/firmware/",
    "demo/test_demo",
    "cli/test_fly_command",
    "commands/test_a_",
    "commands/test_examples",
    "commands/test_tutorials",
    "network/test_scale",
    "screens/test_mission_screen",
    "web/test_browser_journey",
)
"""In the paths of tests that take longest: they come first, so that at the end no core waits for one of them."""


LONGEST_NAME = 120
_MARKS_OF_A_FILE = re.compile(r"^pytestmark = (\[[^\]]*\]|.*)", re.MULTILINE)
_HAS_SOCKETS = re.compile(r"mark\.sockets\b|^    pytestmark,$", re.MULTILINE)
"""In the text of each file with tests in wall time: the mark, or marks that are imported."""


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Does not import files of another part, and those in which no test would be run.

    With `-m "not thorough"` these are thorough ones, with `-m sockets` those that do not have the mark in their text.
    """
    if collection_path.suffix != ".py" or not collection_path.is_relative_to(config.rootpath):
        return None
    place = collection_path.relative_to(config.rootpath).as_posix()
    part, parts = map(int, config.getoption("part").split("/"))
    if zlib.crc32(place.encode()) % parts != part:
        return True
    terms = config.option.markexpr.split(" and ")
    left_out = {term.removeprefix("not ") for term in terms if term.startswith("not ")}
    if terms == ["sockets"] and collection_path.name.startswith("test_"):
        return True if not _HAS_SOCKETS.search(collection_path.read_text(encoding="utf-8")) else None
    if len(left_out) < len(terms):
        return None
    if "thorough" in left_out and any(word in place for word in PERCEPTION):
        return True
    marks = _MARKS_OF_A_FILE.search(collection_path.read_text(encoding="utf-8"))
    return True if marks and left_out & set(re.findall(r"mark\.(\w+)", marks[1])) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks property tests and state machines, and perception; puts first what takes long."""
    in_wall_time = {item.path for item in items if item.get_closest_marker("sockets")}
    hidden = [path for path in in_wall_time if not _HAS_SOCKETS.search(path.read_text(encoding="utf-8"))]
    if hidden:
        raise pytest.UsageError(
            f"`-m sockets` would not find the mark in {', '.join(map(str, hidden))}: write it there"
        )
    for item in items:
        function = getattr(item, "obj", None)
        is_search = getattr(function, "is_hypothesis_test", False) or item.nodeid.endswith("::runTest")
        if is_search or any(word in item.nodeid.partition("::")[0] for word in PERCEPTION):
            item.add_marker(pytest.mark.thorough)
    items.sort(key=lambda item: not any(word in item.nodeid.partition("::")[0] for word in LONG))


def pytest_make_parametrize_id(val: object) -> str | None:
    """Of a long text its begin names a test: names are sent between processes, several times each."""
    return repr(val[:LONGEST_NAME]) if isinstance(val, str | bytes) and len(val) > LONGEST_NAME else None


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skips what needs data that is not here, all with one reason at one place: that is one line of the summary."""
    if item.get_closest_marker("outside") is not None and not OUTSIDE.is_dir():
        pytest.skip(REASON)


gc.disable()  # while files are imported and tests are made, next to nothing is garbage


def pytest_collection_finish() -> None:
    """The thousands of tests that wait are no garbage: it costs a tenth of the time to look through them again and again."""
    gc.collect()
    gc.freeze()
    gc.enable()
