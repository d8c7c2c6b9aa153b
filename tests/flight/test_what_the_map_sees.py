"""A flight as the map and the charts of a station see it, over the modelled radio."""

import numpy as np
import pytest
from tests.flight.card import ONE_STYLE, Card

from gloc3.messages.summaries import VehicleSummary
from gloc3_groundstation.mapping.requested import requested
from gloc3_groundstation.mapping.tracks import TrackChannel, Tracks
from gloc3_groundstation.missions.plans import MissionTexts
from gloc3_groundstation.station.snapshots import STALE_AFTER_S, PlatformSnapshot

MISSION = """mission: corner
frame: hold
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}
on_failure: land
on_link_loss: continue
tasks:
  depart: {actions: {climb: {take_off: {height_m: 1.5}}}}
  sweep:
    after: [depart]
    actions:
      out: {follow_waypoints: {waypoints_m: [[0, 0, 2], [5, 0, 2], [5, 4, 2]], speed_m_s: 1.0}}
  recover: {after: [sweep], actions: {down: {land: {}}}}
"""


def received(flight: Card) -> PlatformSnapshot:
    found = flight.flight.station.fleet.get(flight.flight.name)
    assert found is not None
    return found


@ONE_STYLE
def test_the_station_sees_path_setpoint_attitude_home_and_mission_of_a_flight(flight: Card) -> None:
    flight.begin(MISSION)
    tracks, station = Tracks(), flight.flight.station
    station.listen(tracks.follow)
    begun_s = flight.now_s
    flight.await_state("mission", "done", 60.0)
    platform, track = received(flight), tracks.get(flight.flight.name)
    assert track is not None
    assert platform.site is not None
    assert platform.site.value.frame == "hold"
    assert platform.site.value.home_m == pytest.approx((0.0, 0.0, 0.0), abs=0.2)
    samples = track.history.samples
    assert len(samples) / (flight.now_s - begun_s) >= 1.8, "twice a second, but for what a radio may lose"
    assert np.nanmax(np.diff(samples.times_s)) < STALE_AFTER_S[VehicleSummary]
    flown = samples.rows
    off_m = np.abs(flown[:, TrackChannel.X] - flown[:, TrackChannel.WANTED_X])
    assert np.isfinite(off_m).sum() > 20
    assert np.nanmax(off_m) < 1.5
    assert np.nanmax(np.abs(flown[:, TrackChannel.PITCH])) > 1.0
    assert np.nanmin(flown[:, TrackChannel.BATTERY_V]) > 5.0
    texts = MissionTexts(station)
    assert texts.missing(platform, flight.now_s)
    flight.run(texts.fetch(platform))
    text, is_loaded = texts.text_of(platform, None)
    assert is_loaded
    request = requested(text, platform.site.value)
    assert request is not None
    for waypoint in request.waypoints:
        north, east, _ = waypoint.position_ned_m
        away = np.hypot(flown[:, TrackChannel.X] - north, -flown[:, TrackChannel.Y] - east)
        assert np.nanmin(away) < 0.5
