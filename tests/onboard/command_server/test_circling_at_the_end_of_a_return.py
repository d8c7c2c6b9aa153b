"""A return that ends in a circle over home is told from one that is still on its way, and from one that comes down."""

from math import cos, sin, tau

import pytest

from gloc3.messages.vehicle import AutopilotState, FlightMode, Pose, VehicleClass, VtolForm
from gloc3_onboard.command_server.circling import CirclingWatch

PLANE = AutopilotState(is_connected=True, is_armed=True, mode=FlightMode.RETURN, vehicle=VehicleClass.PLANE)
TURN_S = 22.0


def pose(course_rad: float, height_m: float = 60.0) -> Pose:
    velocity = (23.0 * cos(course_rad), 23.0 * sin(course_rad), 0.0)
    return Pose(
        position_ned_m=(0.0, 0.0, -height_m),
        velocity_ned_m_s=velocity,
        ned_from_frd=(1.0, 0.0, 0.0, 0.0),
        is_valid=True,
    )


def circled(state: AutopilotState, turns: float, sink_m_s: float = 0.0, side: float = 1.0) -> bool:
    watch = CirclingWatch()
    for step in range(round(turns * TURN_S * 5.0)):
        t_s = 0.2 * step
        watch.update(state, pose(side * tau * t_s / TURN_S, 120.0 - sink_m_s * t_s))
    return watch.is_circling


def test_a_plane_that_circles_level_has_arrived() -> None:
    assert circled(PLANE, 3.5)
    assert circled(PLANE, 3.5, side=-1.0)
    assert not circled(PLANE, 2.5)


def test_a_plane_on_a_straight_way_home_has_not_arrived() -> None:
    watch = CirclingWatch()
    for _ in range(3000):
        watch.update(PLANE, pose(0.1))
    assert not watch.is_circling


def test_a_circle_that_comes_down_leads_to_a_landing() -> None:
    assert not circled(PLANE, 3.5, sink_m_s=1.0)


@pytest.mark.parametrize(
    "state",
    [
        AutopilotState(is_connected=True, is_armed=True, mode=FlightMode.LAND, vehicle=VehicleClass.PLANE),
        AutopilotState(is_connected=True, is_armed=True, mode=FlightMode.RETURN, vehicle=VehicleClass.COPTER),
        AutopilotState(
            is_connected=True, is_armed=True, mode=FlightMode.RETURN, vehicle=VehicleClass.VTOL, form=VtolForm.ROTORS
        ),
    ],
)  # fmt: skip
def test_what_does_not_return_on_wings_does_not_circle(state: AutopilotState) -> None:
    assert not circled(state, 5.0)


def test_a_vtol_on_wings_circles_as_a_plane_does() -> None:
    wings = AutopilotState(
        is_connected=True, is_armed=True, mode=FlightMode.RETURN, vehicle=VehicleClass.VTOL, form=VtolForm.WINGS
    )
    assert circled(wings, 3.5)


def test_without_a_pose_the_turns_are_counted_from_the_beginning() -> None:
    watch = CirclingWatch()
    for step in range(400):
        watch.update(PLANE, pose(tau * 0.2 * step / TURN_S))
    assert watch.is_circling
    watch.update(PLANE, None)
    assert not watch.is_circling
