"""A platform to check missions against, and to fly them on."""

import pytest

from gloc3.platform.platform import Platform
from gloc3.platform.reader import read_platform

PELICAN = """\
platform: pelican
vehicle: {type: quadrotor, mass_kg: 1.65}
arm: true
frames: {hold: {origin: {geo: [39.5, 2.6, 5.0]}}}
limits: {speed_m_s: 3.0, climb_m_s: 1.0, acceleration_m_s2: 2.5, height_max_m: 10}
power: {hover_w: 165, per_m_s_w: 6, climb_w_per_m_s: 25, avionics_w: 12, battery_wh: 71, reserve: 0.25}
failsafes: {low_battery: {action: return, at: 0.2}}
capabilities:
  take_off: {arguments: take_off, performed_by: flight, claims: [motion], needs: [pose, autopilot]}
  land: {arguments: land, performed_by: flight, claims: [motion], needs: [autopilot]}
  hold: {arguments: hold, performed_by: flight, claims: [motion], needs: [autopilot]}
  return_home: {arguments: return_home, performed_by: waypoints, claims: [motion], needs: [pose, autopilot]}
  go_to: {arguments: go_to, performed_by: waypoints, claims: [motion], needs: [pose, autopilot]}
  follow_waypoints: {arguments: follow_waypoints, performed_by: waypoints, claims: [motion], needs: [pose, autopilot]}
  record_images:
    {arguments: record_images, performed_by: images, claims: [camera], needs: [pose], options: {camera: [ground]}}
components:
  - {name: pose, class: "nowhere:Pose", rate_hz: 20}
  - {name: autopilot, class: "nowhere:Autopilot", rate_hz: 20}
  - {name: flight, class: "nowhere:Flight", rate_hz: 20}
  - {name: waypoints, class: "nowhere:Waypoints", rate_hz: 20}
  - {name: images, class: "nowhere:Images", rate_hz: 5}
"""


@pytest.fixture(scope="session")
def platform_text() -> str:
    """The platform file."""
    return PELICAN


@pytest.fixture(scope="session")
def pelican() -> Platform:
    """A quadrotor with a ground camera."""
    return read_platform(PELICAN, "pelican.yaml")
