"""Uploaded missions, fences and rally points, flown in virtual time in both styles."""

from math import dist, nan
from typing import Any

import pytest

from gloc3.mavlink.services.plan import PlanItem, PlanResult, PlanType
from gloc3_sitl.autopilot.mission import MissionState
from gloc3_sitl.autopilot.modes import Result

from .bench import ARM, REPOSITION, Bench

pytestmark = pytest.mark.flight

WAYPOINT, LOITER, LOITER_TIME, RETURN, LAND, TAKE_OFF, DELAY, JUMP, SPEED = 16, 17, 19, 20, 21, 22, 93, 177, 178
INCLUSION, CIRCLE_INCLUSION, CIRCLE_EXCLUSION, RALLY = 5001, 5003, 5004, 5100
MISSION_START, PAUSE_CONTINUE, SET_CURRENT, FENCE_ENABLE = 300, 193, 224, 207
STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])


def start(bench: Bench) -> None:
    bench.get_ready()
    assert bench.command(ARM, 1) is Result.ACCEPTED
    if not bench.is_px4:
        assert bench.set_mode("AUTO") is Result.ACCEPTED
    assert bench.command(MISSION_START) is Result.ACCEPTED


def with_home(bench: Bench, *items: PlanItem) -> list[PlanItem]:
    """ArduPilot's missions have home as their first item."""
    return list(items) if bench.is_px4 else [bench.item(WAYPOINT, height_m=0.0), *items]


@STYLES
def test_a_mission_is_flown_through_every_waypoint_and_lands(style: str) -> None:
    bench = Bench(style)
    items = with_home(
        bench,
        bench.item(TAKE_OFF),
        bench.item(SPEED, param1=1, param2=3.0),
        bench.item(WAYPOINT, 6.0, 0.0, param2=0.5),
        bench.item(203),
        bench.item(WAYPOINT, 6.0, 6.0, 4.0, param2=0.5),
        bench.item(LAND, 0.0, 6.0, 0.0),
    )
    bench.get_ready()
    assert bench.upload(items) is PlanResult.ACCEPTED
    start(bench)
    bench.run_until(lambda: dist(bench.position, (6.0, 0.0, -3.0)) < 0.8, 30.0)
    bench.run_until(lambda: dist(bench.position, (6.0, 6.0, -4.0)) < 0.8, 30.0)
    bench.run_until(lambda: not bench.is_armed, 40.0)
    assert dist(bench.position, (0.0, 6.0, 0.0)) < 0.4
    reached = [received.seq for received in bench.received if received.name == "MISSION_ITEM_REACHED"]
    first = 0 if bench.is_px4 else 1
    assert reached == list(range(first, len(items)))
    assert bench.autopilot.craft.mission.state is MissionState.COMPLETE


def test_a_mission_is_read_back_as_it_was_sent() -> None:
    bench = Bench()
    items = (bench.item(TAKE_OFF), bench.item(WAYPOINT, 5.0), bench.item(RETURN, frame=2, x=0, y=0))
    assert bench.upload(items) is PlanResult.ACCEPTED
    read = bench.download()
    assert [(item.command, item.frame, item.x, item.y, item.z) for item in read] == [
        (item.command, item.frame, item.x, item.y, item.z) for item in items
    ]


def test_ardupilot_puts_home_in_the_place_of_item_0() -> None:
    bench = Bench("ardupilot")
    bench.get_ready()
    assert bench.upload([bench.item(WAYPOINT, 500.0), bench.item(TAKE_OFF)]) is PlanResult.ACCEPTED
    bench.run(0.1)
    first = bench.download()[0]
    assert (first.command, first.frame) == (WAYPOINT, 0)
    assert abs(first.x - bench.item(WAYPOINT).x) < 20


@pytest.mark.parametrize(
    ("fields", "result"),
    [
        ({"command": 31999}, PlanResult.UNSUPPORTED),
        ({"command": WAYPOINT, "frame": 1}, PlanResult.UNSUPPORTED_FRAME),
        ({"command": WAYPOINT, "x": 900_000_001}, PlanResult.INVALID_PARAM5_X),
        ({"command": WAYPOINT, "y": 1_800_000_001}, PlanResult.INVALID_PARAM6_Y),
        ({"command": WAYPOINT, "height_m": float("nan")}, PlanResult.INVALID_PARAM7_Z),
        ({"command": JUMP, "param1": 9.0}, PlanResult.INVALID_PARAM1),
        ({"command": SPEED, "param2": -5.0}, PlanResult.INVALID_PARAM2),
    ],
)
@STYLES
def test_a_mission_with_a_bad_item_is_refused_whole(style: str, fields: dict[str, Any], result: PlanResult) -> None:
    bench = Bench(style)
    good = with_home(bench, bench.item(TAKE_OFF))
    assert bench.upload(good) is PlanResult.ACCEPTED
    assert bench.upload([*good, bench.item(**fields)]) is result
    assert len(bench.autopilot.plans.mission) == len(good)
    assert any("rejected: item" in text for text in bench.texts)


@STYLES
def test_px4_takes_what_names_no_place_in_the_frame_for_that_alone(style: str) -> None:
    bench = Bench(style)
    items = with_home(bench, bench.item(TAKE_OFF), bench.item(RETURN, frame=3))
    assert bench.upload(items) is (PlanResult.UNSUPPORTED if bench.is_px4 else PlanResult.ACCEPTED)


@STYLES
@pytest.mark.parametrize(
    ("command", "frame", "refusal"),
    [
        (82, 3, PlanResult.UNSUPPORTED),
        (115, 2, PlanResult.UNSUPPORTED),
        (183, 2, PlanResult.UNSUPPORTED),
        (16, 10, PlanResult.UNSUPPORTED_FRAME),
    ],
)
def test_px4_refuses_what_its_missions_do_not_know(style: str, command: int, frame: int, refusal: PlanResult) -> None:
    bench = Bench(style)
    items = with_home(bench, bench.item(TAKE_OFF), bench.item(command, 5.0, frame=frame))
    assert bench.upload(items) is (refusal if bench.is_px4 else PlanResult.ACCEPTED)


@STYLES
def test_a_mission_pauses_and_goes_on(style: str) -> None:
    bench = Bench(style)
    bench.set_parameter("MPC_XY_CRUISE" if bench.is_px4 else "WP_SPD", 3.0)
    items = with_home(bench, bench.item(TAKE_OFF), bench.item(WAYPOINT, 20.0), bench.item(LOITER, 20.0))
    bench.get_ready()
    bench.upload(items)
    start(bench)
    bench.run_until(lambda: bench.position[0] > 5.0, 30.0)
    assert bench.command(PAUSE_CONTINUE, 0) is Result.ACCEPTED
    bench.run(4.0)
    halted = bench.position
    assert halted[0] < 13.0
    bench.run(3.0)
    assert dist(bench.position, halted) < 0.3
    assert bench.autopilot.craft.mission.state is MissionState.PAUSED
    assert bench.command(PAUSE_CONTINUE, 1) is Result.ACCEPTED
    bench.run_until(lambda: bench.position[0] > 19.0, 20.0)


def test_waiting_jumping_and_delays_take_their_time() -> None:
    bench = Bench()
    bench.get_ready()
    bench.upload(
        [
            bench.item(TAKE_OFF),
            bench.item(WAYPOINT, 4.0, param1=2.0, param2=0.5),
            bench.item(DELAY, param1=3.0, frame=2),
            bench.item(WAYPOINT, 0.0, param2=0.5),
            bench.item(JUMP, param1=1.0, param2=1.0, frame=2),
            bench.item(LAND, 0.0, 0.0, 0.0),
        ]
    )
    start(bench)
    bench.run_until(lambda: not bench.is_armed, 90.0)
    reached = [received.seq for received in bench.received if received.name == "MISSION_ITEM_REACHED"]
    assert reached == [0, 1, 2, 3, 1, 2, 3, 5]


def test_a_mission_that_was_left_goes_on_where_it_was() -> None:
    bench = Bench()
    bench.get_ready()
    bench.upload([bench.item(TAKE_OFF), bench.item(WAYPOINT, 15.0), bench.item(LOITER, 15.0)])
    start(bench)
    bench.run_until(lambda: bench.position[0] > 4.0, 30.0)
    assert bench.set_mode("Hold") is Result.ACCEPTED
    bench.run(3.0)
    assert bench.set_mode("Mission") is Result.ACCEPTED
    assert bench.autopilot.craft.mission.current == 1
    bench.run_until(lambda: bench.position[0] > 14.0, 20.0)


def test_the_current_item_can_be_chosen() -> None:
    bench = Bench()
    bench.get_ready()
    bench.upload([bench.item(TAKE_OFF), bench.item(WAYPOINT, 20.0), bench.item(WAYPOINT, 0.0, 6.0, param1=60.0)])
    start(bench)
    bench.run_until(lambda: bench.position[0] > 2.0, 30.0)
    assert bench.command(SET_CURRENT, 2) is Result.ACCEPTED
    assert bench.command(SET_CURRENT, 9) is Result.DENIED
    bench.run_until(lambda: dist(bench.position, (0.0, 6.0, -3.0)) < 0.7, 20.0)


def test_a_mission_of_jumps_alone_does_not_hang_the_vehicle() -> None:
    bench = Bench()
    bench.get_ready()
    assert (
        bench.upload([bench.item(TAKE_OFF), bench.item(JUMP, param1=1.0, param2=-1.0, frame=2)]) is PlanResult.ACCEPTED
    )
    start(bench)
    bench.run(15.0)
    assert abs(bench.position[2] + 3.0) < 0.5


def test_mission_mode_without_a_mission_is_refused_in_flight_and_px4_takes_it_on_the_ground_and_does_not_arm() -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.set_mode("Mission") is Result.ACCEPTED
    assert bench.command(ARM, 1) is Result.TEMPORARILY_REJECTED
    assert bench.autopilot.commander.problems() == ["no mission"]
    assert bench.set_mode("Hold") is Result.ACCEPTED
    bench.take_off()
    assert bench.set_mode("Mission") is Result.TEMPORARILY_REJECTED
    assert "Mission denied: no mission" in bench.texts


# -- fences and rally points --------------------------------------------------------------------------------------------


def box(bench: Bench, half_m: float = 5.0) -> list[PlanItem]:
    corners = ((-half_m, -half_m), (-half_m, half_m), (half_m, half_m), (half_m, -half_m))
    return [bench.item(INCLUSION, n, e, 0.0, frame=0, param1=4.0) for n, e in corners]


def test_leaving_an_uploaded_fence_holds_and_is_told() -> None:
    bench = Bench()
    bench.take_off()
    assert bench.upload(box(bench), PlanType.FENCE) is PlanResult.ACCEPTED
    bench.start_streaming((0.0, 0.0, -2.5))
    bench.stream(lambda t: ((1.0 * t, 0.0, -2.5), (1.0, 0.0, 0.0)), 7.0)
    assert bench.mode == "Hold"
    assert "Failsafe: outside the fence" in bench.texts
    assert bench.position[0] < 7.0


@pytest.mark.parametrize(("action", "goes"), [(2, False), (1, True)])
def test_px4_holds_and_says_so_where_it_is_sent_beyond_a_fence_at_which_it_acts(action: int, goes: bool) -> None:
    bench = Bench()
    bench.set_parameter("GF_ACTION", action)
    bench.take_off()
    assert bench.upload(box(bench), PlanType.FENCE) is PlanResult.ACCEPTED
    away = bench.item(WAYPOINT, 9.0, 0.0, 3.0)
    target = {"frame": 0, "x": away.x, "y": away.y, "z": bench.sim.world.home.altitude_m + 3.0}
    assert bench.command(REPOSITION, -1, 1, 0, nan, as_int=target) is Result.ACCEPTED
    bench.run(8.0)
    assert (bench.position[0] > 5.0) is goes
    assert bench.mode == "Hold"
    assert ("Reposition is outside geofence" in bench.texts) is not goes


def test_arming_outside_the_fence_is_refused() -> None:
    bench = Bench()
    bench.get_ready()
    circle = bench.item(CIRCLE_INCLUSION, 50.0, 0.0, 0.0, frame=0, param1=10.0)
    assert bench.upload([circle], PlanType.FENCE) is PlanResult.ACCEPTED
    assert bench.command(ARM, 1) is Result.TEMPORARILY_REJECTED
    assert bench.autopilot.commander.problems() == ["outside the fence"]


FENCE_BIT = 1 << 20
"""MAV_SYS_STATUS_GEOFENCE."""


def fence_bits(bench: Bench) -> tuple[bool, bool, bool]:
    """Whether SYS_STATUS shows the fence as present, enabled and healthy."""
    assert bench.command(512, 1) is Result.ACCEPTED
    status = bench.last("SYS_STATUS")
    bits = [getattr(status, f"onboard_control_sensors_{what}") & FENCE_BIT for what in ("present", "enabled", "health")]
    return bool(bits[0]), bool(bits[1]), bool(bits[2])


@pytest.mark.parametrize("is_switched_on", [False, True])
def test_an_uploaded_fence_does_nothing_in_ardupilot_until_it_is_switched_on(is_switched_on: bool) -> None:
    bench = Bench("ardupilot")
    bench.set_parameter("FENCE_TYPE", 4)
    bench.set_parameter("RTL_ALT_M", 4.0)
    bench.get_ready()
    assert bench.command(FENCE_ENABLE, 1) is Result.FAILED, "there is no fence"
    assert bench.upload(box(bench), PlanType.FENCE) is PlanResult.ACCEPTED
    bench.run(0.5)
    assert fence_bits(bench) == (True, False, True)
    if is_switched_on:
        assert bench.command(FENCE_ENABLE, 1) is Result.ACCEPTED
    assert fence_bits(bench) == (True, is_switched_on, True)
    assert bench.autopilot.parameters["FENCE_ENABLE"] == 0
    bench.take_off()
    bench.start_streaming((0.0, 0.0, -2.5))
    bench.stream(lambda t: ((1.0 * t, 0.0, -2.5), (1.0, 0.0, 0.0)), 5.6)
    assert bench.mode == ("RTL" if is_switched_on else "GUIDED")
    assert fence_bits(bench) == (True, is_switched_on, not is_switched_on)


def test_ardupilot_loads_an_uploaded_fence_a_moment_later_and_has_none_until_then() -> None:
    bench = Bench("ardupilot")
    bench.set_parameter("FENCE_TYPE", 4)
    bench.get_ready()
    assert bench.upload(box(bench), PlanType.FENCE) is PlanResult.ACCEPTED
    assert bench.command(FENCE_ENABLE, 1) is Result.FAILED
    bench.run(0.5)
    assert bench.command(FENCE_ENABLE, 1) is Result.ACCEPTED
    assert fence_bits(bench) == (True, True, True)


def test_a_fence_that_only_reports_shows_as_off_in_ardupilot() -> None:
    bench = Bench("ardupilot")
    bench.set_parameter("FENCE_ACTION", 0)
    bench.get_ready()
    assert bench.command(FENCE_ENABLE, 1) is Result.ACCEPTED
    assert fence_bits(bench) == (True, False, True)


def test_px4_has_no_command_for_its_fence() -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.command(FENCE_ENABLE, 0) is Result.UNSUPPORTED


def test_a_closed_area_counts_in_ardupilot_when_the_fence_is_on() -> None:
    bench = Bench("ardupilot")
    bench.set_parameter("RTL_ALT_M", 4.0)
    bench.take_off()
    circle = bench.item(CIRCLE_EXCLUSION, 8.0, 0.0, 0.0, frame=0, param1=3.0)
    bench.upload([circle], PlanType.FENCE)
    bench.start_streaming((0.0, 0.0, -2.5))
    bench.stream(lambda t: ((1.0 * t, 0.0, -2.5), (1.0, 0.0, 0.0)), 6.5)
    assert bench.mode == "GUIDED"
    bench.set_parameter("FENCE_ENABLE", 1)
    bench.run(0.1)
    assert bench.mode == "RTL"
    assert bench.last("HEARTBEAT").system_status == 4, "not critical, as in other failsafes: this is told at once by"
    assert bench.last("FENCE_STATUS").breach_status == 1


def test_a_fence_that_is_not_closed_is_refused() -> None:
    bench = Bench()
    assert bench.upload(box(bench)[:3], PlanType.FENCE) is PlanResult.INVALID
    assert bench.upload([bench.item(WAYPOINT)], PlanType.FENCE) is PlanResult.UNSUPPORTED


def test_return_goes_to_the_nearer_rally_point() -> None:
    bench = Bench()
    bench.set_parameter("RTL_RETURN_ALT", 3.0)
    bench.take_off()
    assert bench.upload([bench.item(RALLY, 14.0, 0.0, 0.0)], PlanType.RALLY) is PlanResult.ACCEPTED
    bench.start_streaming((0.0, 0.0, -2.5))
    bench.stream(lambda t: ((1.0 * t, 0.0, -2.5), (1.0, 0.0, 0.0)), 9.0)
    assert bench.set_mode("Return") is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 40.0)
    assert dist(bench.position, (14.0, 0.0, 0.0)) < 0.5


def reported_item(bench: Bench) -> tuple[int, int]:
    assert bench.command(512, 42) is Result.ACCEPTED
    current = bench.last("MISSION_CURRENT")
    return current.seq, current.total


@pytest.mark.parametrize("is_command", [True, False])
def test_px4_reports_the_item_of_the_previous_plan_until_one_of_the_new_plan_is_set(is_command: bool) -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.upload([bench.item(WAYPOINT, float(north)) for north in range(5)]) is PlanResult.ACCEPTED
    assert bench.command(SET_CURRENT, 4) is Result.ACCEPTED
    assert bench.upload([bench.item(WAYPOINT, float(north)) for north in range(3)]) is PlanResult.ACCEPTED
    assert reported_item(bench) == (2, 3)
    if is_command:
        assert bench.command(SET_CURRENT, 0) is Result.ACCEPTED
    else:
        bench.send("MISSION_SET_CURRENT", target_system=1, target_component=1, seq=0)
    assert reported_item(bench) == (0, 3)


def test_px4_begins_a_new_plan_at_its_first_item_whatever_it_has_reported() -> None:
    bench = Bench()
    bench.get_ready()
    assert bench.upload([bench.item(WAYPOINT, float(north)) for north in range(5)]) is PlanResult.ACCEPTED
    assert bench.command(SET_CURRENT, 4) is Result.ACCEPTED
    assert bench.upload([bench.item(TAKE_OFF), bench.item(WAYPOINT, 6.0)]) is PlanResult.ACCEPTED
    assert reported_item(bench) == (1, 2)
    start(bench)
    bench.run(1.0)
    assert reported_item(bench) == (0, 2)


def test_ardupilot_reports_the_first_item_of_a_new_plan() -> None:
    bench = Bench("ardupilot")
    bench.get_ready()
    items = with_home(bench, *(bench.item(WAYPOINT, float(north)) for north in range(4)))
    assert bench.upload(items) is PlanResult.ACCEPTED
    assert bench.command(SET_CURRENT, 4) is Result.ACCEPTED
    assert bench.upload(items[:3]) is PlanResult.ACCEPTED
    assert reported_item(bench) == (1, 3)


@pytest.mark.parametrize(
    ("required", "commands", "lacking"),
    [
        (0, (), ""),
        (1, (LAND,), "take-off"),
        (2, (TAKE_OFF,), "landing"),
        (2, (LAND,), ""),
        (3, (), "take-off and landing"),
        (4, (), ""),
        (4, (TAKE_OFF,), "landing"),
        (5, (TAKE_OFF, LAND), ""),
    ],
)
def test_px4_acknowledges_a_plan_without_the_required_items_and_does_not_arm_with_it(
    required: int, commands: tuple[int, ...], lacking: str
) -> None:
    bench = Bench()
    bench.set_parameter("MIS_TKO_LAND_REQ", required)
    bench.get_ready()
    items = [bench.item(WAYPOINT, 5.0), *(bench.item(command) for command in commands)]
    assert bench.upload(items) is PlanResult.ACCEPTED
    assert bench.set_mode("Mission") is Result.ACCEPTED
    assert bench.autopilot.commander.problems() == ([f"the mission has no {lacking}"] if lacking else [])
    assert bench.command(ARM, 1) is (Result.TEMPORARILY_REJECTED if lacking else Result.ACCEPTED)


def test_px4_takes_off_for_no_plan_without_the_required_landing() -> None:
    bench = Bench()
    bench.set_parameter("MIS_TKO_LAND_REQ", 2)
    bench.get_ready()
    assert bench.upload([bench.item(TAKE_OFF), bench.item(WAYPOINT, 5.0)]) is PlanResult.ACCEPTED
    bench.take_off()
    assert bench.command(MISSION_START) is Result.TEMPORARILY_REJECTED
    assert "Mission denied: the mission has no landing" in bench.texts


def test_an_ardupilot_without_a_mission_counts_no_item_and_gives_its_home_as_item_0() -> None:
    bench = Bench("ardupilot")
    bench.get_ready()
    bench.run(1.0)
    assert bench.download() == ()
    bench.send("MISSION_REQUEST_INT", target_system=1, target_component=1, seq=0)
    bench.run(0.1)
    home = bench.last("MISSION_ITEM_INT")
    assert home.x == pytest.approx(bench.sim.world.home.latitude_deg * 1e7, abs=200)
    assert bench.set_mode("AUTO") is Result.FAILED
