"""The radio link: an upload at 57,600 baud with 20 % loss, and the mission protocol at 10 % loss, over many seeds."""

from functools import partial
from statistics import median
from typing import Any

from tests.evidence.page import Bar, Figure, Progress
from tests.evidence.suites import suite

UPLOADS = 200
TRANSFERS = 1000
BLOCK = 50


def uploads(first: int, count: int) -> list[dict[str, Any]]:
    """Some runs of the upload scenario."""
    from tests.common.exchange.mavlink import upload_scenario

    rows = []
    for seed in range(first, first + count):
        figures = upload_scenario.scenario(seed)
        lost = [number for number in figures.acknowledged if figures.handed_over.get(number, 0) == 0]
        rows.append(
            {
                "upload_s": figures.upload_s,
                "is_equal": figures.is_equal,
                "twice": sum(times > 1 for times in figures.handed_over.values()),
                "lost": len(lost),
                "hz": figures.slowest_status_hz,
                "gap_s": figures.longest_gap_s,
                "share": figures.status_share_in_upload,
            }
        )
    return rows


def transfers(first: int, count: int) -> list[dict[str, Any]]:
    """Some runs of the mission protocol with 800 items and 10 % loss each way."""
    from tests.common.mavlink.mission_transfer import transfer

    rows = []
    for seed in range(first, first + count):
        result = transfer(seed)
        rows.append({"is_good": result.is_good, "upload_s": result.upload_s, "download_s": result.download_s})
    return rows


def run(progress: Progress) -> list[Figure]:
    """The bar."""
    rows: list[dict[str, Any]] = []
    for first in range(0, UPLOADS, BLOCK):
        rows += progress.part(f"uploads from {first}", partial(uploads, first, BLOCK))
        progress.report(f"{len(rows)} of {UPLOADS} uploads")
    times = [row["upload_s"] for row in rows]
    unequal = sum(not row["is_equal"] for row in rows)
    twice, lost = sum(row["twice"] for row in rows), sum(row["lost"] for row in rows)
    slowest, gap, share = min(r["hz"] for r in rows), max(r["gap_s"] for r in rows), max(r["share"] for r in rows)
    moved: list[dict[str, Any]] = []
    for first in range(0, TRANSFERS, BLOCK):
        moved += progress.part(f"transfers from {first}", partial(transfers, first, BLOCK))
        progress.report(f"{len(moved)} of {TRANSFERS} transfers")
    bad = sum(not row["is_good"] for row in moved)
    return [
        Figure("uploads of 20 kB", str(len(rows))),
        Figure("upload, median in seconds", f"{median(times):.1f}", "≤ 15", median(times) <= 15.0),
        Figure("upload, worst in seconds", f"{max(times):.1f}"),
        Figure("read back different", str(unequal), "0", unequal == 0),
        Figure("requests handed over twice", str(twice), "0", twice == 0),
        Figure("acknowledged requests that were lost", str(lost), "0", lost == 0),
        Figure("status of the least lucky of 20 components, Hz", f"{slowest:.2f}", "≥ 1", slowest >= 1.0),
        Figure("longest gap in seconds", f"{gap:.1f}", "≤ 5", gap <= 5.0),
        Figure("status while a mission uploads, share of the link", f"{share:.1%}", "≤ 15 %", share <= 0.15),
        Figure("transfers of 800 items at 10 % loss each way", str(len(moved))),
        Figure("… that failed", str(bad), "0", bad == 0),
        Figure("… upload, median in seconds", f"{median(row['upload_s'] for row in moved):.1f}"),
        *suite("mission-with-mavsdk", ["tests/common/mavlink/test_mission_with_mavsdk.py"])(progress),
    ]


BARS = (
    Bar(
        "link",
        "A mission arrives over a radio that loses 20 % of the frames",
        "Over a 57,600 baud memory link that loses 20 % of the frames each way with 300 ms latency, 20 kB are "
        "uploaded within 15 s, and nothing runs twice or is lost. The mission protocol moves 800 items at 10 % loss "
        "without a failure.",
        run,
        seeds=f"0 to {UPLOADS - 1}; 0 to {TRANSFERS - 1}",
    ),
)
