"""The components of a plane: its ways are plans that end in a circle, and it waits in circles of its autopilot's."""

from typing import Any

import pytest
from msgspec.structs import replace
from tests.onboard.components.drivers.winged import Plans, see
from tests.onboard.messages import grant
from tests.onboard.stage import Stage

from gloc3.errors import Refused
from gloc3.messages.vehicle import (
    AutopilotState,
    FlightMode,
    LandedState,
    Manoeuvre,
    ManoeuvreKind,
    Style,
)
from gloc3_onboard.autopilot.plan_upload import path_items
from gloc3_onboard.components.controllers.circle import CircleController
from gloc3_onboard.components.drivers.winged_flier import WingedPlanSettings
from gloc3_onboard.components.drivers.winged_plan import WingedPlan
from gloc3_onboard.sensors.devices import GeoPath

FLYING = AutopilotState(
    is_connected=True, is_armed=True, is_armable=True, landed=LandedState.IN_AIR, mode=FlightMode.MISSION
)
STANDING = replace(FLYING, is_armed=False, landed=LandedState.ON_GROUND, mode=FlightMode.MANUAL)


def stage(state: AutopilotState, height_m: float = 60.0) -> tuple[Stage, Plans]:
    plans = Plans()
    found = Stage(WingedPlan(plans), WingedPlanSettings(arm=True))
    see(found, state, height_m)
    return found, plans


def commands(way: GeoPath) -> list[int]:
    return [item.command for item in path_items(way, Style.ARDUPILOT)][1:]


def test_a_take_off_is_a_plan_that_arms_and_ends_in_a_circle_over_home() -> None:
    found, plans = stage(STANDING, 0.0)
    found.begin("take_off", height_m=50.0)
    for _ in range(3):
        see(found, STANDING, 0.0)
    assert commands(plans.routes[0]) == [178, 22, 17]
    assert plans.routes[0].places[0].altitude_m == pytest.approx(550.0)
    requested = found.last(Manoeuvre)
    assert (requested.kind, requested.may_arm) == (ManoeuvreKind.PLAN, True)
    plans.places_reached = 1
    see(found, FLYING, 50.0)
    assert found.status.state == "done"


def test_ways_are_lines_that_are_passed_waits_are_circles_and_none_of_them_arms() -> None:
    found, plans = stage(FLYING)
    found.begin("follow_waypoints", waypoints_ned_m=((500.0, 0.0, -60.0), (500.0, 400.0, -60.0)), speed_m_s=23.0)
    for _ in range(3):
        see(found, FLYING)
    (way,) = plans.routes
    assert commands(way) == [178, 16, 16, 17]
    assert way.acceptance_m == 30.0
    assert not found.last(Manoeuvre).may_arm
    assert commands(way._replace(hold_s=20.0)) == [178, 19, 19, 17]


@pytest.mark.parametrize(
    ("state", "capability", "arguments", "why"),
    [
        (FLYING, "take_off", {"height_m": 50.0}, "in the air already"),
        (STANDING, "take_off", {"height_m": 5.0}, "too low to circle at"),
        (replace(STANDING, is_armable=False, reasons=("no fix",)), "take_off", {"height_m": 50.0}, "no fix"),
        (
            FLYING,
            "go_to",
            {"waypoints_ned_m": ((500.0, 0.0, -60.0),), "speed_m_s": 23.0, "wall_distance_m": 2.0},
            "cannot keep a distance from a wall",
        ),
        (
            FLYING,
            "go_to",
            {"waypoints_ned_m": ((500.0, 0.0, -60.0),), "speed_m_s": 23.0, "heading": {"mode": "fixed"}},
            "points where it flies",
        ),
    ],
)
def test_what_a_plane_cannot_do_is_refused_with_the_reason(
    state: AutopilotState, capability: str, arguments: dict[str, Any], why: str
) -> None:
    found, _ = stage(state)
    with pytest.raises(Refused, match=why):
        found.begin(capability, **arguments)


def test_it_waits_by_asking_for_circles_until_the_autopilot_flies_them_and_asks_for_nothing_on_the_ground() -> None:
    found = Stage(CircleController())
    found.step(grant=grant("hold", "circle"), autopilot=STANDING)
    assert not found.all(Manoeuvre)
    for _ in range(50):
        found.step(grant=grant("hold", "circle"), autopilot=FLYING)
    assert [requested.kind for requested in found.all(Manoeuvre)] == [ManoeuvreKind.HOLD] * 2
    found.step(2.0, grant=grant("hold", "circle"), autopilot=replace(FLYING, mode=FlightMode.HOLD))
    found.step(2.0, grant=grant("way", "ways"), autopilot=FLYING)
    assert len(found.all(Manoeuvre)) == 2


def test_the_action_hold_ends_with_its_time() -> None:
    found = Stage(CircleController())
    found.begin("hold", "wait", duration_s=4.0)
    for _ in range(79):
        found.step(grant=grant("wait", "circle"), autopilot=FLYING)
    assert found.status.state == "running"
    found.step(0.1, grant=grant("wait", "circle"), autopilot=FLYING)
    assert found.status.state == "done"
