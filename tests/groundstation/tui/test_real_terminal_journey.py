"""An operator's journey in a real terminal of 80×24, with three real processes over UDP."""

import re
from pathlib import Path

import pytest
from tests.groundstation.real_terminal import RealTerminal, lack, real_vehicle, terminal, until, wait

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

MISSION = """mission: look around
frame: hold
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}
on_failure: land
on_link_loss: land
on_low_battery: land
on_pose_lost: land
tasks:
  look:
    actions:
      up:   {take_off: {height_m: 1.0}}
      stay: {hold: {duration_s: 100}, after: [up]}
      down: {land: {}, after: [stay]}
"""


def widths(shown: str, begin: str) -> list[int]:
    """How long the lines are that begin so."""
    return [len(line) for line in shown.splitlines() if line.startswith(begin)]


def journey(screen: RealTerminal, folder: Path) -> None:
    """Opens a mission, checks it, puts right what is wrong, streams, starts, pauses, resumes, aborts, quits."""
    wait(screen, lambda shown: re.search(r"health +all \d+ well", shown) is not None, "all components work")
    screen.press("3", "o")
    until(screen, "open a mission")
    screen.press(str(folder / "look.yaml"), "enter")
    until(screen, "2 errors", "11✗", "hieght_m")
    screen.press(*["\x1b[C"] * 2, *["\x1b[3~"] * 2, "e", "i")
    until(screen, "fit to fly on pelican")
    screen.press("^s")
    wait(screen, lambda _: "height_m: 1.0" in (folder / "look.yaml").read_text(), "the file is saved")
    screen.press("escape")
    until(screen, "open: look.yaml")
    screen.press("8")
    until(screen, "nothing is red")
    screen.press("3", "u")
    until(screen, "on pelican")
    screen.press("s")
    until(screen, "Start look around on pelican?", "y  start")
    screen.press("y")
    until(screen, "ARMED", "Offboard", "running")
    screen.press("p")
    until(screen, "= look", "paused")
    screen.press("r")
    until(screen, "► stay", "✓ up")
    screen.press("1")
    until(screen, "armed, in air", "look around: running", "this station in control")
    screen.resize(60, 20)
    until(screen, "This terminal has 60 × 20 characters.", "The station needs 80 × 24: enlarge it.")
    screen.resize(250, 70)
    until(screen, "look around: running", "? Help")
    wait(screen, lambda shown: widths(shown, "─events") == [250], "the screen has its new width")
    screen.resize(80, 24)
    until(screen, "armed, in air", "look around: running", "? Help")
    screen.press("a")
    until(screen, "Abort", "y  abort")
    screen.press("y")
    until(screen, "look around: aborted")
    until(screen, "disarmed")
    screen.press("q")
    wait(screen, lambda _: screen.ended() is not None, "its end")
    assert screen.ended() == 0
    until(screen, "'look around' is aborted", "stopped")


@pytest.mark.parametrize("kind", ["pty", "tmux"])
def test_an_operator_opens_mends_streams_and_steers_a_mission(kind: str, tmp_path: Path) -> None:
    if lack(kind):
        pytest.skip(lack(kind))
    (tmp_path / "look.yaml").write_text(MISSION.replace("height_m", "hieght_m"))
    with real_vehicle(tmp_path) as (link, _, _), terminal(kind, "station", "--link", link, folder=tmp_path) as screen:
        journey(screen, tmp_path)
