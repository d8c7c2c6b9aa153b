"""The lines of the pre-flight list, from what is known of a platform: what is right, doubtful, red, and what to do."""

from typing import Any

import msgspec
import pytest

from gloc3.messages.hosts import HostPresence, HostStatus
from gloc3.messages.preflight import Check, Verdict, in_order, red, summary, worst
from gloc3.messages.readiness import AutopilotSetup, ComputerState, LinkCondition
from gloc3.messages.software import own_software
from gloc3.messages.summaries import Health
from gloc3.messages.vehicle import AutopilotState, FlightMode, Pose, Style, VehicleClass
from gloc3.platform.platform import Failsafes, HostRow, LinkLossFailsafe, LowBatteryFailsafe, PoseLostFailsafe
from gloc3.platform.reader import load_platform
from gloc3_onboard.checks.checklist import checklist
from gloc3_onboard.checks.readings import ComponentCondition, Readings
from gloc3_onboard.checks.tables import table_of

PELICAN = load_platform("pelican_rtk")
WELL = 1 | 2 | 4 | 8 | 32
PARAMETERS = {
    Style.PX4: {
        "NAV_DLL_ACT": 0.0,
        "COM_DL_LOSS_T": 10.0,
        "COM_DLL_EXCEPT": 0.0,
        "COM_LOW_BAT_ACT": 3.0,
        "BAT_CRIT_THR": 0.1,
        "COM_OBL_RC_ACT": 5.0,
        "COM_OF_LOSS_T": 1.0,
        "CAL_GYRO0_ID": 1.0,
        "CAL_ACC0_ID": 1.0,
        "CAL_MAG0_ID": 1.0,
    },
    Style.ARDUPILOT: {
        "FS_GCS_ENABLE": 0.0,
        "FS_GCS_TIMEOUT": 5.0,
        "BATT_FS_LOW_ACT": 2.0,
        "BATT_LOW_MAH": 625.0,
        "BATT_CAPACITY": 6250.0,
        "FS_EKF_ACTION": 1.0,
        "GUID_TIMEOUT": 3.0,
        "ARMING_SKIPCHK": 0.0,
    },
}
POSE = Pose(position_ned_m=(0.0,) * 3, velocity_ned_m_s=(0.0,) * 3, ned_from_frd=(1.0, 0.0, 0.0, 0.0), sources=["gps"])


def setup(style: Style = Style.PX4, /, **changes: Any) -> AutopilotSetup:
    parameters = {**PARAMETERS[style], **changes.pop("set", {})}
    known = AutopilotSetup(
        style=style,
        firmware=(1, 16, 0) if style is Style.PX4 else (4, 7, 0),
        parameters=parameters,
        sensors_present=WELL,
        sensors_enabled=WELL,
        sensors_health=WELL,
        utc_minus_t_s=1000.0,
        is_complete=True,
    )
    return msgspec.structs.replace(known, **changes)


def found(style: Style = Style.PX4, **changes: Any) -> dict[str, Check]:
    """The list of a vehicle that is ready, but for the changes."""
    state = AutopilotState(
        is_connected=True,
        style=style,
        mode=FlightMode.HOLD,
        mode_name="HOLD",
        is_armable=True,
        battery_v=12.6,
        battery_remaining=0.9,
    )
    computer = ComputerState(disk_free_mb=50_000.0, disk_write_mb_s=80.0, utc_minus_t_s=1000.2)
    known: dict[str, Any] = {
        "platform": PELICAN,
        "now_s": 10.0,
        "autopilot": msgspec.structs.replace(state, **changes.pop("state", {})),
        "setup": setup(style),
        "computer": msgspec.structs.replace(computer, **changes.pop("computer", {})),
        "pose": POSE,
        "is_pose_fresh": True,
        "components": [ComponentCondition(name="pose", health=Health.WORKING, is_required=True, is_standby=False)],
    }
    return {check.title: check for check in checklist(Readings(**{**known, **changes}))}


def stating(**failsafes: Any) -> Any:
    return msgspec.structs.replace(PELICAN, failsafes=Failsafes(**failsafes))


@pytest.mark.parametrize("style", Style)
def test_a_ready_vehicle_has_nothing_red_or_doubtful(style: Style) -> None:
    lines = found(style)
    assert [str(one) for one in lines.values() if one.verdict not in (Verdict.OK, Verdict.UNKNOWN)] == []
    assert lines["mission: loaded"].verdict is Verdict.UNKNOWN


@pytest.mark.parametrize("style", Style)
def test_every_parameter_of_a_table_is_read_once(style: Style) -> None:
    names = table_of(style).names()
    assert len(set(names)) == len(names)
    assert set(PARAMETERS[style]) <= set(names)
    assert all(0 < len(name) <= 16 for name in names)


def test_a_clock_that_is_too_fast_keeps_from_starting() -> None:
    line = found(setup=setup(clock_rate=5.0))["autopilot: clock"]
    assert line.verdict is Verdict.RED
    assert line.finding.startswith("it runs 5.0 times as fast as this computer's")


def test_without_an_autopilot_one_line_says_what_to_do() -> None:
    lines = found(state={"is_connected": False})
    assert [title for title in lines if title.startswith("autopilot")] == ["autopilot: answers"]
    assert lines["autopilot: answers"].verdict is Verdict.RED
    assert lines["autopilot: answers"].advice


def test_the_autopilots_own_reasons_are_told() -> None:
    line = found(state={"is_armable": False, "reasons": ["PreArm: Compass not calibrated"]})["autopilot: ready to arm"]
    assert line.verdict is Verdict.RED
    assert "Compass not calibrated" in line.finding


def test_what_speaks_against_arming_is_told_with_the_autopilots_reasons_and_alone_it_is_a_warning() -> None:
    doubts = ["not well: GPS", "the estimator has no horizontal position"]
    red_line = found(state={"is_armable": False, "reasons": [], "doubts": doubts})["autopilot: ready to arm"]
    assert red_line.finding == "; ".join(doubts)
    lines = found(state={"doubts": doubts})
    assert lines["autopilot: estimator"].verdict is Verdict.WARNING
    assert lines["autopilot: estimator"].finding == doubts[1], "sensors have a line of their own"


@pytest.mark.parametrize(
    ("left", "verdict"), [(0.5, Verdict.OK), (0.19, Verdict.RED), (0.0, Verdict.RED), (-1.0, Verdict.WARNING)]
)
def test_the_battery_is_held_against_the_reserve(left: float, verdict: Verdict) -> None:
    assert found(state={"battery_remaining": left})["autopilot: battery"].verdict is verdict


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"firmware": (1, 13, 3)}, Verdict.WARNING),
        ({"is_official": False}, Verdict.WARNING),
        ({"firmware": None}, Verdict.UNKNOWN),
    ],
)
def test_an_old_unfinished_or_silent_firmware_is_told(changes: dict[str, Any], verdict: Verdict) -> None:
    assert found(setup=setup(**changes))["autopilot: firmware"].verdict is verdict


def test_parameters_that_were_not_read_leave_failsafes_unjudged_and_say_so() -> None:
    lines = found(setup=setup(is_complete=False))
    assert lines["autopilot: parameters"].verdict is Verdict.UNKNOWN
    assert not [title for title in lines if title.startswith("failsafes")]
    assert found(setup=None)["autopilot: parameters"].advice
    assert found(is_setup_fresh=False)["autopilot: parameters"].verdict is Verdict.WARNING


@pytest.mark.parametrize(
    ("style", "name", "value", "line"),
    [
        (Style.PX4, "NAV_DLL_ACT", 2.0, "link loss"),
        (Style.PX4, "NAV_DLL_ACT", 6.0, "link loss"),
        (Style.PX4, "NAV_DLL_ACT", 99.0, "link loss"),
        (Style.PX4, "COM_LOW_BAT_ACT", 0.0, "low battery"),
        (Style.PX4, "COM_LOW_BAT_ACT", 2.0, "low battery"),
        (Style.PX4, "BAT_CRIT_THR", 0.3, "low battery"),
        (Style.PX4, "COM_OBL_RC_ACT", 7.0, "setpoints lost"),
        (Style.ARDUPILOT, "FS_GCS_ENABLE", 5.0, "link loss"),
        (Style.ARDUPILOT, "BATT_FS_LOW_ACT", 0.0, "low battery"),
        (Style.ARDUPILOT, "BATT_FS_LOW_ACT", 5.0, "low battery"),
        (Style.ARDUPILOT, "BATT_LOW_MAH", 1500.0, "low battery"),
    ],
)
def test_a_failsafe_that_would_overrule_the_mission_is_red_and_names_the_parameter(
    style: Style, name: str, value: float, line: str
) -> None:
    check = found(style, setup=setup(style, set={name: value}))[f"failsafes: {line}"]
    assert check.verdict is Verdict.RED
    assert name in check.advice or name in check.finding


@pytest.mark.parametrize(
    ("style", "changes", "line"),
    [
        (Style.PX4, {"BAT_CRIT_THR": 0.07}, "low battery"),
        (Style.ARDUPILOT, {"FS_EKF_ACTION": 2.0}, "position lost"),
    ],
)
def test_a_failsafe_that_comes_late_or_needs_a_pilot_is_a_warning(
    style: Style, changes: dict[str, float], line: str
) -> None:
    assert found(style, setup=setup(style, set=changes))[f"failsafes: {line}"].verdict is Verdict.WARNING


@pytest.mark.parametrize(("has_pilot", "verdict"), [(False, Verdict.RED), (True, Verdict.WARNING)])
def test_a_vehicle_is_left_to_a_pilot_only_where_one_stands_by(has_pilot: bool, verdict: Verdict) -> None:
    platform = msgspec.structs.replace(stating(), pilot=has_pilot)
    check = found(setup=setup(set={"COM_OBL_RC_ACT": 0.0}), platform=platform)["failsafes: setpoints lost"]
    assert check.verdict is verdict
    assert ("pilot: true" in check.advice) is not has_pilot


@pytest.mark.parametrize(
    ("has_pilot", "value", "is_red"),
    [(True, 4.0, True), (True, 1.0, True), (True, 0.0, False), (True, 2.0, False), (False, 4.0, False)],
)
def test_a_pilot_who_stands_by_is_not_ignored(has_pilot: bool, value: float, is_red: bool) -> None:
    platform = msgspec.structs.replace(stating(), pilot=has_pilot)
    checks = found(setup=setup(set={"COM_RC_IN_MODE": value}), platform=platform)
    assert ("failsafes: COM_RC_IN_MODE" in checks) is is_red
    if is_red:
        check = checks["failsafes: COM_RC_IN_MODE"]
        assert (check.verdict, check.advice) == (Verdict.RED, "set COM_RC_IN_MODE to 0")
        assert check.finding == f"{value:g}: it ignores the transmitter of the pilot who stands by"


@pytest.mark.parametrize(("value", "is_red"), [(0.0, False), (2.0, True), (5.0, True)])
def test_a_plane_whose_plans_need_a_landing_is_red(value: float, is_red: bool) -> None:
    names = table_of(Style.PX4, VehicleClass.PLANE).names()
    assert "MIS_TKO_LAND_REQ" in names
    plane = msgspec.structs.replace(setup(set={"MIS_TKO_LAND_REQ": value}), vehicle=VehicleClass.PLANE)
    titles = [check.title for check in red(found(setup=plane).values())]
    assert ("failsafes: MIS_TKO_LAND_REQ" in titles) is is_red


@pytest.mark.parametrize(
    ("style", "name", "value", "verdict", "right"),
    [
        (Style.PX4, "MIS_TKO_LAND_REQ", 2.0, Verdict.RED, "0"),
        (Style.PX4, "NAV_FORCE_VT", 0.0, Verdict.WARNING, "another value"),
        (Style.ARDUPILOT, "Q_GUIDED_MODE", 0.0, Verdict.RED, "1"),
        (Style.ARDUPILOT, "Q_TRANS_FAIL", 0.0, Verdict.WARNING, "another value"),
        (Style.ARDUPILOT, "Q_RTL_MODE", 0.0, Verdict.WARNING, "another value"),
    ],
)
def test_what_keeps_a_vtol_from_its_paths_or_its_hover_is_told_with_the_right_value(
    style: Style, name: str, value: float, verdict: Verdict, right: str
) -> None:
    assert name in table_of(style, VehicleClass.VTOL).names()
    vtol = msgspec.structs.replace(setup(style, set={name: value}), vehicle=VehicleClass.VTOL)
    check = found(setup=vtol)[f"failsafes: {name}"]
    assert check.verdict is verdict
    assert check.advice == f"set {name} to {right}"


def test_what_the_platform_file_states_is_what_counts() -> None:
    returns = setup(set={"NAV_DLL_ACT": 2.0, "COM_LOW_BAT_ACT": 0.0})
    stated = stating(link_loss=LinkLossFailsafe(action="return", after_s=10.0))
    assert red(found(setup=returns, platform=stated).values()) == []
    sooner = stating(link_loss=LinkLossFailsafe(action="return", after_s=30.0))
    assert found(setup=returns, platform=sooner)["failsafes: link loss"].verdict is Verdict.RED
    later = stating(link_loss=LinkLossFailsafe(action="return", after_s=5.0))
    assert found(setup=returns, platform=later)["failsafes: link loss"].verdict is Verdict.WARNING
    nothing = stating(
        low_battery=LowBatteryFailsafe(action="return", at=0.1), pose_lost=PoseLostFailsafe(action="hold")
    )
    lines = found(setup=returns, platform=nothing)
    assert lines["failsafes: low battery"].verdict is Verdict.RED
    assert lines["failsafes: position lost"].verdict is Verdict.RED


def test_a_station_failsafe_that_leaves_offboard_alone_does_nothing_for_us() -> None:
    exempt = setup(set={"NAV_DLL_ACT": 2.0, "COM_DLL_EXCEPT": 4.0})
    assert found(setup=exempt)["failsafes: link loss"].verdict is Verdict.OK


def test_sensors_that_are_used_and_not_well_are_named() -> None:
    line = found(setup=setup(sensors_health=WELL & ~4))["sensors: autopilot's sensors"]
    assert (line.verdict, line.finding) == (Verdict.RED, "not well: compass")
    unused = found(setup=setup(sensors_health=WELL & ~32, sensors_enabled=WELL & ~32))
    assert unused["sensors: autopilot's sensors"].verdict is Verdict.OK
    logging = found(setup=setup(sensors_present=WELL | 1 << 24, sensors_enabled=WELL | 1 << 24))
    assert logging["sensors: also not well"].verdict is Verdict.WARNING


def test_a_sensor_that_was_never_calibrated_is_red() -> None:
    line = found(setup=setup(set={"CAL_MAG0_ID": 0.0}))["sensors: calibration"]
    assert (line.verdict, line.finding) == (Verdict.RED, "never calibrated: compass")


def test_arming_checks_that_are_left_out_are_a_warning_by_either_name() -> None:
    for name, value in (("ARMING_SKIPCHK", 1.0), ("ARMING_CHECK", 16.0)):
        parameters = {k: v for k, v in PARAMETERS[Style.ARDUPILOT].items() if k != "ARMING_SKIPCHK"}
        lines = found(Style.ARDUPILOT, setup=setup(Style.ARDUPILOT, parameters={**parameters, name: value}))
        assert lines["autopilot: arming checks"].verdict is Verdict.WARNING


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"pose": None}, Verdict.RED),
        ({"is_pose_fresh": False}, Verdict.RED),
        ({"pose": msgspec.structs.replace(POSE, quality=0.2)}, Verdict.WARNING),
    ],
)
def test_a_position_that_is_missing_old_or_poor_is_told(changes: dict[str, Any], verdict: Verdict) -> None:
    assert found(**changes)["sensors: position"].verdict is verdict


@pytest.mark.parametrize(
    ("changes", "line", "verdict"),
    [
        ({"disk_free_mb": 100.0}, "disk", Verdict.RED),
        ({"disk_free_mb": 1500.0}, "disk", Verdict.WARNING),
        ({"disk_problem": "out cannot be written: Permission denied"}, "disk", Verdict.RED),
        ({"disk_write_mb_s": 0.5}, "disk speed", Verdict.RED),
        ({"disk_write_mb_s": 3.0}, "disk speed", Verdict.WARNING),
        ({"disk_write_mb_s": 0.0}, "disk speed", Verdict.UNKNOWN),
        ({"log_mb_per_min": 100.0}, "log", Verdict.OK),
        ({"log_mb_per_min": 1_000.0}, "log", Verdict.WARNING),
        ({"log_mb_per_min": 10_000.0}, "log", Verdict.RED),
        ({"log_problem": "the log cannot be written: no space"}, "log", Verdict.RED),
        ({"utc_minus_t_s": 1010.0}, "clock", Verdict.WARNING),
        ({"utc_minus_t_s": None}, "clock", Verdict.UNKNOWN),
    ],
)
def test_the_computer_is_looked_at(changes: dict[str, Any], line: str, verdict: Verdict) -> None:
    check = found(computer=changes)[f"computer: {line}"]
    assert check.verdict is verdict
    assert bool(check.advice) is (verdict in (Verdict.RED, Verdict.WARNING))


def test_the_growth_of_the_log_and_the_room_for_it_are_told() -> None:
    check = found(computer={"log_mb_per_min": 1_000.0})["computer: log"]
    assert check.finding == "is being written: 1000.0 MB/min, room for 50 min"
    check = found(computer={"log_mb_per_min": 12.34})["computer: log"]
    assert check.finding == "is being written: 12.3 MB/min, room for 68 h"


@pytest.mark.parametrize(
    ("problem", "advice"),
    [
        ("could not open port /dev/ttyACM0: Permission denied", "dialout"),
        ("could not open port /dev/ttyACM0: No such file or directory", "plugged in"),
        ("the address is in use", "another program"),
        ("nothing is received there", "cable"),
    ],
)
def test_a_port_says_what_is_the_matter_and_what_to_do(problem: str, advice: str) -> None:
    line = found(computer={"links": [LinkCondition("serial:///dev/ttyACM0", problem)]})
    assert advice in line["computer: port"].advice


def test_a_second_autopilot_of_the_same_id_is_red() -> None:
    intruder = "10.0.0.9:5 claims to be autopilot 1/1; give each vehicle an id of its own"
    check = found(computer={"links": [LinkCondition("udpin://0.0.0.0:14540", "", intruder=intruder)]})["computer: port"]
    assert check.verdict is Verdict.RED
    assert check.finding == "udpin://0.0.0.0:14540: 10.0.0.9:5 claims to be autopilot 1/1"
    assert check.advice == "give each vehicle an id of its own"


def test_components_that_are_not_well_are_named_with_their_errors() -> None:
    def one(name: str, health: Health, *, is_required: bool = False, is_standby: bool = False) -> ComponentCondition:
        return ComponentCondition(
            name=name, health=health, is_required=is_required, is_standby=is_standby, cause="no frame"
        )

    lines = found(
        components=[
            one("pose", Health.FAULTY, is_required=True),
            one("camera", Health.FAULTY),
            one("limiter_standby", Health.QUIET, is_standby=True),
            one("limiter", Health.QUIET, is_required=True),
        ]
    )
    verdicts = {title: line.verdict for title, line in lines.items() if title.startswith("components")}
    assert verdicts == {
        "components: pose": Verdict.RED,
        "components: camera": Verdict.WARNING,
        "components: limiter": Verdict.RED,
    }
    assert "no frame" in lines["components: pose"].finding


def test_a_list_is_summed_up_worst_first_and_kept_in_order() -> None:
    lines = list(found(state={"battery_remaining": 0.1}, computer={"disk_free_mb": 1500.0}).values())
    assert summary(lines).startswith("1 red, 1 warning, 1 unknown, ")
    assert worst(lines) is Verdict.RED
    assert in_order(lines[::-1])[0].group == "autopilot"
    assert worst([]) is Verdict.OK


def with_hosts() -> Any:
    rows = tuple(
        msgspec.structs.replace(row, host="vision") if row.name == "limiter" else row for row in PELICAN.components
    )
    hosts = {"vehicle": HostRow(), "vision": HostRow(), "base": HostRow()}
    return msgspec.structs.replace(PELICAN, hosts=hosts, components=rows)


def host(name: str, **reported: Any) -> HostPresence:
    known = {"clock_bound_s": 0.002, "clock_age_s": 1.0, **own_software()._asdict(), **reported}
    status = HostStatus(host=name, is_clock_host=False, processes=[], **known)
    return HostPresence(host=name, is_here=True, status=status)


def test_another_host_is_here_speaks_as_we_do_and_knows_the_time() -> None:
    lines = found(platform=with_hosts(), hosts={"vision": host("vision"), "base": host("base")})
    assert lines["components: host vision"].verdict is Verdict.OK
    assert lines["components: host vision: time"].finding == "to within 2.0 ms, measured 1 s ago"
    assert "components: host vehicle" not in lines, "it is the one that looks"


def test_a_host_that_is_away_is_red_where_a_required_component_is_on_it() -> None:
    lines = found(platform=with_hosts(), hosts={"vision": HostPresence(host="vision", is_here=False)})
    assert lines["components: host vision"].verdict is Verdict.RED
    assert "--host vision" in lines["components: host vision"].advice
    assert lines["components: host base"].verdict is Verdict.WARNING


def test_a_host_that_speaks_differently_is_red_and_one_that_knows_the_time_badly_is_doubted() -> None:
    known = {"vision": host("vision", protocol="0badc0de"), "base": host("base", clock_bound_s=0.05)}
    lines = found(platform=with_hosts(), hosts=known)
    assert lines["components: host vision"].verdict is Verdict.RED
    assert lines["components: host base: time"].verdict is Verdict.WARNING


def test_a_remote_id_that_is_not_good_to_arm_is_red_and_one_that_is_silent_for_ever_is_no_line() -> None:
    assert "autopilot: remote id" not in found()
    good, bad = (
        found(setup=setup(remote_id=problem))["autopilot: remote id"] for problem in ("", "operator location missing")
    )
    assert (good.verdict, good.finding) == (Verdict.OK, "good to arm")
    assert (bad.verdict, bad.finding) == (Verdict.RED, "not good to arm: operator location missing")
    assert bad.advice
