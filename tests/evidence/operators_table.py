"""What operators expect of a ground station: each feature with the journey that shows ours, and where others have theirs."""

import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from typing import Final, NamedTuple

from tests.evidence.page import ROOT, Bar, Figure, Progress

LEAST: Final = 40
UNKNOWN: Final = "not verified"


class Feature(NamedTuple):
    """One feature; of other programs the file of their source that has it, as far as it was looked up."""

    name: str
    journey: str
    """The test that shows ours, below `tests`; empty where we do not have it."""
    qgroundcontrol: str = ""
    mission_planner: str = ""
    mavproxy: str = ""


FLY: Final = "GCSViews/FlightData.cs"
PLAN: Final = "GCSViews/FlightPlanner.cs"
STATE: Final = "ExtLibs/ArduPilot/CurrentState.cs"
CONFIG: Final = "GCSViews/ConfigurationView"
GUIDED: Final = "src/FlyView/GuidedActionsController.qml"
FACTS: Final = "src/Vehicle/FactGroups"
SERVICES: Final = "groundstation/services"
TUI: Final = "groundstation/tui"
SCREENS: Final = f"{TUI}/screens"
KEYS: Final = f"{TUI}/test_bare_vehicle_journey.py"
SITL: Final = f"{SERVICES}/test_services_with_sitl.py"
PLACES: Final = f"{TUI}/test_rally_and_home_journey.py"
EDIT: Final = f"{SCREENS}/test_map_edit.py"
READINGS: Final = "groundstation/station/test_readings.py"
FEATURES: Final = (
    # name, our journey, QGroundControl, Mission Planner, MAVProxy
    Feature("arm, disarm and change the mode of any PX4 or ArduPilot", KEYS, GUIDED, FLY, "mavproxy_arm.py"),
    Feature(
        "take-off, hold, return and landing without a companion",
        f"{SERVICES}/test_actions_with_sitl.py",
        "src/FlyView/GuidedActionTakeoff.qml",
        FLY,
        "mavproxy_mode.py",
    ),
    Feature(
        "start and pause of a plan on the autopilot",
        f"{SERVICES}/test_actions_with_sitl.py",
        GUIDED,
        FLY,
        "mavproxy_wp.py",
    ),
    Feature("hold, return and landing in place of a dead companion", "commands/test_a_companion_dies.py"),
    Feature(
        "emergency hold by one key on every screen",
        f"{TUI}/test_terminal.py::test_the_emergency_key_holds_at_once_offers_more_when_pressed_again_and_leaving_is_asked",
    ),
    Feature(
        "plans uploaded, read back, compared and cleared",
        f"{SITL}::test_a_plan_is_uploaded_verified_downloaded_and_cleared",
        "src/MissionManager/PlanMasterController.h",
        PLAN,
        "mavproxy_wp.py",
    ),
    Feature(
        "missions as partial orders of tasks",
        f"{TUI}/test_operator_journeys.py::test_a_mission_is_opened_checked_mended_streamed_flown_paused_resumed_and_aborted",
    ),
    Feature(
        "mission check with line and column",
        f"{SCREENS}/test_mission_screen.py::test_an_error_is_shown_at_its_line_mended_saved_and_what_is_not_saved_is_asked_about",
    ),
    Feature(
        "warning of a distant first waypoint",
        f"{TUI}/test_operator_journeys.py::test_a_mission_that_begins_kilometres_away_is_asked_about_before_it_is_uploaded",
    ),
    Feature(
        "heights above terrain tiles",
        "common/mission/test_missions_over_terrain.py",
        "src/Terrain/TerrainQuery.h",
        "ExtLibs/Utilities/srtm.cs",
        "mavproxy_terrain.py",
    ),
    Feature(
        "waypoints and the fence edited on the map",
        EDIT,
        "src/MissionManager/GeoFenceController.h",
        PLAN,
        "mavproxy_misseditor",
    ),
    Feature(
        "rally points edited on the map, uploaded and read back",
        PLACES,
        "src/MissionManager/RallyPointController.h",
        PLAN,
        "mavproxy_rally.py",
    ),
    Feature("home moved on the map", PLACES, GUIDED, FLY, "mavproxy_map"),
    Feature(
        "GPX routes as plans",
        "groundstation/missions/test_plan_formats_of_plug_ins.py",
        "src/MissionManager/PlanShapes/GPX/GpxPlanImporter.h",
    ),
    Feature("a survey drawn on the map", EDIT, "src/MissionManager/SurveyComplexItem.h", "Grid/GridUI.cs"),
    Feature("go to a place on the map", EDIT, "src/FlyView/FlyViewMapClickDropPanel.qml", FLY, "mavproxy_mode.py"),
    Feature(
        "street or satellite tiles",
        "groundstation/web/test_tiles.py",
        "src/AppSettings/OfflineMapSettings.qml",
        PLAN,
        "mavproxy_map",
    ),
    Feature(
        "pre-flight list with reasons",
        f"{SCREENS}/test_checks_screen.py",
        "src/FlyView/PreFlightCheckList.qml",
        "Controls/PreFlight/CheckListControl.cs",
        "mavproxy_checklist.py",
    ),
    Feature("GPS fix, satellites and HDOP", READINGS, f"{FACTS}/VehicleGPSFactGroup.h", STATE, "mavproxy_console.py"),
    Feature(
        "estimator variances and vibration", READINGS, f"{FACTS}/VehicleVibrationFactGroup.h", "Controls/Vibration.cs"
    ),
    Feature("RC and radio signal strength", READINGS, f"{FACTS}/RadioStatusFactGroup.h", STATE),
    Feature(
        "flight time and distance home",
        f"{READINGS}::test_a_flight_is_timed_from_take_off_to_landing",
        f"{FACTS}/VehicleFactGroup.h",
        STATE,
    ),
    Feature("battery in V, A and mAh", READINGS, f"{FACTS}/VehicleBatteryFactGroup.h", STATE, "mavproxy_battery.py"),
    Feature(
        "attitude indicator",
        "groundstation/tui/views/test_flight_data.py",
        "src/FlightMap/Widgets/QGCAttitudeWidget.qml",
        "ExtLibs/Controls/HUD.cs",
        "mavproxy_horizon.py",
    ),
    Feature(
        "alerts that stay until they are acknowledged",
        f"{TUI}/test_terminal.py::test_an_alert_stands_on_every_screen_until_it_is_acknowledged",
    ),
    Feature(
        "speech",
        "groundstation/announcing/test_announced_in_a_terminal.py",
        "src/Utilities/Audio/AudioOutput.h",
        "Utilities/Speech.cs",
        "mavproxy_speech.py",
    ),
    Feature(
        "parameters edited within their bounds",
        f"{SCREENS}/test_services_screen.py::test_a_parameter_is_searched_edited_within_its_bounds_and_marked",
        "src/FactSystem/ParameterManager.h",
        f"{CONFIG}/ConfigRawParams.cs",
        "mavproxy_param.py",
    ),
    Feature(
        "descriptions of parameters as delivered and of the vehicle",
        f"{SITL}::test_parameters_are_described_by_the_vehicle_or_by_what_is_shipped",
        "src/Vehicle/ComponentInformation/CompInfoParam.h",
        "ExtLibs/Utilities/ParameterMetaDataRepository.cs",
        "lib/param_help.py",
    ),
    Feature(
        "a file of parameters compared before it is written",
        f"{SCREENS}/test_services_screen.py::test_a_file_is_compared_first_and_only_what_is_not_left_out_is_written",
        "src/QmlControls/ParameterDiffDialog.qml",
        "Controls/paramcompare.cs",
        "mavproxy_param.py",
    ),
    Feature(
        "calibration of sensors",
        f"{SERVICES}/test_calibration_service.py",
        "src/AutoPilotPlugins/Common/Sensors/SensorCalibrationControllerBase.h",
        f"{CONFIG}/ConfigAccelerometerCalibration.cs",
        "mavproxy_calibration.py",
    ),
    Feature(
        "motor test",
        f"{TUI}/test_services_journey.py::test_a_motor_is_tested_by_keys_after_a_typed_confirmation",
        "src/AutoPilotPlugins/Common/MotorComponent.qml",
        f"{CONFIG}/ConfigMotorTest.cs",
    ),
    Feature(
        "calibration of RC and ESCs",
        f"{SERVICES}/test_radio_and_esc_calibration.py",
        "src/AutoPilotPlugins/Common/RadioComponent.qml",
        f"{CONFIG}/ConfigRadioInput.cs",
        "mavproxy_rcsetup.py",
    ),
    Feature(
        "console of the autopilot",
        f"{TUI}/test_services_journey.py::test_commands_are_typed_into_the_shell_of_px4_by_keys",
        "src/AnalyzeView/MAVLinkConsole/MAVLinkConsolePage.qml",
        f"{CONFIG}/ConfigTerminal.cs",
        "mavproxy_nsh.py",
    ),
    Feature(
        "logs downloaded, resumed where they were cut off",
        f"{SCREENS}/test_services_screen.py::test_a_log_is_downloaded_cancelled_and_taken_up_again_while_another_service_is_looked_at",
        "src/AnalyzeView/OnboardLogs/OnboardLogPage.qml",
        "Log/LogDownloadMavLink.cs",
        "mavproxy_log.py",
    ),
    Feature(
        "files over MAVLink FTP",
        f"{SCREENS}/test_services_screen.py::test_files_are_walked_downloaded_and_removed_after_a_question",
        "src/Vehicle/FTP/FTPManager.h",
        "Controls/MavFTPUI.cs",
        "mavproxy_ftp.py",
    ),
    Feature(
        "rates of messages, measured and requested",
        f"{SERVICES}/test_rate_service.py",
        "src/AnalyzeView/MAVLinkInspector/MAVLinkInspectorPage.qml",
        "Controls/MAVLinkInspector.cs",
        "mavproxy_messagerate.py",
    ),
    Feature(
        "firmware flashing",
        "",
        "src/Vehicle/VehicleSetup/FirmwareUpgradeController.h",
        f"{CONFIG}/ConfigFirmwareManifest.cs",
        "mavproxy_firmware.py",
    ),
    Feature(
        "joysticks of any make",
        "groundstation/joysticks/test_readers.py",
        "src/Joystick/Joystick.h",
        "Joystick/JoystickSetup.cs",
        "mavproxy_joystick",
    ),
    Feature(
        "pictures of a camera in a terminal, as large as the link affords",
        f"{SCREENS}/test_sensors_screen.py::test_a_camera_is_shown_as_a_picture_at_a_size_that_the_link_affords",
        "",
    ),
    Feature(
        "pictures of a camera as pictures, in colour",
        "groundstation/web/test_pictures.py",
        "src/VideoManager/VideoManager.h",
        "Controls/Video.cs",
        "mavproxy_cameraview.py",
    ),
    Feature("gimbal", "", "src/Gimbal/GimbalController.h", "Controls/GimbalVideoControl.cs", "mavproxy_gimbal.py"),
    Feature(
        "traffic near the vehicle",
        "groundstation/traffic/test_traffic.py",
        "src/ADSB/ADSBVehicleManager.h",
        "ExtLibs/Utilities/adsb.cs",
        "mavproxy_adsb.py",
    ),
    Feature(
        "Remote ID of the vehicle",
        "flight/test_preflight.py",
        "src/Vehicle/RemoteIDManager.h",
        "ExtLibs/ArduPilot/OpenDroneID.cs",
        "mavproxy_OpenDroneID.py",
    ),
    Feature(
        "RTK corrections",
        "groundstation/corrections/test_corrections_over_sockets.py",
        "src/AppSettings/NTRIPConnectionSettings.qml",
        f"{CONFIG}/ConfigSerialInjectGPS.cs",
        "mavproxy_ntrip.py",
    ),
    Feature(
        "frames forwarded to another station",
        "groundstation/links/test_forwarding.py",
        "src/Comms/LinkManager.h",
        "Controls/SerialOutputPass.cs",
        "mavproxy_output.py",
    ),
    Feature(
        "one order to several vehicles",
        f"{SCREENS}/test_fleet_screen.py::test_marked_vehicles_are_ordered_together_after_a_question_that_names_them",
        "src/FlyView/MultiVehicleList.qml",
        "Swarm/Swarm.cs",
        "mavproxy_swarm.py",
    ),
    Feature(
        "control handed over between stations",
        f"{SCREENS}/test_fleet_screen.py::test_control_of_a_second_vehicle_is_requested_and_granted_between_two_stations",
        "src/Vehicle/GCSControlManager.h",
    ),
    Feature(
        "signed links",
        "onboard/autopilot/test_signed_vehicle.py",
        "src/AppSettings/SigningKeyManager.qml",
        "Controls/AuthKeys.cs",
        "mavproxy_signing.py",
    ),
    Feature(
        "recording that other programs read",
        "groundstation/store/test_recording.py",
        "src/Comms/LogReplayLink.h",
        "Log/LogBrowse.cs",
        "mavproxy_log.py",
    ),
    Feature(
        "screens and rules of other packages",
        f"{TUI}/test_plug_ins.py",
        "src/API/QGCCorePlugin.h",
        "Plugin/PluginLoader.cs",
        "mavproxy_example.py",
    ),
    Feature("scripts", "commands/test_examples_of_scripts.py", "", "Script.cs"),
    Feature("a terminal of 80 x 24 over SSH", f"{TUI}/test_real_terminal_journey.py", "", "", "../mavproxy.py"),
    Feature("browser, phone and touch", "groundstation/web/test_browser_journey.py"),
)
"""In the order of a flight: before it, in the air, after it, and around it."""


def ours(feature: Feature) -> str:
    """The last line of the journey's test."""
    called = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"tests/{feature.journey}"]
    ended = subprocess.run(called, cwd=ROOT, check=False, capture_output=True, text=True)
    last = (ended.stdout.strip().splitlines() or [ended.stderr])[-1]
    return last if ended.returncode == 0 else f"not so: {last}"


def run(progress: Progress) -> Sequence[Figure]:
    """The figures."""
    figures = [Figure("features", str(len(FEATURES)), f"≥ {LEAST}", len(FEATURES) >= LEAST)]
    for number, feature in enumerate(FEATURES, 1):
        others = (
            ("QGroundControl", feature.qgroundcontrol),
            ("Mission Planner", feature.mission_planner),
            ("MAVProxy", feature.mavproxy),
        )
        cells = "; ".join(f"{name}: {f'`{where}`' if where else UNKNOWN}" for name, where in others)
        if not feature.journey:
            figures.append(Figure(feature.name, f"ours: no; {cells}"))
            continue
        said = progress.part(feature.journey, partial(ours, feature))
        progress.report(f"{number} of {len(FEATURES)}: {feature.name}: {said}")
        is_met = not said.startswith("not so")
        figures.append(Figure(feature.name, f"ours: {said}; {cells}", f"`tests/{feature.journey}` passes", is_met))
    return figures


BARS = (
    Bar(
        "operators-table",
        "The features that operators know from other ground stations are there, each shown by a test",
        "The features are those that operators of QGroundControl, Mission Planner and MAVProxy know. For each of ours "
        "a test was run that shows it. For the other programs the cell names a file of their public source that has "
        "it (QGroundControl's repository; Mission Planner at `a2fcd74d`; MAVProxy, below `MAVProxy/modules`, at "
        "`f76c4d3d`), found by reading, not by running them. *Not verified* means that nothing was looked up: it does "
        "not mean that they lack it.",
        run,
    ),
)
