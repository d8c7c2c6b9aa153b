"""Attacks on the real sockets of an onboard process come to nothing."""

from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from tests.onboard.process.replays import ATTACKS, Replayed

pytestmark = pytest.mark.sockets


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.__name__)
async def test_an_attack_is_held_off(tmp_path: Path, attack: Callable[[Path], Awaitable[Replayed]]) -> None:
    found = await attack(tmp_path)
    assert found.is_held_off, found.seen
