"""The AUV and the ROV dive a mission on their own reckoning, and come up where they say."""

from pathlib import Path

import pytest
from tests.flight.diving import SHORT_DIVE, dive


def test_it_dives_by_its_own_reckoning_and_comes_up(tmp_path: Path) -> None:
    found = dive(SHORT_DIVE, "auv", 5, tmp_path)
    assert (found.state, found.reason) == ("done", "")
    assert found.deepest_m == pytest.approx(3.0, abs=0.4)
    assert found.distance_m > 14.0
    assert found.off_m < 0.03 * found.distance_m
    assert not found.reasons, "bottom lock all the way"


def test_without_its_dvl_it_says_that_it_is_adrift_and_the_same_seed_gives_the_same_log(tmp_path: Path) -> None:
    for name in ("one", "same"):
        (tmp_path / name).mkdir()
    faults = ("device:dvl=lost@20..300",)
    patient = tmp_path / "patient.yaml"
    patient.write_text("extends: rov\nplatform: rov\ncomponents:\n  - {name: pose, settings: {blind_s: 600}}\n")
    found = dive(SHORT_DIVE, str(patient), 6, tmp_path / "one", faults=faults, out="flight")
    assert any(reason.startswith("adrift: ") for reason in found.reasons)
    assert found.claimed_m > 2.0
    dive(SHORT_DIVE, str(patient), 6, tmp_path / "same", faults=faults, out="flight")
    assert (tmp_path / "one/flight/log.mcap").read_bytes() == (tmp_path / "same/flight/log.mcap").read_bytes()


def test_without_its_dvl_it_comes_up_before_it_has_gone_astray(tmp_path: Path) -> None:
    found = dive(SHORT_DIVE, "rov", 6, tmp_path, faults=("device:dvl=lost@20..300",))
    assert (found.state, found.reason) == ("failed", "pose lost: land")
    assert found.off_m < 1.0
    assert found.off_m < 3.0 * found.claimed_m


def test_in_waves_that_never_let_it_rest_it_surfaces_and_is_disarmed_all_the_same(tmp_path: Path) -> None:
    found = dive(SHORT_DIVE, "auv", 5, tmp_path, waves_m=0.3)
    assert (found.state, found.reason) == ("done", "")
