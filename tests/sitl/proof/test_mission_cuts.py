"""Shorter missions: what they lack, and that they are still missions."""

from typing import Any

import yaml

from gloc3.mission.examples import find_mission
from gloc3_sitl.proof.mission_cuts import shorter

TWO = """
mission: two
frame: hold
tasks:
  first:
    actions:
      up: {take_off: {height_m: 1.5}}
      way: {follow_waypoints: {waypoints_m: [[1, 1, 2], [2, 1, 2], [3, 1, 2], [4, 1, 2]]}, after: [up]}
      photos: {record_images: {camera: front}, until: way, after: [up]}
  second:
    after: [first]
    actions:
      stay: {hold: {duration_s: 60}}
"""


def cuts() -> list[dict[str, Any]]:
    return [yaml.safe_load(text) for text in shorter(TWO)]


def test_a_task_is_left_out_and_what_came_after_it_comes_after_what_it_came_after() -> None:
    without_second, without_first = cuts()[:2]
    assert list(without_second["tasks"]) == ["first"]
    assert without_first["tasks"]["second"]["after"] == []


def test_an_action_is_left_out_with_what_refers_to_it() -> None:
    firsts = [one["tasks"]["first"]["actions"] for one in cuts() if "first" in one["tasks"]]
    without_way = next(one for one in firsts if "way" not in one)
    assert "until" not in without_way["photos"]
    without_up = next(one for one in firsts if "up" not in one)
    assert without_up["way"]["after"] == []


def test_ways_lose_waypoints_and_times_get_shorter() -> None:
    ways = [
        len(one["tasks"]["first"]["actions"]["way"]["follow_waypoints"]["waypoints_m"])
        for one in cuts()
        if "way" in one["tasks"].get("first", {"actions": {}})["actions"]
    ]
    assert {2, 3} <= set(ways)
    holds = [
        one["tasks"]["second"]["actions"]["stay"]["hold"]["duration_s"] for one in cuts() if "second" in one["tasks"]
    ]
    assert min(holds) == 2.0


def test_a_mission_that_includes_others_is_left_alone() -> None:
    assert not list(shorter("include: [library.yaml]\n" + TWO))


def test_the_smallest_mission_has_no_shorter_one_without_end() -> None:
    text = find_mission("hop").read_text(encoding="utf-8")
    steps = 0
    while (cut := next(shorter(text), None)) is not None:
        text, steps = cut, steps + 1
    assert 0 < steps < 20


def test_names_that_yaml_takes_for_yes_and_no_stay_names() -> None:
    texts = list(shorter(TWO.replace("up:", "off:").replace("[up]", "[off]")))
    assert texts
    assert all("false" not in text for text in texts)
