"""The ways of a VTOL are plans: take-offs on rotors, long ways on wings that end in a hover, short ones on rotors."""

from collections.abc import Sequence
from typing import Any

import pytest
from msgspec.structs import replace
from tests.onboard.components.drivers.winged import Plans, see
from tests.onboard.stage import Stage

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import (
    AutopilotState,
    DriverState,
    FlightMode,
    LandedState,
    Manoeuvre,
    ManoeuvreKind,
    ManoeuvreState,
    Style,
    VtolForm,
)
from gloc3_onboard.autopilot.plan_upload import path_items
from gloc3_onboard.components.drivers.vtol_plan import VtolPlan, VtolPlanSettings
from gloc3_onboard.sensors.devices import GeoPath

HOVERING = AutopilotState(
    is_connected=True,
    is_armed=True,
    is_armable=True,
    landed=LandedState.IN_AIR,
    mode=FlightMode.HOLD,
    form=VtolForm.ROTORS,
)
STANDING = replace(HOVERING, is_armed=False, landed=LandedState.ON_GROUND)
SPEED, TAKE_OFF, VTOL_TAKE_OFF, TRANSITION, WAYPOINT, STAY = 178, 22, 84, 3000, 16, 17
TO_ROTORS, TO_WINGS = 3.0, 4.0
FAR: Sequence[Vector3] = ((500.0, 0.0, -60.0), (500.0, 400.0, -60.0))


def stage(state: AutopilotState, height_m: float = 60.0) -> tuple[Stage, Plans]:
    plans = Plans()
    found = Stage(VtolPlan(plans), VtolPlanSettings(arm=True, take_off_min_m=2.0, transition_m=120.0))
    see(found, state, height_m)
    return found, plans


def plan(way: GeoPath, style: Style) -> list[tuple[int, float]]:
    """Commands, and what each is told first."""
    return [(item.command, item.param1) for item in path_items(way, style)][style is Style.ARDUPILOT :]


def flown(capability: str, **arguments: Any) -> GeoPath:
    found, plans = stage(HOVERING)
    found.begin(capability, **arguments)
    for _ in range(3):
        see(found, HOVERING)
    return plans.routes[0]


def test_a_take_off_is_on_rotors_and_ends_in_a_hover() -> None:
    found, plans = stage(STANDING, 0.0)
    found.begin("take_off", height_m=30.0)
    for _ in range(3):
        see(found, STANDING, 0.0)
    (way,) = plans.routes
    assert plan(way, Style.PX4) == [(TAKE_OFF, 0.0), (STAY, 0.0)]
    ardupilot = path_items(way, Style.ARDUPILOT)
    assert plan(way, Style.ARDUPILOT) == [(TRANSITION, TO_ROTORS), (VTOL_TAKE_OFF, 0.0), (STAY, 0.0)]
    assert (ardupilot[2].frame, ardupilot[2].z) == (3, 30.0)  # its height counts from where it stands
    requested = found.last(Manoeuvre)
    assert (requested.kind, requested.may_arm) == (ManoeuvreKind.PLAN, True)


@pytest.mark.parametrize("style", list(Style))
def test_a_long_way_is_flown_on_wings_and_ends_in_a_hover_at_its_last_place(style: Style) -> None:
    way = flown("follow_waypoints", waypoints_ned_m=FAR, speed_m_s=25.0)
    assert plan(way, style) == [
        (TRANSITION, TO_WINGS),
        (SPEED, 0.0),
        (WAYPOINT, 0.0),
        (WAYPOINT, 0.0),
        (TRANSITION, TO_ROTORS),
        (WAYPOINT, 0.0),
        (STAY, 0.0),
    ]
    braking, last = path_items(way, style)[-4], path_items(way, style)[-2]
    off_m = (last.y - braking.y) * 1e-7 * 111_320.0 * 0.682
    assert off_m == pytest.approx(120.0, abs=1.0)
    assert braking.x == pytest.approx(last.x, abs=20)
    assert last.param2 == 2.0


def test_a_short_way_and_one_by_rotors_are_flown_on_rotors_no_faster_than_those() -> None:
    for arguments in (
        {"waypoints_ned_m": ((80.0, 0.0, -60.0),)},
        {"waypoints_ned_m": FAR, "by": "rotors"},
    ):
        way = flown("follow_waypoints", speed_m_s=25.0, **arguments)
        assert plan(way, Style.PX4)[0] == (TRANSITION, TO_ROTORS)
        assert TRANSITION not in [command for command, _ in plan(way, Style.PX4)[1:]]
        assert way.speed_m_s == 5.0
        assert way.acceptance_m == 2.0


def test_a_transition_to_wings_ends_in_a_circle_and_one_to_rotors_in_a_hover() -> None:
    assert plan(flown("transition", to="wings"), Style.PX4) == [
        (TRANSITION, TO_WINGS),
        (SPEED, 0.0),
        (WAYPOINT, 0.0),
        (STAY, 0.0),
    ]
    assert plan(flown("transition", to="rotors"), Style.PX4) == [
        (TRANSITION, TO_ROTORS),
        (SPEED, 1.0),
        (WAYPOINT, 0.0),
        (STAY, 0.0),
    ]
    found, _ = stage(STANDING, 0.0)
    with pytest.raises(Refused, match="take off first"):
        found.begin("transition", to="wings")


def test_places_that_it_is_at_already_are_left_out_on_wings() -> None:
    way = flown("follow_waypoints", waypoints_ned_m=((0.0, 0.0, -60.0), *FAR), speed_m_s=25.0)
    assert len(way.places) == 2


def test_a_way_whose_transition_fails_fails_with_the_reason() -> None:
    found, _ = stage(HOVERING)
    found.begin("follow_waypoints", "way", waypoints_ned_m=FAR, speed_m_s=25.0)
    running = DriverState(
        action_id="way",
        manoeuvre_id="way",
        manoeuvre=ManoeuvreKind.PLAN,
        manoeuvre_state=ManoeuvreState.RUNNING,
    )
    mission = replace(HOVERING, mode=FlightMode.MISSION)
    for form in (
        VtolForm.ROTORS,
        VtolForm.ROTORS,
        VtolForm.ROTORS,
        VtolForm.TO_WINGS,
        VtolForm.ROTORS,
    ):  # an ArduPlane that begins to hover in GUIDED says so for a moment
        see(found, replace(HOVERING, form=form))
    assert found.status.state == "running"
    for _ in range(4):
        see(found, mission, driver=running)
    see(found, replace(mission, form=VtolForm.TO_WINGS), driver=running)
    assert found.status.state == "running"
    see(found, mission, driver=running)
    assert found.status.state == "failed"
    assert "transition to wings failed" in found.status.reason
