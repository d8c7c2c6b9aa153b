"""The autopilot's own fence before a start: it keeps the mission's, and does not stop the mission on its way."""

from collections.abc import Mapping

import pytest

from gloc3.messages.frames import GeoPoint
from gloc3.messages.preflight import Check, Verdict
from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import Style, VehicleClass
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.platform.reader import load_platform
from gloc3_onboard.checks.fence import fence_checks
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.tables import table_of

FENCE = "geofence: {circle: {center: [47.0, 8.0], radius_m: 900}}"
MISSION = """\
mission: out and back
frame: geo
GEOFENCE
tasks:
  out: {actions: {climb: {take_off: {height_m: 12}}, there: {go_to: {position: [47.001, 8.0, 40]}, after: [climb]}}}
  back: {after: [out], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""
FENCE_BIT = 1 << 20
PX4, ARDUPILOT = Style.PX4, Style.ARDUPILOT
COPTER, PLANE, ROVER, SUB = VehicleClass.COPTER, VehicleClass.PLANE, VehicleClass.ROVER, VehicleClass.SUB
GOOD = {
    PX4: {"GF_ACTION": 2.0, "GF_MAX_HOR_DIST": 0.0, "GF_MAX_VER_DIST": 0.0},
    ARDUPILOT: {"FENCE_ENABLE": 0.0, "FENCE_TYPE": 7.0, "FENCE_ACTION": 1.0, "FENCE_RADIUS": 300.0, "FENCE_ALT_MAX": 100.0},
}  # fmt: skip


def lines(
    style: Style,
    vehicle: VehicleClass = COPTER,
    changes: Mapping[str, float] | None = None,
    *,
    geofence: str = FENCE,
    sensors_enabled: int = 0,
    mission: str = MISSION,
) -> list[Check]:
    platform = load_platform("copter")
    circumstances = Circumstances(
        platform=platform, origin=GeoPoint(47.0, 8.0, 400.0), home_altitude_m=400.0, home_ned_m=(0.0, 0.0, 0.0)
    )
    loaded = check_text(mission.replace("GEOFENCE", geofence), "m", circumstances).mission
    names = table_of(style, vehicle).names()
    values = {name: float(value) for name, value in {**GOOD[style], **(changes or {})}.items() if name in names}
    setup = AutopilotSetup(
        style=style, vehicle=vehicle, parameters=values, is_complete=True, sensors_enabled=sensors_enabled
    )
    return list(
        fence_checks(
            Readings(platform=platform, now_s=1.0, setup=setup, mission=loaded, home_ned_m=circumstances.home_ned_m)
        )
    )


@pytest.mark.parametrize(
    ("style", "vehicle", "finding"),
    [
        (PX4, COPTER, "hold (GF_ACTION 2)"),
        (ARDUPILOT, COPTER, "return (FENCE_ACTION 1)"),
        (ARDUPILOT, PLANE, "return (FENCE_ACTION 1)"),
        (ARDUPILOT, ROVER, "return (FENCE_ACTION 1)"),
    ],
)
def test_what_the_autopilot_does_at_the_fence_is_told(style: Style, vehicle: VehicleClass, finding: str) -> None:
    (line,) = lines(style, vehicle)
    assert (line.verdict, line.finding) == (Verdict.OK, finding)


@pytest.mark.parametrize(
    ("style", "vehicle", "changes", "finding", "advice"),
    [
        (PX4, COPTER, {"GF_ACTION": 0}, "continue (GF_ACTION 0): the autopilot would let",
         "set GF_ACTION to one of 2 (hold), 3 (return), 5 (land)"),
        (PX4, PLANE, {"GF_ACTION": 1}, "continue (GF_ACTION 1): the autopilot would let",
         "set GF_ACTION to one of 2 (hold), 3 (return), 5 (land)"),
        (ARDUPILOT, PLANE, {"FENCE_ACTION": 0}, "continue (FENCE_ACTION 0): the autopilot would let",
         "set FENCE_ACTION to one of 1 (return), 6 (hold), 7 (hold), 8 (land)"),
        (ARDUPILOT, COPTER, {"FENCE_TYPE": 3}, "3 leaves out polygons", "set FENCE_TYPE to 7"),
        (PX4, COPTER, {"GF_MAX_HOR_DIST": 112},
         "the mission goes 111.2 m away from home, with a margin of 1 m; the autopilot's limit is 112 m",
         "set GF_MAX_HOR_DIST to 113 or more, or GF_MAX_HOR_DIST to 0, or change the mission"),
        (PX4, COPTER, {"GF_MAX_VER_DIST": 30},
         "the mission goes 40.0 m above home, with a margin of 1 m; the autopilot's limit is 30 m",
         "set GF_MAX_VER_DIST to 41 or more, or GF_MAX_VER_DIST to 0, or change the mission"),
        (ARDUPILOT, COPTER, {"FENCE_ALT_MAX": 40.5},
         "the mission goes 40.0 m above home, with a margin of 1 m; the autopilot's limit is 40.5 m",
         "set FENCE_ALT_MAX to 41 or more, or FENCE_TYPE to 6, or change the mission"),
        (ARDUPILOT, ROVER, {"FENCE_RADIUS": 50, "FENCE_TYPE": 6},
         "the mission goes 111.2 m away from home, with a margin of 1 m; the autopilot's limit is 50 m",
         "set FENCE_RADIUS to 113 or more, or FENCE_TYPE to 4, or change the mission"),
    ],
)  # fmt: skip
def test_a_fence_that_does_not_act_or_would_stop_the_mission_is_red(
    style: Style, vehicle: VehicleClass, changes: dict[str, float], finding: str, advice: str
) -> None:
    (line,) = [one for one in lines(style, vehicle, changes) if one.verdict is Verdict.RED]
    assert line.finding.startswith(finding)
    assert line.advice == advice


@pytest.mark.parametrize(
    ("style", "changes"),
    [
        (PX4, {"GF_MAX_HOR_DIST": 113}),
        (PX4, {"GF_MAX_VER_DIST": 41}),
        (ARDUPILOT, {"FENCE_RADIUS": 50, "FENCE_TYPE": 5}),
        (ARDUPILOT, {"FENCE_ALT_MAX": 30, "FENCE_TYPE": 6}),
    ],
)
def test_a_limit_that_is_wide_enough_or_not_selected_is_no_matter(style: Style, changes: dict[str, float]) -> None:
    assert [one.verdict for one in lines(style, COPTER, changes)] == [Verdict.OK]


@pytest.mark.parametrize(
    ("style", "changes", "sensors_enabled", "reds"),
    [
        (ARDUPILOT, {"FENCE_RADIUS": 50}, 0, 0),
        (ARDUPILOT, {"FENCE_RADIUS": 50, "FENCE_ENABLE": 1}, 0, 1),
        (ARDUPILOT, {"FENCE_RADIUS": 50}, FENCE_BIT, 1),
        (ARDUPILOT, {"FENCE_RADIUS": 50, "FENCE_ENABLE": 1, "FENCE_ACTION": 0}, 0, 0),
        (PX4, {"GF_MAX_HOR_DIST": 50}, 0, 1),
        (PX4, {"GF_MAX_HOR_DIST": 50, "GF_ACTION": 1}, 0, 0),
    ],
)
def test_without_a_fence_in_the_mission_the_limits_of_a_fence_that_is_on_count(
    style: Style, changes: dict[str, float], sensors_enabled: int, reds: int
) -> None:
    found = lines(style, COPTER, changes, geofence="", sensors_enabled=sensors_enabled)
    assert [one.verdict for one in found] == [Verdict.RED] * reds


def test_a_contingency_is_measured_too() -> None:
    far = MISSION + "on_low_battery: {task: refuge, then: land}\ncontingencies:\n"
    far += "  refuge: {actions: {away: {go_to: {position: [47.002, 8.0, 20]}}}}\n"
    (line,) = [one for one in lines(PX4, COPTER, {"GF_MAX_HOR_DIST": 150}, mission=far) if one.verdict is Verdict.RED]
    assert line.finding.startswith("the mission goes 222.4 m away from home")


def test_a_submarine_s_fence_has_a_depth_and_does_nothing_at_it() -> None:
    deep = MISSION.replace("take_off: {height_m: 12}", "take_off: {height_m: 1}").replace("8.0, 40]", "8.0, -20]")
    found = lines(ARDUPILOT, SUB, {"FENCE_TYPE": 12, "FENCE_ALT_MIN": -15}, mission=deep)
    told, line = found
    assert (told.verdict, line.verdict) == (Verdict.WARNING, Verdict.RED)
    assert "the limiter alone keeps" in told.finding
    assert line.finding.startswith(
        "the mission goes 20.0 m below home, with a margin of 1 m; the autopilot's limit is -15"
    )
    assert line.advice == "set FENCE_ALT_MIN to -22 or less, or FENCE_TYPE to 4, or change the mission"


NEAR = "geofence: {circle: {center: [47.0, 8.0], radius_m: 114}}"
NEARBY = MISSION.replace("[47.001, 8.0, 40]", "[47.0, 8.0, 40]")
SLOW = MISSION.replace("[47.001, 8.0, 40]}", "[47.001, 8.0, 40], speed_m_s: 0.5}")


REFUGE = "contingencies: {refuge: {actions: {away: {go_to: {position: [47.001, 8.0, 40]}}}}}\n"
BY_HAND = "there: {teleoperate: {duration_s: 20, speed_m_s: 4}"


@pytest.mark.parametrize(
    ("style", "changes", "mission", "finding"),
    [
        (ARDUPILOT, {"GUID_TIMEOUT": 3.0}, NEARBY + "on_low_battery: {task: refuge, then: land}\n" + REFUGE,
         "flies on for 3 s"),
        (ARDUPILOT, {"GUID_TIMEOUT": 3.0}, NEARBY.replace("there: {go_to: {position: [47.0, 8.0, 40]}", BY_HAND),
         "at 4 m/s the autopilot flies on for 3 s"),
        (ARDUPILOT, {"GUID_TIMEOUT": 3.0}, NEARBY, ""),
        (ARDUPILOT, {"GUID_TIMEOUT": 3.0}, MISSION, "flies on for 3 s"),
        (PX4, {"COM_OF_LOSS_T": 5.0}, MISSION, "flies on for 5 s"),
        (ARDUPILOT, {"GUID_TIMEOUT": 3.0}, SLOW, ""),
        (ARDUPILOT, {}, MISSION, ""),
    ],
)  # fmt: skip
def test_it_is_told_where_a_dead_companion_would_let_the_vehicle_out(
    style: Style, changes: dict[str, float], mission: str, finding: str
) -> None:
    mission = mission.replace("8.0, 40]}", "8.0, 40], speed_m_s: 2}")
    told = [
        one.finding
        for one in lines(style, COPTER, changes, geofence=NEAR, mission=mission)
        if "flies on" in one.finding
    ]
    assert len(told) == bool(finding)
    near = "within 1.0 m" if BY_HAND in mission else "within 2.8 m"
    assert all(finding in one and f"{near} of its fence" in one for one in told), told


@pytest.mark.parametrize(("action", "verdict"), [(1, Verdict.OK), (0, Verdict.WARNING)])
def test_a_dead_companion_is_a_warning_where_the_autopilot_does_not_act_at_the_fence(
    action: int, verdict: Verdict
) -> None:
    mission = MISSION.replace("8.0, 40]}", "8.0, 40], speed_m_s: 2}")
    found = lines(ARDUPILOT, COPTER, {"GUID_TIMEOUT": 3.0, "FENCE_ACTION": action}, geofence=NEAR, mission=mission)
    (line,) = [one for one in found if one.name == "companion lost"]
    assert line.verdict is verdict
    assert len({one.name for one in found}) == len(found)


CEILING = "geofence: {circle: {center: [47.0, 8.0], radius_m: 900}, ceiling_m: 60}"


@pytest.mark.parametrize(
    ("style", "changes", "finding", "advice"),
    [
        (PX4, {}, ("the mission's ceiling is 60.0 m above home, and the autopilot has no limit of height: GLOC3's limiter alone "
         "keeps it"), "set GF_MAX_VER_DIST to 60"),
        (PX4, {"GF_MAX_VER_DIST": 120}, ("the mission's ceiling is 60.0 m above home, and the autopilot's limit 120 m: between "
         "them GLOC3's limiter alone keeps it"), "set GF_MAX_VER_DIST to 60"),
        (ARDUPILOT, {}, ("the mission's ceiling is 60.0 m above home, and the autopilot's limit 100 m: between them GLOC3's "
         "limiter alone keeps it"), "set FENCE_ALT_MAX to 60"),
        (ARDUPILOT, {"FENCE_TYPE": 6}, ("the mission's ceiling is 60.0 m above home, and the autopilot has no limit of height: "
         "GLOC3's limiter alone keeps it"), "set FENCE_ALT_MAX to 60 and FENCE_TYPE to 7"),
    ],
)  # fmt: skip
def test_a_ceiling_that_the_autopilot_does_not_keep_is_a_warning(
    style: Style, changes: dict[str, float], finding: str, advice: str
) -> None:
    (line,) = [one for one in lines(style, COPTER, changes, geofence=CEILING) if one.name == "ceiling"]
    assert (line.verdict, line.finding, line.advice) == (Verdict.WARNING, finding, advice)


@pytest.mark.parametrize(("style", "changes"), [(PX4, {"GF_MAX_VER_DIST": 60}), (ARDUPILOT, {"FENCE_ALT_MAX": 55})])
def test_a_ceiling_that_the_autopilot_keeps_is_told_as_kept(style: Style, changes: dict[str, float]) -> None:
    (line,) = [one for one in lines(style, COPTER, changes, geofence=CEILING) if one.name == "ceiling"]
    name, value = next(iter(changes.items()))
    assert (line.verdict, line.finding) == (Verdict.OK, f"60.0 m above home; the autopilot keeps {value} m ({name})")
