"""Some of the flights of `make evidence NAME=autopilot-cases`: PX4's cases in virtual time, and mavsdk's over a socket."""

from tests.evidence.cases.mavsdk_flights import (
    pytestmark,
    test_a_mission_is_paused_goes_on_and_returns_at_its_end,
    test_actions_in_flight,
    test_ardupilot_believes_vision_odometry_and_motion_capture,
    test_offboard_in_every_form,
    test_px4_believes_vision_and_odometry_but_no_motion_capture,
)
from tests.evidence.cases.px4_led import (
    test_flying_forward_by_hand,
    test_offboard_attitude_control_flies_forward,
    test_offboard_is_refused_without_setpoints_and_a_loss_is_acted_on,
    test_offboard_position_control,
)
from tests.evidence.cases.px4_missions import (
    test_a_pause_on_the_way_brakes_and_holds_near_by,
    test_a_square_mission_with_a_return_at_its_end,
    test_a_waypoint_that_was_missed_is_reached_again_after_home_has_moved,
    test_setting_the_current_item_to_a_jump_flies_on,
)
from tests.evidence.cases.px4_trouble import (
    test_it_flies_on_when_the_barometer_fails_in_a_mission,
    test_it_flies_on_when_the_magnetometer_fails_in_a_mission,
    test_it_lands_when_gps_is_lost_in_a_mission,
    test_it_returns_to_the_rally_point_that_is_closer,
)

__all__ = [
    "pytestmark",
    "test_a_mission_is_paused_goes_on_and_returns_at_its_end",
    "test_a_pause_on_the_way_brakes_and_holds_near_by",
    "test_a_square_mission_with_a_return_at_its_end",
    "test_a_waypoint_that_was_missed_is_reached_again_after_home_has_moved",
    "test_actions_in_flight",
    "test_ardupilot_believes_vision_odometry_and_motion_capture",
    "test_flying_forward_by_hand",
    "test_it_flies_on_when_the_barometer_fails_in_a_mission",
    "test_it_flies_on_when_the_magnetometer_fails_in_a_mission",
    "test_it_lands_when_gps_is_lost_in_a_mission",
    "test_it_returns_to_the_rally_point_that_is_closer",
    "test_offboard_attitude_control_flies_forward",
    "test_offboard_in_every_form",
    "test_offboard_is_refused_without_setpoints_and_a_loss_is_acted_on",
    "test_offboard_position_control",
    "test_px4_believes_vision_and_odometry_but_no_motion_capture",
    "test_setting_the_current_item_to_a_jump_flies_on",
]
