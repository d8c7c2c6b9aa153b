"""Edits of a mission's places on the map: the text changes as an editor would change it."""

import pytest
from msgspec.structs import replace

from gloc3.documents.document import parse
from gloc3.errors import Refused
from gloc3.messages.motion import SiteSummary
from gloc3_groundstation.mapping.handles import Handle, HandleKind, MissionPlaces, places_of
from gloc3_groundstation.missions.place_edits import (
    EditHistory,
    added,
    default_height_m,
    moved,
    raised,
    removed,
    with_fence,
    with_survey,
)

LOCAL = """\
mission: cargo hold   # in the ship
frame: hold
geofence:
  polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]]  # the walls
tasks:
  depart: {actions: {climb: {take_off: {height_m: 1.5}}}}
  sweep:
    after: [depart]
    actions:
      wall:
        follow_waypoints:
          waypoints_m:
            - [2, 1, 2]    # near the door
            - [12, 1, 2]
          speed_m_s: 0.5
      area: {survey: {area_m: [[2, 2], [12, 2], [12, 8]], spacing_m: 3}, after: [wall]}
"""
GEO = """\
mission: field
frame: geo
tasks:
  fly:
    actions:
      up: {take_off: {height_m: 20}}
      there: {go_to: {position: [47.5, 8.5, 25]}, after: [up]}
      down: {land: {at: [47.5001, 8.5001]}, after: [there]}
"""
NEW = """\
mission: new mission
frame: hold
tasks:
  fly:
    actions:
      up: {take_off: {height_m: 2}}
      down: {land: {}, after: [up]}
"""
HOLD = SiteSummary(frame="hold", x_axis_bearing_deg=90.0, origin_geo=(47.0, 8.0, 400.0), home_m=(0.0, 0.0, 0.0))
EARTH = SiteSummary(frame="", x_axis_bearing_deg=0.0, origin_geo=(47.5, 8.5, 400.0), home_m=(0.0, 0.0, 0.0))


def places(text: str, site: SiteSummary | None = HOLD) -> MissionPlaces:
    found = places_of(text, text, site, None)
    assert found is not None
    return found


def labelled(found: MissionPlaces, label: str) -> Handle:
    return next(one for one in found.handles if one.label == label)


def difference(before: str, after: str) -> list[str]:
    return [line for line in after.splitlines() if line not in before.splitlines()]


def test_all_places_of_a_mission_are_found_where_they_are() -> None:
    found = places(LOCAL)
    assert [one.label for one in found.handles] == [
        "waypoint 1 of sweep.wall",
        "waypoint 2 of sweep.wall",
        "corner 1 of sweep.area",
        "corner 2 of sweep.area",
        "corner 3 of sweep.area",
        "fence corner 1 of the fence",
        "fence corner 2 of the fence",
        "fence corner 3 of the fence",
        "fence corner 4 of the fence",
    ]
    second = labelled(found, "waypoint 2 of sweep.wall")
    assert second.position_ne_m == pytest.approx((1.0, 12.0), abs=1e-6)  # x points east, and y north
    assert (second.height_m, second.siblings) == (2.0, 2)
    assert [one.label for one in places(GEO, EARTH).handles] == ["waypoint of fly.there", "place of fly.down"]


def test_a_place_is_moved_and_the_comments_stay() -> None:
    found = places(LOCAL)
    text = moved(LOCAL, found, labelled(found, "waypoint 1 of sweep.wall"), (3.456, 4.0))
    assert difference(LOCAL, text) == ["            - [4, 3.46, 2]    # near the door"]
    text = moved(LOCAL, found, labelled(found, "fence corner 3 of the fence"), (12.0, 25.0))
    assert difference(LOCAL, text) == ["  polygon_m: [[-2, -2], [20, -2], [25, 12], [-2, 12]]  # the walls"]


def test_a_place_on_earth_is_moved_to_a_centimetre() -> None:
    found = places(GEO, EARTH)
    text = moved(GEO, found, labelled(found, "waypoint of fly.there"), (11.12, 0.0))
    again = labelled(places(text, EARTH), "waypoint of fly.there")
    assert again.position_ne_m == pytest.approx((11.12, 0.0), abs=0.02)
    assert again.height_m == 25.0


def test_a_height_is_changed_alone() -> None:
    found = places(LOCAL)
    text = raised(LOCAL, labelled(found, "waypoint 2 of sweep.wall"), 3.5)
    assert difference(LOCAL, text) == ["            - [12, 1, 3.5]"]
    with pytest.raises(Refused, match="has no height of its own"):
        raised(LOCAL, labelled(found, "corner 1 of sweep.area"), 3.5)


def test_places_are_added_after_the_chosen_one() -> None:
    found = places(LOCAL)
    first = labelled(found, "waypoint 1 of sweep.wall")
    text, where = added(LOCAL, found, first, (1.0, 7.0), 2.5)
    assert difference(LOCAL, text) == ["            - [7, 1, 2.5]"]
    chosen = places(text).find(where)
    assert chosen is not None
    assert chosen.label == "waypoint 2 of sweep.wall"
    corner = labelled(found, "fence corner 4 of the fence")
    text, _ = added(LOCAL, found, corner, (5.0, -6.0), 9.0)
    assert difference(LOCAL, text) == ["  polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12], [-6, 5]]  # the walls"]
    text, _ = added(LOCAL, found, None, (1.0, 15.0), 2.0)
    assert difference(LOCAL, text) == ["            - [15, 1, 2]"]


def test_the_first_waypoint_of_a_mission_is_an_action_between_departure_and_landing() -> None:
    found = places(NEW)
    height_m = default_height_m(NEW, found, None)
    text, where = added(NEW, found, None, (4.0, 3.0), height_m)
    assert difference(NEW, text) == [
        "      way: {follow_waypoints: {waypoints_m: [[3, 4, 2]]}, after: [up]}",
        "      down: {land: {}, after: [way]}",
    ]
    assert places(text).find(where) is not None


def test_a_place_that_is_needed_is_not_left_out() -> None:
    found = places(LOCAL)
    text = removed(LOCAL, labelled(found, "waypoint 1 of sweep.wall"))
    assert "near the door" not in text
    (only,) = [one for one in places(text).handles if one.kind is HandleKind.WAYPOINT]
    with pytest.raises(Refused, match=r"waypoint 1 of sweep\.wall cannot be removed: 1 are needed"):
        removed(text, only)
    with pytest.raises(Refused, match=r"corner 2 of sweep\.area cannot be removed: 3 are needed"):
        removed(LOCAL, labelled(found, "corner 2 of sweep.area"))
    with pytest.raises(Refused, match="remove its action in the text"):
        removed(GEO, labelled(places(GEO, EARTH), "waypoint of fly.there"))


def test_a_drawn_area_becomes_a_survey_and_a_fence() -> None:
    found = places(NEW)
    corners = [(0.0, 0.0), (0.0, 20.0), (10.0, 20.0)]
    text, where = with_survey(NEW, found, corners, 4.0, 3.0)
    assert difference(NEW, text)[0] == (
        "      survey: {survey: {area_m: [[0, 0], [20, 0], [20, 10]], spacing_m: 4, height_m: 3}, after: [up]}"
    )
    assert parse(text, "t").value["tasks"]["fly"]["actions"]["down"]["after"] == ["survey"]
    assert where[-1] == "area_m"
    text = with_fence(NEW, found, corners)
    assert difference(NEW, text) == ["geofence: {polygon_m: [[0, 0], [20, 0], [20, 10]]}"]
    with pytest.raises(Refused, match="the mission has a fence"):
        with_fence(text, places(text), corners)
    ceiling = NEW.replace("tasks:", "geofence: {ceiling_m: 9}\ntasks:")
    assert "geofence: {ceiling_m: 9, polygon_m: [[0, 0]" in with_fence(ceiling, places(ceiling), corners)


def test_the_nearest_place_within_reach_is_picked() -> None:
    found = places(LOCAL)
    near = found.nearest((1.2, 11.5), 1.0)
    assert near is not None
    assert near.label == "waypoint 2 of sweep.wall"
    assert found.nearest((50.0, 50.0), 1.0) is None


def test_a_mission_of_another_frame_or_that_is_no_yaml_is_not_on_the_map() -> None:
    assert places_of(LOCAL, LOCAL, replace(HOLD, frame="yard"), None) is None
    assert places_of("mission: [", "mission: [", HOLD, None) is None


def test_the_steps_of_undo_and_redo() -> None:
    history = EditHistory[str]()
    assert history.undo("a") is None
    history.changed("a")
    history.changed("b")
    assert history.undo("c") == "b"
    assert history.undo("b") == "a"
    assert history.redo("a") == "b"
    history.changed("b")
    assert history.redo("d") is None
    assert history.undo("d") == "b"
