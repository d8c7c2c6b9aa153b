"""Some cells of the matrix of link losses; `python -m tests.evidence link-loss` flies them all, in both styles."""

import pytest
from tests.flight.card import Card
from tests.flight.link_loss import Case, fall, fly


@pytest.mark.parametrize(
    ("style", "link", "phase", "loss"),
    [
        ("ardupilot", "station", "mission", "long"),
        ("px4", "autopilot", "mission", "long"),
        ("px4", "autopilot", "idle", "restart"),
    ],
    indirect=["style"],
)
def test_a_link_is_lost_and_comes_back_and_nothing_sticks(
    flight: Card, style: str, link: str, phase: str, loss: str
) -> None:
    found = fly(flight, Case(style, link, phase, loss))
    assert found.policy == ("hold" if link == "station" else "")
    assert found.noticed_s > 0.0


@pytest.mark.parametrize("style", ["ardupilot"], indirect=True)
def test_an_autopilot_that_boots_anew_in_the_air_is_not_armed_again_and_nothing_sticks(
    flight: Card, style: str
) -> None:
    found = fall(flight)
    assert found.noticed_s < 5.0
    assert found.end in ("paused", "failed")
