"""A vehicle without cameras of ours flies by the estimator of another maker, and is not fooled by one that jumps."""

import pytest
from tests.flight.card import Card
from tests.flight.missions import mission
from tests.flight.test_flying_on_our_own_pose import errors_m

from gloc3.messages.envelope import Envelope
from gloc3.messages.perception import FusionState

BOXED = """\
platform: boxed
extends: hummingbird
capabilities: {record_images: null}
components:
  - {name: front_cameras, class: null}
  - {name: tracker_camera, class: null}
  - {name: ground_camera, class: null}
  - {name: ground_recorder, class: null}
  - {name: features, class: null}
  - {name: stereo_odometry, class: null}
  - {name: ground_odometry, class: null}
  - {name: optical_follower, class: null}
  - {name: estimator, class: "gloc3_onboard.components.samplers.estimator:EstimatorSampler", rate_hz: 30, devices: {device: estimator}, on_fault: {reinitialize: {times: 3}}}
  - {name: external_odometry, class: "gloc3_onboard.components.processors.external_odometry:ExternalOdometryProcessor", rate_hz: 1, trigger: estimator_pose, ports: {odometry: odometry/external}, settings: {max_m_s: 5.0}, on_fault: {reinitialize: {times: 3}}}
  - {name: pose, ports: {odometry: odometry/external, position_fix: []}}
  - {name: pose_standby, ports: {odometry: odometry/external, position_fix: []}}
"""
SWEEP = mission("{out: {follow_waypoints: {waypoints_m: [[4, 0, 1.5], [4, 2, 2]], speed_m_s: 0.5}}}")


@pytest.mark.parametrize("style", ["px4"], indirect=True)
def test_it_flies_a_mission_by_the_other_estimator_and_its_inertial_unit(flight: Card) -> None:
    flight.begin(SWEEP, platform=BOXED, faults=("device:estimator=step@9..",))
    flight.await_state("mission", "done", 60.0)
    reasons = {report.payload.reason for report in flight.received["odometry/external"] if not report.payload.is_valid}
    assert any("it has jumped by" in reason for reason in reasons)
    states: list[Envelope[FusionState]] = flight.received["fusion/primary"]
    used = {state.source for state in states[-1].payload.sources if state.is_used}
    assert used == {"imu", "height", "external"}
    found = errors_m(flight)
    assert len(found) > 300
    assert max(found) < 0.25
