"""Plug-ins of installed packages: the example's screen, line and alert, and those that fail."""

from pathlib import Path

import pytest
from tests.groundstation.station_scene import scene
from tests.installed_package import install, install_example

from gloc3_groundstation.tui.screens.plugged import PREFIX

pytestmark = pytest.mark.sockets
BROKEN = """
def rule(fleet, now_s):
    raise ValueError("no calibration\\nhere")

def line(platform, now_s):
    return 3

def lines(fleet, platform, now_s):
    return 1 // 0

from gloc3_groundstation.plug_ins import PlugInScreen
SCREEN = PlugInScreen(title="Broken", help="", lines=lines)
NOTHING = 7
"""


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install_example(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gloc3_broken.py").write_text(BROKEN)
    install(
        tmp_path,
        "gloc3_broken",
        {
            "gloc3.screens": {"broken": "gloc3_broken:SCREEN", "number": "gloc3_broken:NOTHING"},
            "gloc3.overview_lines": {"broken": "gloc3_broken:line", "gone": "gloc3_no_such_module:line"},
            "gloc3.alert_rules": {"broken": "gloc3_broken:rule"},
        },
    )
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.usefixtures("example")
async def test_the_example_brings_a_screen_a_line_and_an_alert() -> None:
    async with scene(None) as here:
        here.platform.speak()
        here.platform.fly(position_m=(300.0, 400.0, 5.0))
        await here.until("facts", "range     500 m from the origin")
        await here.until("alerts", "more than 100 m from the origin")
        here.app.action_go(f"{PREFIX}range")
        await here.until("plugged", f"{'heron':<16}500 m from the origin")
        here.platform.fly(position_m=(3.0, 4.0, 5.0))
        await here.wait(lambda: all(alert.is_over for alert in here.app.desk.alerts().listed))
        await here.go("1")


@pytest.mark.usefixtures("broken")
async def test_those_that_fail_are_named_in_a_line_each_and_left_out() -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.until("facts", "battery")
        here.app.action_go(f"{PREFIX}broken")
        await here.until("plugged", "broken has failed; the screen Events (9) has the reason")
        await here.go("1")
        await here.until("facts", "battery")
        texts = [event.text for event in here.station.fleet.events if event.text.startswith("plug-in ")]
        assert sorted(texts) == [
            "plug-in broken (gloc3.alert_rules) is left out: ValueError: no calibration here",
            "plug-in broken (gloc3.overview_lines) is left out: AttributeError: 'int' object has no attribute 'split'",
            "plug-in broken (gloc3.screens) is left out: ZeroDivisionError: integer division or modulo by zero",
            "plug-in gone (gloc3.overview_lines) is left out: ModuleNotFoundError: No module named 'gloc3_no_such_module'",
            "plug-in number (gloc3.screens) is left out: gloc3_broken:NOTHING is of another kind",
        ]
