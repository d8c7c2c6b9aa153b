"""The bar on the station's pages in a browser: three sizes, standstill, restart, rights, TLS, and what it costs."""

import asyncio
import tempfile
from collections.abc import Callable, Coroutine
from functools import partial
from pathlib import Path
from typing import Any

from tests.evidence.page import PAGES, Bar, Figure, Progress
from tests.groundstation import browser_bars as bars

FOLDER = PAGES / "browser"
TOUCHABLE_PX = 44.0
"""The least side of what a finger is to hit."""
LOST_S, BACK_S, RESTARTED_S = 3.0, 6.0, 15.0
SHARE = 0.30
"""Of a core, of the station that shows twenty vehicles."""
NAMES = {"": "terminal", "map": "map", "pictures": "pictures"}


def run(work: Callable[..., Coroutine[Any, Any, Any]], *arguments: Any) -> Any:
    """Does something in a folder of its own."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        for name in ("one", "two"):
            (Path(folder) / name).mkdir()
        return asyncio.run(work(Path(folder), *arguments))


def keep(picture: str, name: str) -> str:
    """Keeps a picture beside the page; its Markdown."""
    import cv2
    import numpy as np

    FOLDER.mkdir(parents=True, exist_ok=True)
    pixels = cv2.imdecode(np.frombuffer(bytes.fromhex(picture), np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    cv2.imwrite(str(FOLDER / f"{name}.webp"), pixels, [cv2.IMWRITE_WEBP_QUALITY, 60])
    return f"![{name}]({FOLDER.name}/{name}.webp)"


def browser(progress: Progress) -> list[Figure]:
    """Everything, one part after the other."""
    from tests.groundstation.chromium import found

    if found() is None:
        return [Figure("Chromium", "is not installed here", "is", is_met=False)]
    figures: list[Figure] = []
    for size in bars.SIZES:
        figures += hold_figures(progress, size)
        figures += frozen_figures(progress, size)
    return [*figures, *access_figures(progress), *cost_figures(progress)]


def hold_figures(progress: Progress, size: bars.ScreenSize) -> list[Figure]:
    """HOLD on every page of a size."""
    figures = []
    for row in progress.part(f"hold {size}", partial(run, bars.held, size)):
        page, button = NAMES[row["page"]], row["button"]
        progress.report(f"{size}, {page}: {row['said']}")
        large = min(button["width"], button["height"]) if button is not None else 0.0
        is_met = button is not None and button["isWhole"] and large >= TOUCHABLE_PX
        where = "none"
        if button is not None:
            where = f"{button['width']:.0f} × {button['height']:.0f} px, {'whole' if button['isWhole'] else 'cut'}"
        what = f"{size}, {page}"
        picture = keep(row["picture"], f"{page}_{size.width}")
        figures += [
            Figure(
                f"{what}: HOLD, on the screen and covered by nothing", where, f"whole, ≥ {TOUCHABLE_PX:g} px", is_met
            ),
            Figure(
                f"{what}: HOLD pressed by {'finger' if size.is_touch else 'mouse'}",
                row["said"],
                "the vehicle holds",
                "hold" in row["said"].lower() and "NOT" not in row["said"],
            ),
            Figure(f"{what}: nothing is cut at the bottom", str(row["is_whole"]), "True", row["is_whole"]),
            Figure(f"{what}: what is seen", picture),
        ]
    return figures


def frozen_figures(progress: Progress, size: bars.ScreenSize) -> list[Figure]:
    """A station that stands still."""
    row = progress.part(f"frozen {size}", partial(run, bars.frozen, size))
    progress.report(f"{size}: told after {row['lost_s']:.1f} s, gone after {row['back_s']:.1f} s")
    lost_s, back_s = row["lost_s"], row["back_s"]
    picture = keep(row["picture"], f"frozen_{size.width}")
    return [
        Figure(
            f"{size}: a frozen station (SIGSTOP) is told after, s", f"{lost_s:.1f}", f"≤ {LOST_S:g}", lost_s <= LOST_S
        ),
        Figure(f"{size}: after SIGCONT the page is back in, s", f"{back_s:.1f}", f"≤ {BACK_S:g}", back_s <= BACK_S),
        Figure(f"{size}: errors in the page", str(len(row["problems"])), "0", not row["problems"]),
        Figure(f"{size}: the frozen station", picture),
    ]


def access_figures(progress: Progress) -> list[Figure]:
    """A restart, two browsers, tokens, TLS."""
    again = progress.part("restart", partial(run, bars.restarted))
    two = progress.part("two browsers", partial(run, bars.two_browsers))
    may = progress.part("rights", partial(run, bars.rights))
    tls = progress.part("tls", partial(run, bars.encrypted))
    progress.report(f"restart {again}; {may}; {tls}")
    back_s = again["back_s"]
    return [
        Figure(
            "the station is ended and started again with the same token: the page is back by itself, s after its start",
            f"{back_s:.1f}",
            f"≤ {RESTARTED_S:g}",
            back_s <= RESTARTED_S,
        ),
        Figure("a second browser takes the terminal by enter; the first is", two["first"], "told", bool(two["first"])),
        Figure("the first browser opens the map meanwhile", two["map"], "link ok", two["map"] == "link ok"),
        Figure("a wrong token: HTTP status", str(may["status"]), "403", may["status"] == 403),
        Figure("a wrong token: the page", may["title"], "says so", "does not open" in may["title"]),
        Figure("a wrong token: the station", may["refused"].partition("  ")[0], "reports it", "wrong token" in may["refused"]),
        Figure("addresses that the station prints: one commands, one watches", str(may["addresses"]), "2", may["addresses"] == 2),
        Figure("read-only: the page", may["role"], "says so", "READ-ONLY" in may["role"]),
        Figure("read-only: HOLD", may["remark"], "does nothing, and says so", not may["is_held"] and "read-only" in may["remark"]),
        Figure("`--web-tls self`: the page is a secure context, by https", str(tls["is_secure"]), "True", tls["is_secure"] is True),
        Figure("`--web-tls self`: the fingerprint is printed", str(tls["fingerprint"]), "True", tls["fingerprint"]),
        Figure("`--web-tls self`: requests that are not encrypted", str(tls["plain"]), "0", tls["plain"] == 0),
    ]  # fmt: skip


def cost_figures(progress: Progress) -> list[Figure]:
    """Twenty vehicles."""
    row = progress.part("costs", partial(run, bars.costs))
    load = f"{bars.VEHICLES} vehicles × {bars.PARTS} components at {bars.RATE_HZ:g} Hz"
    figures = [Figure(f"{load}, no browser: station, % of a core", f"{100.0 * row['nobody']:.0f}")]
    for page, name in NAMES.items():
        ours, seen = row[f"{page} station"], row[f"{page} vehicles"]
        progress.report(f"{name}: station {100.0 * ours:.0f} %, browser {100.0 * row[f'{page} browser']:.0f} %")
        figures += [
            Figure(f"{load}, {name}: vehicles that it shows", str(seen), str(bars.VEHICLES), seen == bars.VEHICLES),
            Figure(
                f"{load}, {name}: station, % of a core", f"{100.0 * ours:.0f}", f"≤ {100.0 * SHARE:g}", ours <= SHARE
            ),
            Figure(
                f"{load}, {name}: Chromium without a GPU, all processes, % of a core",
                f"{100.0 * row[f'{page} browser']:.0f}",
            ),
        ]
    figures.append(Figure(f"{load}: drawn in the terminal's page, kB/s", f"{row[' bytes_s'] / 1e3:.1f}"))
    return figures


BARS = (
    Bar(
        "browser",
        "HOLD works on every page of the station in a browser, on three screen sizes",
        "`gloc3 station --web` runs as its own process with simulated vehicles over UDP. A headless Chromium opens "
        "its pages in three sizes, one with touch. HOLD is on every page, a frozen station is reported within 3 s, "
        "pages reconnect on their own, rights and TLS hold, and twenty vehicles cost little. (Wall time, on two "
        "shared cores.)",
        browser,
    ),
)
