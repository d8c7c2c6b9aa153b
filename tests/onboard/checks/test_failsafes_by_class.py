"""What the failsafe parameters of each class mean, held against a platform file that says that nothing is done."""

import msgspec
import pytest

from gloc3.messages.preflight import Verdict
from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import Style, VehicleClass
from gloc3.platform.platform import Failsafes
from gloc3.platform.reader import load_platform
from gloc3_onboard.autopilot import ardupilot, px4
from gloc3_onboard.checks.failsafes import failsafe_checks
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.tables import table_of

PLATFORMS = {VehicleClass.ROVER: "rover", VehicleClass.BOAT: "rover", VehicleClass.SUB: "submarine"}
QUIET = {
    "FS_GCS_ENABLE": 0, "FS_GCS_TIMEOUT": 5, "FS_GCS_ENABL": 0, "FS_LONG_ACTN": 0, "FS_LONG_TIMEOUT": 5, "FS_ACTION": 2,
    "BATT_FS_LOW_ACT": 0, "BATT_LOW_MAH": 0, "BATT_CAPACITY": 3300, "FS_EKF_ACTION": 0, "FS_PILOT_INPUT": 0,
    "GUID_TIMEOUT": 3, "ARMING_CHECK": 1,
}  # fmt: skip


def lines(vehicle: VehicleClass, **changes: float) -> dict[str, tuple[Verdict, str]]:
    names = table_of(Style.ARDUPILOT, vehicle).names()
    values = {name: float(value) for name, value in {**QUIET, **changes}.items() if name in names}
    setup = AutopilotSetup(style=Style.ARDUPILOT, vehicle=vehicle, parameters=values, is_complete=True)
    platform = load_platform(PLATFORMS.get(vehicle, "copter"))
    readings = Readings(platform=msgspec.structs.replace(platform, failsafes=Failsafes()), now_s=1.0, setup=setup)
    return {check.name: (check.verdict, check.finding) for check in failsafe_checks(readings)}


@pytest.mark.parametrize(
    ("vehicle", "changes", "line", "finding"),
    [
        (VehicleClass.ROVER, {"FS_GCS_ENABLE": 1}, "link loss", "hold after 5 s (FS_GCS_ENABLE 1)"),
        (VehicleClass.ROVER, {"FS_GCS_ENABLE": 2, "FS_ACTION": 1}, "link loss", "return after 5 s (FS_GCS_ENABLE 2)"),
        (VehicleClass.BOAT, {"FS_GCS_ENABLE": 1, "FS_ACTION": 5}, "link loss", "terminate after 5 s"),
        (VehicleClass.ROVER, {"BATT_FS_LOW_ACT": 1, "BATT_LOW_MAH": 660}, "low battery", "return at 20 %"),
        (VehicleClass.SUB, {"FS_GCS_ENABLE": 2}, "link loss", "disarm after 5 s (FS_GCS_ENABLE 2)"),
        (VehicleClass.SUB, {"FS_GCS_ENABLE": 4}, "link loss", "land after 5 s"),
        (VehicleClass.SUB, {"BATT_FS_LOW_ACT": 2}, "low battery", "disarm"),
        (VehicleClass.PLANE, {"FS_GCS_ENABL": 1, "FS_LONG_ACTN": 1}, "link loss", "return after 5 s (FS_GCS_ENABL 1)"),
        (VehicleClass.COPTER, {"FS_GCS_ENABLE": 1}, "link loss", "return after 5 s"),
    ],
)
def test_what_would_overrule_a_mission_is_red(
    vehicle: VehicleClass, changes: dict[str, float], line: str, finding: str
) -> None:
    verdict, found = lines(vehicle, **changes)[line]
    assert verdict is Verdict.RED
    assert found.startswith(finding)


@pytest.mark.parametrize("vehicle", ardupilot.CLASSES)
def test_what_does_nothing_agrees_with_a_platform_file_that_says_nothing(vehicle: VehicleClass) -> None:
    assert {name for name, (verdict, _) in lines(vehicle).items() if verdict is Verdict.RED} == set()


def test_an_action_that_is_switched_off_is_none() -> None:
    verdict, finding = lines(VehicleClass.ROVER, FS_ACTION=1)["link loss"]
    assert (verdict, finding) == (Verdict.OK, "continue (FS_GCS_ENABLE 0)")


def test_a_submarine_that_disarms_without_a_joystick_is_doubtful() -> None:
    verdict, finding = lines(VehicleClass.SUB, FS_PILOT_INPUT=2)["FS_PILOT_INPUT"]
    assert verdict is Verdict.WARNING
    assert "joystick" in finding


@pytest.mark.parametrize("style", Style)
def test_every_class_that_is_led_has_a_table_of_its_own_whose_names_fit_the_protocol(style: Style) -> None:
    classes = px4.CLASSES if style is Style.PX4 else ardupilot.CLASSES
    for vehicle in classes:
        names = table_of(style, vehicle).names()
        assert all(0 < len(name) <= 16 for name in names)
        assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("changes", "verdict", "finding"),
    [
        ({"BATT_FS_LOW_ACT": 2, "BATT_LOW_MAH": 0, "BATT_LOW_VOLT": 14.4}, Verdict.RED,
         "return at 14.4 V (BATT_LOW_VOLT) (BATT_FS_LOW_ACT 2); the platform file says continue"),
        ({"BATT_FS_LOW_ACT": 2, "BATT_LOW_MAH": 660, "BATT_LOW_VOLT": 14.4}, Verdict.RED,
         "return at 20 % or at 14.4 V (BATT_LOW_VOLT) (BATT_FS_LOW_ACT 2)"),
        ({"BATT_FS_LOW_ACT": 2, "BATT_LOW_MAH": 0, "BATT_LOW_VOLT": 0}, Verdict.OK,
         "continue: BATT_LOW_MAH and BATT_LOW_VOLT are 0 (BATT_FS_LOW_ACT 2)"),
    ],
)  # fmt: skip
def test_a_battery_failsafe_acts_at_a_charge_or_a_voltage_or_never(
    changes: dict[str, float], verdict: Verdict, finding: str
) -> None:
    found = lines(VehicleClass.COPTER, **changes)["low battery"]
    assert found[0] is verdict
    assert found[1].startswith(finding)
