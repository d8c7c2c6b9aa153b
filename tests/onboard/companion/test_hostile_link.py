"""Somebody without the key on a signed link, and invented systems in masses on an open one."""

import pytest
from tests.onboard.hostile_scenario import scenario

pytestmark = pytest.mark.thorough


def test_who_has_no_key_gets_nothing_through_is_counted_and_costs_no_memory() -> None:
    figures = scenario(400)
    assert figures.attacks == 8 * 400
    assert sum(figures.refused.values()) == figures.attacks
    assert set(figures.refused) == {"not signed", "the signature is wrong", "a replayed frame"}
    assert (figures.reached_autopilot, figures.reached_companion) == (0, 0)
    assert figures.told == 3, "each reason once a minute"
    assert figures.still_served, "the true station, signed, as before: no forged time has locked it out"
    assert figures.from_future == figures.from_future_refused == 400
    assert figures.moved_s == 0.0, "who has the key and a wrong clock does not set ours"
    assert figures.replayed > 20
    assert figures.taken_again == 0, "nor is anything taken once more by the next onboard process"
    assert (figures.invented, figures.senders) == (400, 256)
    assert figures.flood_still_served, "and keep nobody out who was there before"
    assert figures.growth_bytes < 20_000
