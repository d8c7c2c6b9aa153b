"""The autopilot's own return before a start: below the ceiling, inside the fence, and home."""

import dataclasses
from collections.abc import Mapping

import pytest
from msgspec.structs import replace

from gloc3.messages.frames import GeoPoint
from gloc3.messages.preflight import Check, Verdict
from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import AutopilotState, Style, VehicleClass
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.platform.reader import load_platform
from gloc3_onboard.autopilot.presets.files import load_preset
from gloc3_onboard.checks.own_return import own_return_checks
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.tables import table_of

PX4, ARDUPILOT = Style.PX4, Style.ARDUPILOT
COPTER, PLANE, ROVER, VTOL = VehicleClass.COPTER, VehicleClass.PLANE, VehicleClass.ROVER, VehicleClass.VTOL
SQUARE = "{polygon_m: [[-5, -5], [40, -5], [40, 40], [-5, 40]], ceiling_m: 8}"
CORNER = "{polygon_m: [[-5, -5], [40, -5], [40, 40], [30, 40], [30, 5], [-5, 5]], ceiling_m: 8}"
KEEP_OUT = SQUARE.replace("ceiling_m: 8", "ceiling_m: 8, keep_out: [{circle_m: {center_m: [17, 17], radius_m: 3}}]")
MISSION = """\
mission: around the corner
frame: site
geofence: FENCE
on_failure: land
tasks:
  out: {actions: {up: {take_off: {height_m: 5}}, far: {follow_waypoints: {waypoints_m: [[35, 0, 5], [35, 35, 5]]}, after: [up]}}}
  back: {after: [out], actions: {way: {follow_waypoints: {waypoints_m: [[35, 0, 5], [0, 0, 5]]}}, down: {land: {}, after: [way]}}}
"""
RETURNING: Mapping[Style, dict[str, float]] = {
    PX4: {"NAV_DLL_ACT": 0, "COM_LOW_BAT_ACT": 3, "BAT_CRIT_THR": 0.1, "COM_OBL_RC_ACT": 5, "GF_ACTION": 2,
          "RTL_RETURN_ALT": 4, "RTL_TYPE": 0, "GF_MAX_VER_DIST": 0},
    ARDUPILOT: {"FS_GCS_ENABLE": 0, "FS_GCS_ENABL": 0, "FS_LONG_ACTN": 0, "BATT_FS_LOW_ACT": 2, "BATT_LOW_MAH": 660,
                "BATT_CAPACITY": 3300, "BATT_LOW_VOLT": 0, "FENCE_ACTION": 1, "RTL_ALT_M": 4, "RTL_ALTITUDE": 4},
}  # fmt: skip


def lines(
    style: Style,
    changes: Mapping[str, float] | None = None,
    *,
    vehicle: VehicleClass = COPTER,
    fence: str = SQUARE,
    without: tuple[str, ...] = (),
    mission: str = MISSION,
    has_pilot: bool = False,
) -> list[Check]:
    readings = readings_of(style, changes, vehicle=vehicle, fence=fence, without=without, mission=mission)
    state = AutopilotState(is_connected=True, has_transmitter=has_pilot)
    return list(own_return_checks(dataclasses.replace(readings, autopilot=state)))


def readings_of(
    style: Style,
    changes: Mapping[str, float] | None = None,
    *,
    vehicle: VehicleClass = COPTER,
    fence: str = SQUARE,
    without: tuple[str, ...] = (),
    mission: str = MISSION,
) -> Readings:
    platform = load_platform("copter")
    circumstances = Circumstances(
        platform=platform, origin=GeoPoint(*platform.frames["site"].origin.geo), home_ned_m=(0.0, 0.0, 0.0)
    )
    report = check_text(mission.replace("FENCE", fence), "m", circumstances)
    names = [name for name in table_of(style, vehicle).names() if name not in without]
    values = {name: float(value) for name, value in {**RETURNING[style], **(changes or {})}.items() if name in names}
    setup = AutopilotSetup(style=style, vehicle=vehicle, parameters=values, is_complete=True)
    return Readings(
        platform=platform, now_s=1.0, setup=setup, mission=report.mission, home_ned_m=circumstances.home_ned_m
    )


@pytest.mark.parametrize(
    ("style", "vehicle", "causes"),
    [(PX4, COPTER, "low battery"), (ARDUPILOT, COPTER, "low battery, fence"), (ARDUPILOT, ROVER, "low battery, fence")],
)
def test_a_return_that_stays_inside_is_told(style: Style, vehicle: VehicleClass, causes: str) -> None:
    changes = {"BATT_FS_LOW_ACT": 1} if vehicle is ROVER else {}
    (line,) = lines(style, changes, vehicle=vehicle)
    assert line.verdict is Verdict.OK
    assert line.finding == f"its own return ({causes}) stays inside the mission's fence"


@pytest.mark.parametrize(
    ("style", "vehicle", "changes", "without", "finding", "advice"),
    [
        (PX4, COPTER, {"RTL_RETURN_ALT": 30}, (), "climbs to 30 m above home; the mission's ceiling is 8.0 m above it",
         "set RTL_RETURN_ALT to 7 or less, which is 7 m, or raise the ceiling"),
        (ARDUPILOT, COPTER, {"RTL_ALT_M": 15}, (), "climbs to 15 m above home",
         "set RTL_ALT_M to 7 or less, which is 7 m, or raise the ceiling"),
        (ARDUPILOT, COPTER, {"RTL_ALT": 1500}, ("RTL_ALT_M",), "climbs to 15 m above home",
         "set RTL_ALT to 700 or less, which is 7 m, or raise the ceiling"),
        (ARDUPILOT, COPTER, {"RTL_CLIMB_MIN_M": 5}, (), "climbs by 5 m, to 10.0 m above home", "set RTL_CLIMB_MIN_M to 0"),
        (ARDUPILOT, PLANE, {"ALT_HOLD_RTL": 10000}, ("RTL_ALTITUDE",), "climbs to 100 m above home",
         "set ALT_HOLD_RTL to 700 or less, which is 7 m, or raise the ceiling"),
        (PX4, COPTER, {"RTL_TYPE": 2}, (), "may end along a plan or elsewhere (RTL_TYPE 2)",
         "set RTL_TYPE to 0 (home, or a nearer rally point)"),
    ],
)  # fmt: skip
def test_a_return_through_the_ceiling_or_to_elsewhere_is_red(
    style: Style,
    vehicle: VehicleClass,
    changes: dict[str, float],
    without: tuple[str, ...],
    finding: str,
    advice: str,
) -> None:
    (line,) = lines(style, changes, vehicle=vehicle, without=without)
    assert line.verdict is Verdict.RED
    assert finding in line.finding
    assert line.advice == advice


QUIET = {"BATT_FS_LOW_ACT": 1, "FENCE_ACTION": 4, "RTL_ALT_M": 15}
"""Of ArduCopter: no low battery and no fence has it return."""


@pytest.mark.parametrize(
    ("style", "changes", "has_pilot", "cause"),
    [
        (ARDUPILOT, {**QUIET, "FS_THR_ENABLE": 1}, True, "transmitter lost"),
        (ARDUPILOT, {**QUIET, "FS_THR_ENABLE": 1}, False, ""),
        (ARDUPILOT, {**QUIET, "FS_THR_ENABLE": 1, "FS_OPTIONS": 4}, True, ""),
        (ARDUPILOT, {**QUIET, "BATT_FS_CRT_ACT": 2, "BATT_CRT_MAH": 300}, False, "critical battery"),
        (ARDUPILOT, {**QUIET, "BATT_FS_CRT_ACT": 2, "BATT_CRT_MAH": 0, "BATT_CRT_VOLT": 0}, False, ""),
        (ARDUPILOT, {**QUIET, "FS_DR_ENABLE": 2}, False, "dead reckoning"),
        (PX4, {"COM_LOW_BAT_ACT": 2, "RTL_RETURN_ALT": 15, "NAV_RCL_ACT": 2}, True, "transmitter lost"),
        (PX4, {"COM_LOW_BAT_ACT": 2, "RTL_RETURN_ALT": 15, "NAV_RCL_ACT": 2, "COM_RCL_EXCEPT": 4}, True, ""),
    ],
)
def test_whatever_has_it_return_through_the_ceiling_is_red(
    style: Style, changes: dict[str, float], has_pilot: bool, cause: str
) -> None:
    found = lines(style, changes, has_pilot=has_pilot)
    if not cause:
        assert found == []
        return
    (line,) = found
    assert line.verdict is Verdict.RED
    assert line.finding.startswith(f"its own return ({cause}) climbs to 15 m above home")


def test_the_return_of_what_has_wings_and_rotors_has_two_heights() -> None:
    changes = {"BATT_FS_LOW_ACT": 1, "RTL_ALTITUDE": 4, "Q_RTL_ALT": 150}
    (line,) = lines(ARDUPILOT, changes, vehicle=VTOL)
    assert line.verdict is Verdict.RED
    assert line.advice == "set Q_RTL_ALT to 7 or less, which is 7 m, or raise the ceiling"


def test_a_return_above_the_platform_s_height_is_told_where_the_mission_has_no_ceiling() -> None:
    (line,) = lines(ARDUPILOT, {"RTL_ALT_M": 500}, fence=SQUARE.replace(", ceiling_m: 8", ""))
    assert line.verdict is Verdict.WARNING
    assert "climbs to 500 m above home; the platform's height_max_m is" in line.finding


@pytest.mark.parametrize(
    ("changes", "title", "finding"),
    [
        ({"RTL_RADIUS": -30, "WP_LOITER_RAD": 2}, "own return: circle", "circles 30 m around home, which is 5 m from"),
        ({"RTL_RADIUS": 0, "WP_LOITER_RAD": 60}, "own return: circle", "circles 60 m around home"),
        ({"BATT_FS_LOW_ACT": 1, "RTL_AUTOLAND": 0}, "own return: end", "circles over home until the battery is empty"),
        ({"BATT_FS_LOW_ACT": 1, "RTL_AUTOLAND": 2}, "own return", ""),
    ],
)
def test_a_plane_s_return_circles_inside_the_fence_and_is_landed(
    changes: dict[str, float], title: str, finding: str
) -> None:
    (line,) = lines(ARDUPILOT, changes, vehicle=PLANE)
    assert line.title == f"failsafes: {title}"
    assert line.verdict is (Verdict.RED if finding else Verdict.OK)
    assert finding in line.finding


def test_a_contingency_s_way_home_is_looked_at_too() -> None:
    far = "{follow_waypoints: {waypoints_m: [[35, 0, 5], [35, 35, 5]]}"
    refuge = "contingencies:\n  refuge: {actions: {away: " + far + "}}}\n"
    straight = MISSION.replace(far, "{follow_waypoints: {waypoints_m: [[35, 0, 5]]}")
    straight = straight.replace("on_failure: land\n", "on_failure: land\non_low_battery: {task: refuge, then: land}\n")
    (line,) = lines(ARDUPILOT, fence=CORNER, mission=straight + refuge)
    assert line.verdict is Verdict.RED
    assert "on refuge.away, it would leave the mission's fence" in line.finding


@pytest.mark.parametrize("fence", [CORNER, KEEP_OUT])
@pytest.mark.parametrize("style", Style)
def test_a_return_straight_through_the_fence_is_red(style: Style, fence: str) -> None:
    (line,) = lines(style, fence=fence)
    assert line.verdict is Verdict.RED
    assert "on out.far, it would leave the mission's fence" in line.finding


def test_rally_points_of_the_autopilot_are_a_warning() -> None:
    (line,) = lines(ARDUPILOT, {"RALLY_TOTAL": 2})
    assert line.verdict is Verdict.WARNING
    assert "(RALLY_TOTAL 2)" in line.finding


@pytest.mark.parametrize(
    ("style", "changes"),
    [
        (PX4, {"COM_LOW_BAT_ACT": 2, "RTL_RETURN_ALT": 60, "RTL_TYPE": 3}),
        (ARDUPILOT, {"BATT_FS_LOW_ACT": 1, "FENCE_ACTION": 4, "RTL_ALT_M": 60}),
        (ARDUPILOT, {"BATT_LOW_MAH": 0, "FENCE_ACTION": 4, "RTL_ALT_M": 60}),
    ],
)
def test_without_a_failsafe_that_returns_its_return_is_no_matter(style: Style, changes: dict[str, float]) -> None:
    assert lines(style, changes, fence=CORNER) == []


@pytest.mark.parametrize(("style", "name"), [(PX4, "px4_companion"), (ARDUPILOT, "arducopter_companion")])
def test_a_multirotor_s_preset_keeps_its_return_below_any_ceiling(style: Style, name: str) -> None:
    values = load_preset(name).values()
    (line,) = lines(
        style, {**values, "RTL_CLIMB_MIN_M": values.get("RTL_CLIMB_MIN_M", 0.0)}, fence=SQUARE.replace("8}", "6.1}")
    )
    assert line.verdict is Verdict.OK


def test_no_two_lines_have_the_same_name() -> None:
    found = lines(ARDUPILOT, {"RTL_ALT_M": 15, "RTL_CLIMB_MIN_M": 20, "RALLY_TOTAL": 1}, fence=CORNER)
    names = [line.name for line in found]
    assert names == [f"own return: {what}" for what in ("height", "climb", "way", "rally points")]


@pytest.mark.parametrize(("count", "verdict"), [(2, Verdict.WARNING), (0, Verdict.OK), (None, Verdict.OK)])
def test_the_rally_points_of_px4_are_told_as_where_its_return_may_end(count: int | None, verdict: Verdict) -> None:
    readings = readings_of(PX4)
    assert readings.setup is not None
    readings = dataclasses.replace(readings, setup=replace(readings.setup, rally_points=count))
    (line,) = own_return_checks(readings)
    assert line.verdict is verdict
    if count:
        assert line.finding == (
            "its own return (low battery) may end at one of its rally points (it holds 2), which are not compared with the "
            "fence"
        )
