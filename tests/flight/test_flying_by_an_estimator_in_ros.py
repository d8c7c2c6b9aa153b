"""A vehicle without cameras of ours flies by the odometry of a node of ROS 2, over a real Zenoh session."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.flight.card import Card
from tests.flight.ros_estimator import EstimatorInRos, estimator_in_ros
from tests.flight.test_flying_by_an_external_estimator import BOXED, SWEEP
from tests.flight.test_flying_on_our_own_pose import errors_m

from gloc3.messages.envelope import Envelope
from gloc3.messages.perception import FusionState

pytestmark = pytest.mark.sockets


@pytest.fixture
def estimators(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[EstimatorInRos]]:
    with estimator_in_ros(tmp_path / "definitions", monkeypatch) as made:
        yield made


@pytest.mark.parametrize("style", ["px4"], indirect=True)
def test_it_flies_a_mission_by_odometry_that_comes_over_the_wire(
    estimators: list[EstimatorInRos], flight: Card
) -> None:
    flight.begin(SWEEP, platform=BOXED)
    flight.await_state("mission", "done", 60.0)
    (estimator,) = estimators
    assert estimator.count > 600
    states: list[Envelope[FusionState]] = flight.received["fusion/primary"]
    used = {state.source for state in states[-1].payload.sources if state.is_used}
    assert used == {"imu", "height", "external"}
    found = errors_m(flight)
    assert len(found) > 300
    assert max(found) < 0.25
