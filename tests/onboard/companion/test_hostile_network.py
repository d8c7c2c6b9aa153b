"""Attacks on the network of a vehicle in flight, over network namespaces; all of them are on the page network-hostile."""

import asyncio
from pathlib import Path

import pytest
from msgspec.structs import replace
from tests.onboard.hostile_network import (
    ADDRESS,
    SPACES,
    STRANGER,
    attacks_on,
    fly_and_attack,
    made_yard,
    spaces,
    stall,
)
from tests.onboard.hosts.namespaces import missing

pytestmark = [pytest.mark.sockets, pytest.mark.thorough, pytest.mark.timeout(180)]
CHOSEN = (
    "without encryption",
    "an observer puts commands in others' names",
    "an observer's questions have 200 MB",
    "1,500 idle connections",
    "… and a member that connects afterwards",
)
JOINED_S = 5.0
STILL_S = 0.5
"""The page shows 0.1 s, on a computer that does nothing else."""


def test_nobody_but_the_operator_is_obeyed_and_nothing_stands_still(tmp_path: Path) -> None:
    if lack := missing():
        pytest.skip(lack)
    with spaces():
        yard = made_yard(tmp_path)
        attacks = {one.name: one for one in asyncio.run(attacks_on(yard, tmp_path, 2.0))}
        chosen = [attacks[name] for name in CHOSEN]
        chosen[2] = replace(chosen[2], size=20_000_000)
        chosen[3] = replace(chosen[3], number=300, seconds=2.0)
        found = fly_and_attack(tmp_path, yard, chosen)
    *attackers, newcomer = found.phases
    assert all(phase.outcome.sent > 0 for phase in attackers)
    assert newcomer.outcome.read > 0
    assert float(newcomer.outcome.note.split()[0]) < JOINED_S
    assert any(text.startswith(f"refused {SPACES[STRANGER]}: ") for text in found.refused)
    assert found.phases[0].outcome.read == 0
    assert found.phases[1].outcome.read > 0, "an observer may look"
    assert max(phase.stalled_s for phase in found.phases) < STILL_S
    assert max(phase.grown_mb for phase in found.phases) < 100.0
    assert set(found.accepted) == {"alice"}
    assert (found.set_rates, found.mission, found.lost) == (0, "running", 0)
    assert found.open_sockets == [f"tcp {ADDRESS}"]


def test_a_stall_is_the_longest_gap_in_its_span() -> None:
    times = [0.0, 0.05, 0.10, 0.45, 0.5, 0.55, 2.0]
    assert stall(times, 0.0, 0.6) == pytest.approx(0.30)
    assert stall(times, 0.4, 0.6) == pytest.approx(0.0)
    assert stall(times, 0.6, 0.7) == float("inf"), "it published nothing"
