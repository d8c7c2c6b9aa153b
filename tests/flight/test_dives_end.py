"""Every dive ends: whatever is lost for a while, the vehicle surfaces and is disarmed there."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.flight.card import Card
from tests.flight.diving import SHORT_DIVE

AFLOAT_M = 0.5
"""The middle of a vehicle that floats is less deep than this."""
FENCE_M = 40.0

Dive = Callable[..., Card]


@pytest.fixture
def dive(tmp_path: Path) -> Iterator[Dive]:
    """Flies the mission, with faults, until the vehicle is disarmed."""
    card = Card("ardupilot", tmp_path)

    def fly(platform: str, *faults: str, within_s: float = 120.0, **plan: Any) -> Card:
        card.begin(SHORT_DIVE, platform=platform, faults=faults, seed=1, **plan)
        card.until(lambda: card.mission.state in ("done", "failed"), 200.0, "the mission ends")
        card.until(lambda: not card.autopilot.is_armed, within_s, "disarmed")
        assert -card.height_m < AFLOAT_M, card.story("not at the surface")
        assert max(map(abs, card.position_m[:2])) < FENCE_M, card.story("left the fence")
        return card

    yield fly
    card.close()
    assert not card.failures, card.failures


def test_a_crash_of_the_pose_costs_nothing_but_a_moment(dive: Dive) -> None:
    card = dive("auv", "crash:pose@30")
    assert card.mission.state == "done", card.story("a pose that comes back knows where it was")
    assert card.was_told("the position is uncertain by"), card.story("nobody says how well it knows its waypoints")


def test_after_seconds_without_its_cable_it_surfaces_and_is_found(dive: Dive) -> None:
    card = dive("auv", "cable_loss=1@30..33")
    assert card.was_told("pose lost: over"), card.story("its own reckoning gives the autopilot its position back")
    assert card.last("pose").is_valid


def test_a_process_that_restarts_at_depth_knows_where_it_is(dive: Dive) -> None:
    card = dive("auv", "restart@30..32")
    poses = [envelope.payload for envelope in card.received["pose"] if envelope.t_s > 34.0]
    assert all(pose.is_valid for pose in poses), card.story(poses[0].reason)
    assert not card.was_told("pose lost", since_s=32.0)


def test_a_lost_dvl_ends_at_the_surface(dive: Dive) -> None:
    dive("auv", "device:dvl=lost@20..")


def test_without_any_position_at_the_surface_it_is_disarmed_all_the_same(dive: Dive) -> None:
    dive("rov", "cable_loss=1@30..33", "sensor:fix=lost@20..", "crash:pose@31", "topic:pose=lost@31..", within_s=200.0)


def test_a_current_carries_it_on_at_the_surface_but_does_not_keep_it_armed(dive: Dive) -> None:
    card = dive("rov", current_m_s=0.2)
    assert card.mission.state == "done"
