"""Inventory: hours are counted and kept over restarts, also over one that a power cut forces."""

from pathlib import Path

import pytest

from gloc3.store import DocumentFile
from gloc3_onboard.command_server.inventory import KEEP_S, UsageMeter
from gloc3_onboard.command_server.site import Usage


def kept(folder: Path) -> DocumentFile[Usage]:
    return DocumentFile(folder / "usage.json", Usage)


def test_hours_are_counted_while_armed_and_kept_over_a_restart(tmp_path: Path) -> None:
    meter = UsageMeter(kept(tmp_path))
    for second in range(101):
        meter.observe(1000.0 + second, is_armed=10 <= second < 40 or 50 <= second < 55)
    assert meter.usage == Usage(powered_s=100.0, armed_s=35.0, armings=2)
    again = UsageMeter(kept(tmp_path))
    assert again.usage.powered_s == pytest.approx(55.0, abs=KEEP_S), (
        "as it was kept last: at a disarming, or every minute"
    )
    assert (again.usage.armed_s, again.usage.armings) == (35.0, 2)
    before_s = again.usage.powered_s
    again.observe(5.0, is_armed=True)  # the clock has started again, and it is in flight
    again.observe(7.0, is_armed=True)
    assert again.usage == Usage(powered_s=before_s + 2.0, armed_s=37.0, armings=3)


def test_a_damaged_file_begins_at_zero_and_nothing_is_kept_without_one(tmp_path: Path) -> None:
    (tmp_path / "usage.json").write_text('{"powered_s": "x"}')
    assert UsageMeter(kept(tmp_path)).usage == Usage()
    meter = UsageMeter(None)
    meter.observe(0.0, is_armed=True)
    meter.observe(2.0 * KEEP_S, is_armed=True)
    assert meter.usage == Usage(powered_s=120.0, armed_s=120.0, armings=1)
