"""Bars on the ground station in front of a person: what it says in trouble, and journeys in a terminal and a browser."""

import asyncio
import base64
import tempfile
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from tests.evidence.page import PAGES, Bar, Figure, Progress
from tests.evidence.suites import suite

PICTURE = PAGES / "web.png"


def problems(progress: Progress) -> list[Figure]:
    """Has everything go wrong, and keeps what the station says."""
    from tests.groundstation.troubles import TROUBLES, one_line

    figures = []
    for problem in TROUBLES:
        shown = one_line(progress.part(problem.what, lambda problem=problem: asyncio.run(problem.show())))  # type: ignore[misc]
        is_met = problem.matter in shown and problem.advice in shown
        bar = f"says “{problem.matter}” and “{problem.advice}”"
        figures.append(Figure(problem.what, shown.replace("|", "\\|"), bar, is_met))
    return figures


def browser(progress: Progress) -> list[Figure]:
    """Flies in a headless Chromium."""
    from tests.groundstation.browser_journey import fly
    from tests.groundstation.chromium import found

    if found() is None:
        return [Figure("Chromium", "is not installed here", "is", is_met=False)]

    def flown() -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as folder:
            result = asyncio.run(fly(Path(folder)))
        return {**result._asdict(), "picture": base64.b64encode(result.picture).decode()}

    result = progress.part("journey", flown)
    PICTURE.write_bytes(base64.b64decode(result["picture"]))
    own = urlsplit(result["url"]).netloc
    elsewhere = [url for url in result["requested"] if urlsplit(url).netloc != own]
    last = result["reported"].splitlines()[-2]
    return [
        Figure("exit code of the station after the key q", str(result["code"]), "0", result["code"] == 0),
        Figure("the mission that was started, held and landed by keys", last, "aborted", "'hop' is aborted" in last),
        Figure("things that the page asks of other computers", str(len(elsewhere)), "0", not elsewhere),
        Figure("errors in the page", str(len(result["problems"])), "0", not result["problems"]),
        Figure("what the browser was sent, kB", f"{result['received_bytes'] / 1000:.0f}"),
        Figure("in all, seconds", f"{result['took_s']:.0f}"),
        Figure("the browser in flight", f"![flight data in a browser]({PICTURE.name})"),
    ]


BARS = (
    Bar(
        "trouble",
        "For each trouble the station says what is wrong and what to do",
        "Each row causes one trouble around a station. The station says what is wrong and what to do.",
        problems,
    ),
    Bar(
        "web",
        "A browser flies a mission by keys, and may reload its page in flight",
        "`gloc3 station --web`, the onboard process and the simulated vehicle run as three processes. In a headless "
        "Chromium a mission is opened, started, held and landed by keys. The page is reloaded in flight, which does "
        "not disturb the station.",
        browser,
    ),
    Bar(
        "terminal",
        "The station works in a real terminal and in tmux",
        "Three real processes run on a pty of 80×24 and under tmux. A mission with a mistake is opened, corrected, "
        "saved, uploaded, started, paused, resumed and aborted by keys; the window is made too small, then 250×70.",
        suite(
            "terminal", ["tests/groundstation/tui/test_real_terminal_journey.py", "tests/groundstation/web/test_web.py"]
        ),
    ),
)
