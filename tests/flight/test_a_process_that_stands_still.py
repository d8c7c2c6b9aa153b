"""The whole process stands still for a moment, as one does whose disk or memory has no time for it: nobody was silent."""

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.mission.executing.board import PolicyCondition


@ONE_STYLE
@pytest.mark.parametrize("stall_s", [2.9, 8.0])
def test_what_was_not_heard_meanwhile_is_not_taken_for_lost(flight: Card, stall_s: float) -> None:
    flight.begin(mission(on_pose_lost="land", on_failure="land"))
    flight.await_state("sweep", "running")
    flight.wait(2.0)
    loop = flight.flight.loop
    loop.call_later(0.05, lambda: setattr(loop, "_now_s", loop.time() + stall_s))
    flight.wait(stall_s + 5.0)
    reported = [one.payload.text for one in flight.received["ci/event"]]
    assert not [text for text in reported if PolicyCondition.POSE_LOST in text or "is lost" in text], reported
    assert any("this process stalled for" in text for text in reported)
    assert flight.received["ci/mission"][-1].payload.policy == ""
