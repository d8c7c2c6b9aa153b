"""Every event that a station receives of a flight with trouble in it is on the reference page of events."""

import re

from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission
from tests.house.events import events

GENERAL = re.compile(r"[^a-z]*", re.IGNORECASE)
"""What is left of a row that any text fits, such as `{what}: {error}`."""


def patterns() -> list[re.Pattern[str]]:
    """The page's rows that say something, as patterns."""
    found = {row.says for rows in events().values() for row in rows}
    parts = {says: re.split(r"\{\w+\}|…", says) for says in found}
    return [
        re.compile(".*".join(map(re.escape, part)), re.DOTALL)
        for part in parts.values()
        if not GENERAL.fullmatch("".join(part))
    ]


@ONE_STYLE
def test_all_events_of_a_flight_with_trouble_are_on_the_page(flight: Card) -> None:
    flight.begin(mission(on_failure="hold"))
    flight.await_state("sweep", "running")
    flight.fault("crash:waypoints")
    flight.wait(3.0)
    known = patterns()
    states = re.compile(r"[\w.-]+ (running|done|failed|paused|aborted|waiting|skipped)(: .*)?", re.DOTALL)
    said = [event for event in flight.flight.station.fleet.events if "injected crash" not in event.text]
    assert len(said) > 5
    assert [one.text for one in said if not any(fits.fullmatch(one.text) for fits in (*known, states))] == []
