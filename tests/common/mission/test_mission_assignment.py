"""Tasks that several platforms may perform: who gets which, by capability, place and budget, and what the file says of it."""

from itertools import pairwise, permutations, product

import pytest
from msgspec.structs import replace

from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.mission.assigning.assignment import AvailableVehicle, TaskAssignment, assign, with_assigned
from gloc3.mission.assigning.search import ShareCost, Shares, divide
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.platform.platform import Platform

ORIGIN = GeoPoint(39.5, 2.6, 5.0)
TEXT = """\
mission: three places
frame: hold
on_failure: return
on_low_battery: land
tasks:
  up: {platform: each, actions: {go: {take_off: {height_m: 3}}}}
  south: {platform: any, after: [up], actions: {go: {follow_waypoints: {waypoints_m: [[-40, 0, 3], [-60, 0, 3]]}}}}
  north: {platform: any, after: [up], actions: {go: {follow_waypoints: {waypoints_m: [[40, 0, 3], [60, 0, 3]]}}}}
  shots:
    platform: [pelican, heron]
    after: [up]
    actions:
      go: {follow_waypoints: {waypoints_m: [[50, 5, 3], [50, 9, 3]]}}
      pictures: {record_images: {camera: ground, every_m: 1}, until: go}
  down: {platform: each, after: [south, north, shots], actions: {home: {return_home: {}}, end: {land: {}, after: [home]}}}
"""


def at(north_m: float, east_m: float = 0.0) -> GeoPoint:
    return TangentPlane(ORIGIN).geo_from_ned((north_m, east_m, 0.0))


def vehicle(
    pelican: Platform, name: str, north_m: float = 0.0, *, has_camera: bool = True, battery: float = 1.0
) -> AvailableVehicle:
    capabilities = {key: row for key, row in pelican.capabilities.items() if has_camera or key != "record_images"}
    platform = replace(pelican, platform=name, capabilities=capabilities)
    return AvailableVehicle(platform=platform, home=at(north_m), battery=battery)


def errors(assignment: TaskAssignment) -> list[str]:
    return [one.message for one in assignment.report.findings if not one.is_warning]


def given(text: str, *vehicles: AvailableVehicle) -> TaskAssignment:
    return assign(text, "places.yaml", vehicles, Circumstances(origin=ORIGIN))


def test_each_place_goes_to_the_vehicle_that_is_there(pelican: Platform) -> None:
    found = given(TEXT, vehicle(pelican, "pelican", -50.0), vehicle(pelican, "heron", 50.0))
    assert found.assigned == {"pelican": ("south",), "heron": ("shots", "north")}
    assert found.is_ok, found.report.findings
    assert set(found.reports) == {"pelican", "heron"}
    turned = given(TEXT, vehicle(pelican, "pelican", 50.0), vehicle(pelican, "heron", -50.0))
    assert set(turned.assigned["pelican"]) == {"north", "shots"}


def test_what_needs_a_camera_goes_to_the_vehicle_that_has_one(pelican: Platform) -> None:
    found = given(TEXT, vehicle(pelican, "pelican", -50.0), vehicle(pelican, "heron", 50.0, has_camera=False))
    assert "shots" in found.assigned["pelican"]
    assert found.is_ok


def test_a_task_that_none_can_perform_is_an_error_with_each_one_s_reason(pelican: Platform) -> None:
    found = given(TEXT, vehicle(pelican, "heron", has_camera=False))
    assert any(
        "no vehicle can perform shots (heron: unknown capability 'record_images'" in one for one in errors(found)
    )


def test_a_vehicle_with_little_charge_gets_less(pelican: Platform) -> None:
    full = given(TEXT, vehicle(pelican, "pelican", -50.0), vehicle(pelican, "heron", 50.0))
    assert len(full.assigned["heron"]) == 2
    low = given(TEXT, vehicle(pelican, "pelican", -50.0), vehicle(pelican, "heron", 50.0, battery=0.28))
    assert len(low.assigned.get("heron", ())) < 2
    assert low.is_ok, low.report.findings
    none = given(TEXT, vehicle(pelican, "heron", 50.0, battery=0.3))
    assert any("heron needs about" in one and "(30 % charge)" in one for one in errors(none))


def test_the_division_is_the_best_of_all_that_there_are() -> None:
    """Of small missions along a line; cost is the way from task to task, from each vehicle's place."""
    places = {"a": -3.0, "b": 4.0, "c": 11.0, "d": -8.0, "e": 1.5}
    homes = {"v": -5.0, "w": 2.0, "x": 9.0}

    def cost(name: str, tasks: tuple[str, ...]) -> ShareCost:
        way = [homes[name], *(places[one] for one in tasks), *([homes[name]] if tasks else [])]
        return ShareCost(0.0, sum(abs(b - a) for a, b in pairwise(way)))

    def last_s(shares: Shares) -> float:
        return max(cost(name, tasks).duration_s for name, tasks in shares.items())

    found = divide({one: list(homes) for one in places}, list(homes), cost, lambda _: True)
    assert sorted(one for tasks in found.values() for one in tasks) == sorted(places)
    best = min(
        last_s({name: tuple(one for one in order if whose[one] == name) for name in homes})
        for order in permutations(places)
        for whose in (dict(zip(places, names, strict=True)) for names in product(homes, repeat=len(places)))
    )
    assert last_s(found) == pytest.approx(best)


def test_the_order_between_tasks_of_different_vehicles_is_kept(pelican: Platform) -> None:
    text = TEXT.replace("north: {platform: any, after: [up]", "north: {platform: any, after: [up, shots]").replace(
        "shots:\n    platform: [pelican, heron]\n    after: [up]",
        "shots:\n    platform: [pelican, heron]\n    after: [up, south]",
    )
    found = given(text, vehicle(pelican, "pelican", -50.0), vehicle(pelican, "heron", 50.0))
    assert found.is_ok, found.report.findings
    for tasks in found.assigned.values():
        assert list(tasks) == sorted(tasks, key=["south", "shots", "north"].index)


def test_the_same_again_is_the_same(pelican: Platform) -> None:
    vehicles = vehicle(pelican, "pelican", -50.0), vehicle(pelican, "heron", 50.0)
    first = given(TEXT, *vehicles)
    assert given(TEXT, *vehicles).text == first.text
    assert given(first.text, *vehicles).text == first.text, "an assignment that is there is replaced"


def test_each_vehicle_does_its_own_part_and_waits_for_no_other_s(pelican: Platform) -> None:
    text = given(TEXT, vehicle(pelican, "pelican", -50.0), vehicle(pelican, "heron", 50.0)).text
    around = Circumstances(platform=replace(pelican, platform="heron"), origin=ORIGIN)
    mission = check_text(text, "places.yaml", around).flyable()
    own = {name: task.options.after for name, task in mission.tasks.items() if not task.is_elsewhere}
    assert own == {"up": (), "north": ("up", "shots"), "shots": ("up",), "down": ("north", "shots")}


def test_without_an_assignment_no_vehicle_takes_it(pelican: Platform) -> None:
    report = check_text(TEXT, "places.yaml", Circumstances(platform=pelican))
    assert [one.message for one in report.findings if not one.is_warning] == [
        f"no platform is chosen for {task}" for task in ("south", "north", "shots")
    ]
    assert check_text(TEXT, "places.yaml", Circumstances(platform=pelican, is_assigned_later=True)).is_ok


@pytest.mark.parametrize(
    ("assigned", "expected"),
    [
        ({"pelican": ["nroth"]}, "no task 'nroth' here"),
        ({"pelican": ["south"], "heron": ["south"]}, "south is assigned to pelican already"),
        ({"gannet": ["shots"]}, "shots is not for gannet"),
    ],
)
def test_an_assignment_that_cannot_be_is_an_error_with_its_place(
    pelican: Platform, assigned: dict[str, list[str]], expected: str
) -> None:
    report = check_text(with_assigned(TEXT, assigned), "places.yaml", Circumstances(platform=pelican))
    found = next(one for one in report.findings if one.message == expected)
    assert found.line == TEXT.count("\n") + 1


def test_what_a_vehicle_has_begun_stays_its_own_and_what_it_returns_from_does_not_wait(pelican: Platform) -> None:
    heron = vehicle(pelican, "heron", 50.0)
    pelican_there = vehicle(pelican, "pelican", -50.0)
    flying = AvailableVehicle(
        platform=heron.platform, home=heron.home, place=at(55.0), battery=0.8, begun=("up", "north"), running=("north",)
    )
    ended = {"gannet": ("south",)}
    found = assign(TEXT, "places.yaml", [flying, pelican_there], Circumstances(origin=ORIGIN), ended)
    assert found.assigned["heron"] == ("north", "shots")
    assert "gannet: [south]" in found.text
    assert found.is_ok, found.report.findings
    returning = AvailableVehicle(
        platform=heron.platform, home=heron.home, place=at(55.0), begun=("up", "north", "down"), running=("down",)
    )
    found = assign(TEXT, "places.yaml", [returning, pelican_there], Circumstances(origin=ORIGIN), ended)
    assert found.assigned["pelican"] == ("shots",)
