"""What the real firmwares do, and whether the embedded autopilot does it too: each row with the tests that show it."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from tests.evidence.page import Bar, Figure, Progress
from tests.evidence.suites import run_tests

FOLDER: Final = "tests/sitl/autopilot"


class FirmwareModel(NamedTuple):
    """A behaviour of a real firmware."""

    family: str
    behaviour: str
    tests: tuple[str, ...]
    """`FILE::NAME` in `FOLDER`; empty where the embedded autopilot does not have it."""
    instead: str = ""
    """What stands in its place there."""


MODELS: Final = (
    FirmwareModel(
        "PX4",
        "stands in Offboard after a landing from it, and arms then only with a stream or in another mode",
        (
            "test_flying_basics.py::test_px4_stands_in_offboard_after_landing_from_it_and_arms_only_in_another_mode_or_with_a_stream",
            "test_failsafes.py::test_px4_that_landed_because_the_setpoints_were_lost_stands_in_offboard",
        ),
    ),
    FirmwareModel(
        "PX4",
        "keeps the last intended mode that can arm after disarming",
        ("test_flying_basics.py::test_px4_stands_in_its_hold_after_a_landing_that_began_there",),
    ),
    FirmwareModel(
        "PX4",
        "accepts any mode while disarmed, and refuses to arm in one that cannot fly",
        (
            "test_missions_and_fences.py::test_mission_mode_without_a_mission_is_refused_in_flight_and_px4_takes_it_on_the_ground_and_does_not_arm",
            "test_health_report.py::test_a_mode_that_cannot_be_armed_in_is_a_reason_only_while_it_is_the_current_one",
        ),
    ),
    FirmwareModel(
        "PX4",
        "enters Offboard on a stream of 2 Hz and more, and leaves it after COM_OF_LOSS_T",
        (
            "test_failsafes.py::test_px4_does_not_enter_offboard_without_a_stream",
            "test_failsafes.py::test_px4_does_not_enter_offboard_on_a_stream_below_two_hertz",
            "test_failsafes.py::test_px4_leaves_offboard_one_second_after_the_last_setpoint",
        ),
    ),
    FirmwareModel(
        "PX4",
        "keeps the intention after an offboard loss: it flies Offboard again by itself 1 s after setpoints are back",
        ("test_failsafes.py::test_px4_flies_offboard_again_a_second_after_the_setpoints_are_back",),
    ),
    FirmwareModel(
        "PX4",
        "gives that intention up when Hold is commanded",
        ("test_failsafes.py::test_px4_stays_in_a_hold_that_was_commanded_after_the_setpoints_were_lost",),
    ),
    FirmwareModel(
        "PX4",
        "hands over to a pilot when setpoints end, with COM_OBL_RC_ACT 0",
        ("test_failsafes.py::test_px4_hands_over_to_a_pilot_who_is_there_when_setpoints_end",),
    ),
    FirmwareModel(
        "PX4",
        "aligns its heading (yaw_align) by ODOMETRY in LOCAL_NED, and not in LOCAL_FRD: no global position then, no arming in Hold",
        (
            "test_odometry_from_outside.py::test_px4_does_not_align_its_heading_by_odometry_in_a_frame_of_its_own",
            "test_odometry_from_outside.py::test_px4_believes_a_heading_in_the_north_frame_alone_and_takes_off_and_holds_by_it",
        ),
    ),
    FirmwareModel(
        "PX4",
        "reports the previous plan's item in MISSION_CURRENT, clamped, until one of the new plan is set or begun",
        (
            "test_missions_and_fences.py::test_px4_reports_the_item_of_the_previous_plan_until_one_of_the_new_plan_is_set",
            "test_missions_and_fences.py::test_px4_begins_a_new_plan_at_its_first_item_whatever_it_has_reported",
        ),
    ),
    FirmwareModel(
        "PX4",
        "refuses an interval for MISSION_CURRENT",
        (
            "test_mavlink_front_end.py::test_px4_refuses_another_rate_for_its_current_mission_item_and_goes_on_at_its_own",
        ),
    ),
    FirmwareModel(
        "PX4",
        "sends GPS_GLOBAL_ORIGIN when it changes and on request, never at an interval",
        (
            "test_mavlink_front_end.py::test_px4_sends_its_origin_when_it_changes_and_on_request_and_never_at_an_interval",
        ),
    ),
    FirmwareModel(
        "PX4",
        "explains a refused arming by EVENTs with metadata, not by texts",
        (
            "test_health_report.py::test_a_refused_arming_is_explained_by_events_and_not_by_a_text",
            "test_health_report.py::test_the_metadata_names_every_event_and_the_modes_of_each_bit",
            "test_health_report.py::test_missed_events_are_sent_again_on_request_and_those_that_are_gone_are_named",
        ),
    ),
    FirmwareModel(
        "PX4",
        "answers RUN_PREARM_CHECKS with an acknowledgement and its report, and no text",
        ("test_health_report.py::test_the_checks_on_request_answer_with_an_ack_and_the_report_and_no_text",),
    ),
    FirmwareModel(
        "PX4",
        "acknowledges a plan without the items of MIS_TKO_LAND_REQ, and does not arm or take off with it",
        (
            "test_missions_and_fences.py::test_px4_acknowledges_a_plan_without_the_required_items_and_does_not_arm_with_it",
            "test_missions_and_fences.py::test_px4_takes_off_for_no_plan_without_the_required_landing",
        ),
    ),
    FirmwareModel(
        "PX4",
        "acts at its fence by GF_ACTION alone, and has no command for it",
        (
            "test_missions_and_fences.py::test_px4_has_no_command_for_its_fence",
            "test_failsafes.py::test_px4_acts_at_the_height_of_its_fence",
        ),
    ),
    FirmwareModel(
        "PX4",
        "acknowledges a position beyond a fence at which it acts, holds, and says so in a text",
        ("test_missions_and_fences.py::test_px4_holds_and_says_so_where_it_is_sent_beyond_a_fence_at_which_it_acts",),
    ),
    FirmwareModel(
        "PX4",
        "does nothing about a lost station by default; set to return, it holds for COM_FAIL_ACT_T first",
        (
            "test_failsafes.py::test_px4_does_nothing_about_a_lost_station_by_default",
            "test_failsafes.py::test_px4_holds_for_five_seconds_and_returns_when_the_station_is_lost",
            "test_failsafes.py::test_px4_counts_any_ground_station_but_not_a_companion",
        ),
    ),
    FirmwareModel(
        "PX4",
        "lets nobody change the rate of its heartbeat",
        ("test_mavlink_front_end.py::test_px4_lets_nobody_change_the_rate_of_its_heartbeat",),
    ),
    FirmwareModel(
        "PX4",
        "planes circle down in Land wherever they are",
        (),
        "there is no plane in PX4's style; the driver's steps are tested against a scripted one",
    ),
    FirmwareModel(
        "PX4",
        "planes are taken for landed only while they turn slower than LNDFW_ROT_MAX, which the noise of SIH's gyros exceeds",
        (),
        "there is no plane in PX4's style; a landing that does not end is tested with MPC_THR_MIN 0.3 and COM_DISARM_LAND -1 (tests/flight)",
    ),
    FirmwareModel(
        "PX4",
        "overshoots corners by 0.8 to 1.2 m, for 6 to 9 s, with plain satellites",
        (),
        "overshoots less; its simulated receiver is of RTK grade unless plain satellites are chosen",
    ),
    FirmwareModel(
        "ArduPilot",
        "ignores ODOMETRY in any frame but LOCAL_FRD",
        ("test_odometry_from_outside.py::test_ardupilot_ignores_other_frames_and_px4_refuses_other_estimators",),
    ),
    FirmwareModel(
        "ArduPilot",
        "stays in LAND after it has landed and disarmed",
        ("test_flying_basics.py::test_ardupilot_stays_in_land_after_it_has_landed",),
    ),
    FirmwareModel(
        "ArduPilot",
        "ends a streamed velocity after GUID_TIMEOUT",
        ("test_failsafes.py::test_ardupilot_stops_a_velocity_three_seconds_after_it_was_sent_last",),
    ),
    FirmwareModel(
        "ArduPilot",
        "gives its home as item 0, always readable, and counts no item without a mission",
        (
            "test_missions_and_fences.py::test_an_ardupilot_without_a_mission_counts_no_item_and_gives_its_home_as_item_0",
            "test_missions_and_fences.py::test_ardupilot_puts_home_in_the_place_of_item_0",
        ),
    ),
    FirmwareModel(
        "ArduPilot",
        "does nothing at an uploaded fence until it is switched on, and reports it as off where it only reports breaches",
        (
            "test_missions_and_fences.py::test_an_uploaded_fence_does_nothing_in_ardupilot_until_it_is_switched_on",
            "test_missions_and_fences.py::test_a_fence_that_only_reports_shows_as_off_in_ardupilot",
            "test_missions_and_fences.py::test_a_closed_area_counts_in_ardupilot_when_the_fence_is_on",
        ),
    ),
    FirmwareModel(
        "ArduPilot",
        "turns its nose on CONDITION_YAW (setyaw), as Copter and Sub; Plane, Rover and PX4 do not know it",
        (
            "test_services_of_the_bench.py::test_copter_turns_its_nose_on_condition_yaw",
            "test_services_of_the_bench.py::test_px4_and_planes_know_no_condition_yaw_outside_a_mission",
        ),
    ),
    FirmwareModel(
        "ArduPilot",
        "packs its parameters into @PARAM/param.pck, whole or by a query, with defaults on request",
        (
            "test_logs_and_files.py::test_ardupilot_packs_its_parameters_into_a_file",
            "test_logs_and_files.py::test_ardupilot_packs_the_part_of_its_parameters_that_is_asked_for_with_their_defaults",
        ),
    ),
    FirmwareModel(
        "ArduPilot",
        "serves @SYS files that are shorter than reported",
        ("test_logs_and_files.py::test_ardupilot_tells_its_links_in_a_file_whose_size_it_does_not_know",),
    ),
    FirmwareModel(
        "ArduPilot",
        "requests the positions of its accelerometer calibration every second",
        (
            "test_services_of_the_bench.py::test_ardupilot_requests_each_position_of_its_accelerometer_every_second_until_it_is_confirmed",
        ),
    ),
    FirmwareModel(
        "ArduPilot",
        "acts on a voltage that stays low (BATT_LOW_VOLT), whatever charge is left",
        (
            "test_failsafes.py::test_ardupilot_acts_on_a_voltage_that_stays_low_whatever_charge_is_left",
            "test_failsafes.py::test_a_short_dip_of_the_voltage_is_no_failsafe",
        ),
    ),
    FirmwareModel(
        "ArduPilot",
        "minds the heartbeats of its own station (MAV_GCS_SYSID) alone",
        (
            "test_failsafes.py::test_ardupilot_only_minds_the_heartbeats_of_its_own_station",
            "test_failsafes.py::test_ardupilot_lands_when_its_own_station_falls_silent",
        ),
    ),
    FirmwareModel(
        "ArduPilot",
        "is silent until messages are asked for",
        (
            "test_mavlink_front_end.py::test_ardupilot_is_silent_until_it_is_asked",
            "test_mavlink_front_end.py::test_ardupilots_stream_parameters_change_every_link",
        ),
    ),
    FirmwareModel(
        "ArduPilot",
        "explains a refused arming by texts, and sends no events",
        ("test_health_report.py::test_ardupilot_explains_by_texts_and_sends_no_events",),
    ),
    FirmwareModel(
        "ArduPilot",
        "loads an uploaded fence a moment later, and refuses to enable one until then",
        ("test_missions_and_fences.py::test_ardupilot_loads_an_uploaded_fence_a_moment_later_and_has_none_until_then",),
    ),
    FirmwareModel(
        "ArduPilot",
        "reports a transition to wings for a moment when a quadplane begins to hover in Guided",
        ("test_vtols.py::test_ardupilot_reports_a_transition_for_a_moment_when_it_begins_to_hover_in_guided",),
    ),
    FirmwareModel(
        "ArduPilot",
        "repeats a configuration error and starts nothing until it is repaired",
        (),
        "its configuration is always right; the texts are tested against a scripted one",
    ),
)


def firmware_models(progress: Progress) -> Sequence[Figure]:
    """Runs the tests of all rows."""
    wanted = sorted({f"{FOLDER}/{test}" for model in MODELS for test in model.tests})
    found = progress.part("tests", lambda: run_tests("other-firmware-models", ["-n", "0", *wanted]))["outcomes"]
    return [_figure(model, found) for model in MODELS]


def _figure(model: FirmwareModel, found: dict[str, str]) -> Figure:
    """A row of the page: its tests, and whether every case of each has passed."""
    name = f"{model.family} {model.behaviour}"
    if not model.tests:
        return Figure(name, f"not modelled: {model.instead}")
    shown, is_met = [], True
    for test in model.tests:
        cases = [
            how for case, how in found.items() if case.partition(": ")[2].partition("[")[0] == test.partition("::")[2]
        ]
        passed = sum(how == "passed" for how in cases)
        is_met &= 0 < passed == len(cases)
        shown.append(f"`{test}` {passed} of {len(cases)}")
    return Figure(name, ", ".join(shown), "all pass", is_met)


BARS = (
    Bar(
        "other-firmware-models",
        "The embedded autopilot behaves as the real PX4 and ArduPilot were observed to",
        "Tests fly against the embedded autopilot. Each row is a behaviour observed in the real PX4 1.16 "
        f"(development) or ArduPilot 4.7 (development), with the tests in `{FOLDER}` that show it in the embedded "
        "autopilot, and how many of their cases pass. A row without tests says what replaces them.",
        firmware_models,
    ),
)
