"""A quadplane under PX4 and under ArduPilot: it hovers, goes over to its wings and back, flies missions, and fails safely."""

from functools import partial
from math import dist, hypot
from typing import Any

import pytest

from gloc3.mavlink.services.plan import PlanItem, PlanResult
from gloc3_sitl.autopilot.control.vtol_form import VtolForm
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.physics.wind import gusty

from .bench import ARM, LAND, Bench

TRANSITION, VTOL_TAKE_OFF, VTOL_LAND, HOVER = 3000, 84, 85, 17
TO_ROTORS, TO_WINGS = 3.0, 4.0
STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])
ON_WINGS = {"px4": "Hold", "ardupilot": "LOITER"}
ON_ROTORS = {"px4": "Hold", "ardupilot": "GUIDED"}
MISSION = {"px4": "Mission", "ardupilot": "AUTO"}


def flying(style: str, height_m: float = 30.0, **settings: Any) -> Bench:
    bench = Bench(style, vehicle="quadplane", **settings)
    if style == "px4":
        bench.get_ready()
    bench.take_off(height_m)
    return bench


def form(bench: Bench) -> VtolForm:
    return VtolForm(bench.autopilot.craft.vtol.form)


def height_m(bench: Bench) -> float:
    return -bench.position[2]


def is_near(bench: Bench, place: tuple[float, float]) -> bool:
    return dist(bench.position[:2], place) < 60.0


def speed_m_s(bench: Bench) -> float:
    return hypot(*bench.sim.truth().velocity_ned_m_s)


def to_wings(bench: Bench) -> None:
    if bench.is_px4:
        assert bench.command(TRANSITION, TO_WINGS) is Result.ACCEPTED
    else:
        assert bench.set_mode("LOITER") is Result.ACCEPTED


def to_rotors(bench: Bench) -> None:
    if bench.is_px4:
        assert bench.command(TRANSITION, TO_ROTORS) is Result.ACCEPTED
    else:
        assert bench.set_mode("GUIDED") is Result.ACCEPTED


def upload(bench: Bench, *items: PlanItem) -> None:
    home = () if bench.is_px4 else (bench.item(16, 0.0, 0.0, 0.0),)
    assert bench.upload([*home, *items]) is PlanResult.ACCEPTED


def transition(bench: Bench, form: float) -> PlanItem:
    item = bench.item(TRANSITION, 0.0, 0.0, 0.0)
    return PlanItem(command=TRANSITION, frame=2, param1=form, autocontinue=item.autocontinue)


@STYLES
def test_it_says_that_it_is_a_vtol_and_hovers_after_a_take_off(style: str) -> None:
    bench = flying(style)
    assert bench.last("HEARTBEAT").type == 22
    bench.command(512, 245)
    assert bench.last("EXTENDED_SYS_STATE").vtol_state == VtolForm.ROTORS
    bench.run(10.0)
    assert hypot(*bench.position[:2]) < 1.0
    assert height_m(bench) == pytest.approx(30.0, abs=0.6)


@pytest.mark.parametrize(("style", "seen"), [("px4", {3}), ("ardupilot", {1, 3})])
def test_ardupilot_reports_a_transition_for_a_moment_when_it_begins_to_hover_in_guided(
    style: str, seen: set[int]
) -> None:
    bench = flying(style)
    if style == "ardupilot":
        assert bench.set_mode("QLAND") is Result.ACCEPTED
        bench.run(0.5)
    assert bench.command(511, 245, 100_000) is Result.ACCEPTED
    begun = len(bench.received)
    assert bench.set_mode(ON_ROTORS[style]) is Result.ACCEPTED
    bench.run(1.0)
    reported = [one.vtol_state for one in bench.received[begun:] if one.name == "EXTENDED_SYS_STATE"]
    assert set(reported) == seen
    assert reported[-1] == form(bench) == VtolForm.ROTORS


@STYLES
def test_it_goes_over_to_its_wings_circles_and_comes_back_to_a_hover(style: str) -> None:
    bench = flying(style)
    to_wings(bench)
    bench.run(0.1)
    bench.command(512, 245)
    assert bench.last("EXTENDED_SYS_STATE").vtol_state == VtolForm.TO_WINGS
    took_s = bench.run_until(lambda: form(bench) is VtolForm.WINGS, 15.0)
    assert 4.0 < took_s < 9.0
    lowest_m, speeds = 100.0, []
    for _ in range(30):
        bench.run(1.0)
        lowest_m = min(lowest_m, height_m(bench))
        speeds.append(speed_m_s(bench))
    assert lowest_m > 24.0
    assert min(speeds) > 19.0
    assert sum(speeds[15:]) / 15 == pytest.approx(25.5, abs=1.5)
    assert bench.sim.truth().power_w < 1_000.0
    begin = bench.position
    to_rotors(bench)
    bench.run_until(lambda: form(bench) is VtolForm.ROTORS, 15.0)
    bench.run(6.0)
    assert speed_m_s(bench) < 0.5
    assert height_m(bench) == pytest.approx(30.0, abs=3.0)
    assert 40.0 < dist(begin, bench.position) < 150.0


@STYLES
def test_a_mission_in_wind_takes_off_flies_on_wings_and_lands_at_its_place(style: str) -> None:
    bench = Bench(style, vehicle="quadplane", wind=gusty(5.0, 270.0))
    bench.run_until(lambda: bool(bench.autopilot.estimator.is_position_good(bench.autopilot.craft.now_s)), 10.0)
    corners = ((500.0, 0.0), (500.0, 400.0))
    upload(
        bench,
        bench.item(VTOL_TAKE_OFF, 0.0, 0.0, 40.0),
        *(bench.item(16, *corner, 40.0) for corner in corners),
        bench.item(VTOL_LAND, 50.0, 20.0, 0.0),
    )
    bench.get_ready()
    assert bench.set_mode(MISSION[style]) is Result.ACCEPTED
    assert bench.command(ARM, 1) is Result.ACCEPTED
    bench.run_until(lambda: form(bench) is VtolForm.WINGS, 60.0)
    for corner in corners:
        bench.run_until(partial(is_near, bench, corner), 90.0)
        assert form(bench) is VtolForm.WINGS
        assert height_m(bench) == pytest.approx(40.0, abs=6.0)
    bench.run_until(lambda: form(bench) is VtolForm.ROTORS, 90.0)
    bench.run_until(lambda: bench.is_landed, 120.0)
    assert dist(bench.position[:2], (50.0, 20.0)) < 2.0
    bench.run(4.0)
    assert not bench.is_armed


@STYLES
def test_a_mission_of_transitions_flies_on_rotors_on_wings_and_on_rotors_again(style: str) -> None:
    bench = flying(style)
    places = ((60.0, 0.0), (500.0, 0.0), (560.0, 40.0))
    rotors, wings, rotors_again = (bench.item(16, *place, 30.0) for place in places)
    upload(
        bench,
        transition(bench, TO_ROTORS),
        rotors,
        transition(bench, TO_WINGS),
        wings,
        transition(bench, TO_ROTORS),
        rotors_again,
        bench.item(HOVER, *places[2], 30.0),
    )
    assert bench.set_mode(MISSION[style]) is Result.ACCEPTED
    bench.run(4.0)
    assert form(bench) is VtolForm.ROTORS
    bench.run_until(lambda: form(bench) is VtolForm.WINGS, 60.0)
    assert bench.position[0] > 90.0
    bench.run_until(lambda: form(bench) is VtolForm.ROTORS, 60.0)
    bench.run(40.0)
    assert dist(bench.position[:2], places[2]) < 2.0
    assert speed_m_s(bench) < 0.5


@STYLES
def test_a_transition_that_takes_too_long_leaves_it_on_its_rotors_and_sends_it_down(style: str) -> None:
    bench = flying(style)
    if style == "px4":
        bench.set_parameter("VT_TRANS_TIMEOUT", 3.0)
        bench.set_parameter("COM_QC_ACT", 1)
    else:
        bench.set_parameter("Q_TRANS_FAIL", 3)
        bench.set_parameter("Q_TRANS_FAIL_ACT", 0)
    to_wings(bench)
    bench.run_until(lambda: form(bench) is VtolForm.TO_WINGS, 1.0)
    assert bench.run_until(lambda: form(bench) is VtolForm.ROTORS, 5.0) == pytest.approx(3.0, abs=0.2)
    assert any("transition failed" in text for text in bench.texts)
    bench.run(0.5)
    assert bench.mode == {"px4": "Land", "ardupilot": "QLAND"}[style]
    bench.run_until(lambda: bench.is_landed, 90.0)


def test_ardupilot_that_only_warns_goes_on_with_a_transition_that_takes_too_long() -> None:
    bench = flying("ardupilot")
    bench.set_parameter("Q_TRANS_FAIL", 3)
    to_wings(bench)
    bench.run_until(lambda: form(bench) is VtolForm.WINGS, 15.0)
    assert sum("Transition failed" in text for text in bench.texts) == 1
    assert bench.mode == "LOITER"


@STYLES
def test_it_returns_on_its_wings_and_lands_at_home_on_its_rotors(style: str) -> None:
    bench = flying(style)
    to_wings(bench)
    bench.run_until(lambda: hypot(*bench.position[:2]) > 180.0, 40.0)
    assert bench.set_mode({"px4": "Return", "ardupilot": "RTL"}[style]) is Result.ACCEPTED
    bench.run(5.0)
    assert form(bench) is VtolForm.WINGS
    bench.run_until(lambda: bench.is_landed, 240.0)
    assert hypot(*bench.position[:2]) < 2.0


@STYLES
def test_told_to_land_on_wings_it_stops_and_goes_down_there(style: str) -> None:
    bench = flying(style)
    to_wings(bench)
    bench.run_until(lambda: form(bench) is VtolForm.WINGS, 20.0)
    bench.run(2.0)
    if style == "px4":
        assert bench.command(LAND, 0, 0, 0, 0, 0, 0, 0) is Result.ACCEPTED
    else:
        assert bench.set_mode("QLAND") is Result.ACCEPTED
    begin = bench.position
    bench.run_until(lambda: bench.is_landed, 120.0)
    assert dist(begin[:2], bench.position[:2]) < 120.0


def test_transitions_are_refused_on_the_ground_and_where_the_firmware_takes_none() -> None:
    px4 = Bench("px4", vehicle="quadplane")
    px4.get_ready()
    assert px4.command(TRANSITION, TO_WINGS) is Result.TEMPORARILY_REJECTED
    assert Bench("px4").command(TRANSITION, TO_WINGS) is Result.UNSUPPORTED
    plane = flying("ardupilot")
    assert plane.command(TRANSITION, TO_WINGS) is Result.FAILED


def test_the_same_seed_gives_the_same_flight() -> None:
    def end() -> tuple[float, ...]:
        bench = flying("px4", wind=gusty(6.0, 200.0))
        to_wings(bench)
        bench.run(20.0)
        return bench.position

    assert end() == end()
