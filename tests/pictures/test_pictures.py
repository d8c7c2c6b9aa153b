"""The pictures in the docs: made by a command, small, shown on a page; and an animation that shows what was on the screen."""

import re
from html import unescape
from pathlib import Path

import pytest
from tests.pictures.__main__ import FOLDER, LARGEST_BYTES, SETS
from tests.pictures.animation import Animation
from tests.pictures.station import checks_picture

ROOT = Path(__file__).parents[2]
ELSEWHERE = {"rooms.svg": "make docs", "worlds.jpg": "make evidence NAME=world"}
"""Pictures that other commands make."""
SHOT = """<svg viewBox="0 0 300 100"><style>.terminal-7-r1 {{ fill: #ffffff }}
.terminal-7-r2 {{ fill: #ff0000 }}</style>
<rect fill="#101418" x="0" y="1.5" width="244" height="24.65" shape-rendering="crispEdges"/>
<rect fill="#56b4e9" x="24.4" y="25.9" width="12.2" height="24.65" shape-rendering="crispEdges"/>
<text class="terminal-7-r1" x="0" y="20" textLength="122" clip-path="url(#a)">&#160;{}&#160;</text>
<text class="terminal-7-r2" x="0" y="44.4" textLength="48.8" clip-path="url(#b)">stay</text></svg>"""
GROUP = re.compile(
    r'<g transform="translate\(0 ([\d.]+)\)"(?: class="a(?: f)?" style="animation:k([\d_]+) [\d.]+s ([\d.]+)s infinite")?>(.*?)</g>'
)


def shown(svg: str, at_s: float) -> dict[float, str]:
    """The text of each line at a time, by its height."""
    found = {}
    for y, length, begin, line in GROUP.findall(svg):
        if not length or float(begin) <= at_s < float(begin) + float(length.replace("_", ".")):
            assert float(y) not in found, "one line at a time"
            found[float(y)] = unescape("".join(re.findall(r"<text[^>]*>(.*?)</text>", line)))
    return found


def test_an_animation_shows_each_screenshot_at_its_time_and_keeps_a_line_that_stays_once() -> None:
    movie = Animation("words")
    words = ("one", "one", "t&lt;o", "one")
    for word in words:
        movie.add(SHOT.format(word), 0.4)
    svg = movie.svg()
    assert movie.length_s == pytest.approx(1.6)
    assert [shown(svg, 0.4 * number + 0.1) for number in range(4)] == [
        {20.0: unescape(word), 44.4: "stay"} for word in words
    ]
    assert svg.count(">stay<") == 1
    assert re.findall('class="a f".*?>(one|two|t&lt;o)<', svg) == ["one"], "all that who wants no motion sees of it"
    assert svg.count(">one<") == 2, "before and after"
    assert 'd="M24.4 -18.5H36.6' in svg
    assert "#101418" in svg.partition("<g ")[0], "the ground of most lines is drawn once"
    assert "@keyframes k0_4{0%{visibility:visible}25.00%,to{visibility:hidden}}" in svg


def test_a_picture_that_does_not_change_has_nothing_that_moves() -> None:
    still = Animation("words")
    still.add(SHOT.format("one"), 1.0)
    assert "animation:k" not in still.svg()


def test_every_picture_is_made_by_a_command_and_shown_on_a_page() -> None:
    made = {name for files, _ in SETS.values() for name in files}
    there = {path.name for path in FOLDER.iterdir()}
    assert there == made | set(ELSEWHERE)
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    assert {name for name in there if f"pictures/{name})" not in text} == set()
    assert {path.name: path.stat().st_size for path in FOLDER.iterdir() if path.stat().st_size > LARGEST_BYTES} == {}


@pytest.mark.flight
def test_a_screen_is_drawn_from_a_real_flight(tmp_path: Path) -> None:
    checks_picture(tmp_path, tmp_path)
    svg = (tmp_path / "checks.svg").read_text(encoding="utf-8")
    assert "RED<" in svg
    assert "NAV_DLL_ACT" in svg
