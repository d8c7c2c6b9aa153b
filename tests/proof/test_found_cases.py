"""Flights that once broke an invariant, and flights that one of the planted mistakes would break.

A new one is a line of `found_cases.jsonl`, or of `planted/flights.jsonl`: the replay file of `gloc3 prove`.
"""

from pathlib import Path

import msgspec
import pytest

from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.trial import fly_case

pytestmark = pytest.mark.flight

FOLDER = Path(__file__).parent
LINES = [
    line
    for name in ("found_cases.jsonl", "planted/flights.jsonl")
    for line in (FOLDER / name).read_text(encoding="utf-8").splitlines()
]


@pytest.mark.parametrize("line", LINES)
def test_every_invariant_holds(line: str) -> None:
    result = fly_case(msgspec.json.decode(line, type=FlightCase))
    assert not result.refused
    assert result.started_s > 0.0, "the mission never ran: nothing was tried"
    assert not result.broken, "\n".join(["", *result.story, *map(str, result.broken)])
