"""Who has control: the pilot's changes, the autopilot's own, and ours, told apart by what we commanded."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.onboard.messages import at, autopilot_pose, flying, standing

from gloc3.messages.vehicle import AutopilotState, FlightMode, LandedState
from gloc3_onboard.components.drivers.pilot_watch import ANSWER_S, FOLLOWS, OURS, PilotWatch

HOLD, GUIDED, LAND, TAKE_OFF = FlightMode.HOLD, FlightMode.GUIDED, FlightMode.LAND, FlightMode.TAKE_OFF
MANUAL, RETURN, MISSION = FlightMode.MANUAL, FlightMode.RETURN, FlightMode.MISSION


class Story:
    """A watch, and a state every 0.2 s."""

    def __init__(self, first: AutopilotState | None = None) -> None:
        self.watch = PilotWatch()
        self.now_s = 0.0
        self.see(first or standing())

    def see(self, *states: AutopilotState, after_s: float = 0.2, **how: bool) -> bool:
        """Whether the pilot has control then."""
        for state in states:
            self.now_s += after_s
            self.watch.update(state, self.now_s, **how)
        return self.watch.has_control

    def poses(self, *at_s: float) -> None:
        """The autopilot's poses, as they come."""
        for t_s in at_s:
            self.now_s = t_s
            self.watch.received(at(t_s, autopilot_pose()), t_s)

    def command(self, mode: FlightMode) -> None:
        self.watch.command(mode, self.now_s)


def in_flight(mode: FlightMode = GUIDED) -> Story:
    """A flight of ours, in a mode that we commanded."""
    story = Story()
    story.watch.command_arm(story.now_s)
    story.command(mode)
    assert not story.see(standing(is_armed=True), flying(mode))
    return story


def test_a_whole_flight_of_ours_in_the_style_of_px4_is_ours() -> None:
    story = Story()
    story.watch.command_arm(story.now_s)
    assert not story.see(standing(HOLD, is_armed=True))
    story.command(TAKE_OFF)
    assert not story.see(flying(TAKE_OFF, landed=LandedState.TAKING_OFF), flying(TAKE_OFF))
    assert not story.see(flying(HOLD), may_settle=True)
    story.command(GUIDED)
    assert not story.see(flying(HOLD), flying(GUIDED))
    story.command(HOLD)
    assert not story.see(flying(HOLD))
    story.command(LAND)
    assert not story.see(flying(LAND, landed=LandedState.LANDING), standing(LAND, is_armed=True))
    assert not story.see(standing(HOLD))


def test_a_whole_flight_of_ours_in_the_style_of_ardupilot_is_ours() -> None:
    story = Story(standing(MANUAL))
    story.command(GUIDED)
    assert not story.see(standing(GUIDED))
    story.watch.command_arm(story.now_s)
    assert not story.see(standing(GUIDED, is_armed=True))
    story.command(TAKE_OFF)
    assert not story.see(flying(GUIDED))
    story.command(LAND)
    assert not story.see(flying(LAND), standing(LAND))
    assert not story.see(standing(MANUAL))


@pytest.mark.parametrize("ours", [GUIDED, HOLD, LAND, TAKE_OFF])
@pytest.mark.parametrize("theirs", [MANUAL, RETURN, MISSION, HOLD, LAND, GUIDED, FlightMode.OTHER])
def test_a_change_that_we_did_not_command_is_somebody_elses(ours: FlightMode, theirs: FlightMode) -> None:
    story = in_flight(ours)
    if theirs in FOLLOWS[ours]:
        return
    assert story.see(flying(theirs))
    assert story.watch.reason == f"mode {theirs} was chosen by another party"


@pytest.mark.parametrize("restores", [True, False])
def test_setpoints_that_arrive_late_bring_px4_back_from_its_failsafe_and_no_pilot_did(restores: bool) -> None:
    story = in_flight()
    story.watch.restores_guided = restores
    assert story.see(flying(LAND, is_failsafe=True), flying(GUIDED))
    assert story.watch.is_failsafe is restores
    assert story.see(flying(HOLD, is_failsafe=True), flying(MANUAL))
    assert not story.watch.is_failsafe


def test_a_pilot_s_mode_has_the_name_that_he_knows() -> None:
    story = in_flight()
    assert story.see(flying(RETURN, mode_name="AUTO.RTL"))
    assert story.watch.reason == "mode Return was chosen by another party"


def test_the_autopilots_own_failsafe_takes_over_too() -> None:
    story = in_flight()
    assert story.see(flying(RETURN, is_failsafe=True))
    assert "the autopilot (failsafe)" in story.watch.reason


def test_a_return_may_be_explained_a_moment_later_but_no_manual_mode() -> None:
    for mode, is_failsafe in ((RETURN, True), (MANUAL, False)):
        story = in_flight()
        assert story.see(flying(mode))
        assert not story.watch.is_failsafe
        assert story.see(flying(mode, is_failsafe=True))
        assert story.watch.is_failsafe is is_failsafe
    story = in_flight()
    assert story.see(flying(RETURN))
    assert story.see(flying(RETURN, is_failsafe=True), after_s=2.0)
    assert not story.watch.is_failsafe, "by then it has another reason"


def test_at_the_end_of_a_plan_the_disarming_may_be_received_before_the_ground() -> None:
    story = in_flight(FlightMode.MISSION)
    assert not story.see(flying(FlightMode.MISSION, is_armed=False), comes_down=True, is_low=True)
    story = in_flight(FlightMode.MISSION)
    assert story.see(flying(FlightMode.MISSION, is_armed=False), comes_down=True), "in the air it is somebody else's"


def test_a_disarm_that_is_not_the_end_of_our_landing_is_somebody_elses() -> None:
    story = in_flight()
    assert story.see(standing(GUIDED))
    assert story.watch.reason == "the vehicle was disarmed by another party"
    story = in_flight()
    assert story.see(standing(FlightMode.OTHER, is_failsafe=True))
    assert story.watch.is_failsafe, "a termination, and no pilot's"
    story = in_flight()
    story.command(LAND)
    assert not story.see(standing(HOLD)), "landed and disarmed between two reports"


def test_a_disarm_that_we_commanded_is_ours() -> None:
    story = in_flight(HOLD)
    story.watch.command_disarm(story.now_s)
    assert not story.see(standing(HOLD))


def test_arming_by_somebody_else_is_taking_over_also_long_after_we_asked_in_vain() -> None:
    story = Story()
    story.watch.command_arm(story.now_s)
    story.see(*[standing()] * 40)
    assert story.now_s > ANSWER_S
    assert story.see(standing(is_armed=True))
    assert story.watch.reason == "the vehicle was armed by another party"


def test_on_the_ground_and_disarmed_anybody_may_change_modes() -> None:
    story = Story()
    assert not story.see(standing(MANUAL), standing(RETURN), standing(HOLD))


def test_a_vehicle_that_is_armed_when_first_seen_is_not_ours() -> None:
    assert Story(flying(HOLD)).watch.has_control


def test_control_comes_back_when_an_operator_says_so_and_can_be_lost_again() -> None:
    story = in_flight()
    story.see(flying(MANUAL))
    story.command(GUIDED)
    assert story.see(flying(MANUAL), flying(GUIDED)), "nothing but an operator gives it back"
    story.watch.yield_back()
    assert not story.see(flying(GUIDED))
    assert story.see(flying(MANUAL))


def test_the_first_reason_stays() -> None:
    story = in_flight()
    story.see(flying(MANUAL), flying(RETURN))
    assert "mode manual" in story.watch.reason


def test_a_command_that_is_lost_harms_nobody_and_one_that_is_late_is_still_ours() -> None:
    story = in_flight(HOLD)
    story.command(GUIDED)
    assert not story.see(*[flying(HOLD)] * 20)
    assert not story.see(flying(GUIDED))
    story.command(HOLD)
    assert not story.see(*[flying(GUIDED)] * 30)
    assert story.see(flying(HOLD)), "too late to be the answer to our command"


def test_a_command_that_is_not_answered_yet_may_still_be_carried_out_once() -> None:
    story = in_flight(HOLD)
    story.command(GUIDED)
    for _ in range(40):
        story.watch.extend(GUIDED, story.now_s)
        assert not story.see(flying(HOLD))
    assert story.now_s > ANSWER_S
    assert not story.see(flying(GUIDED)), "it was on its way all the time"
    story.watch.extend(GUIDED, story.now_s)
    assert story.see(flying(HOLD), flying(GUIDED)), "but only once"


def test_two_commands_of_ours_may_both_be_carried_out_in_turn() -> None:
    story = in_flight(HOLD)
    story.command(GUIDED)
    story.command(HOLD)
    assert not story.see(flying(GUIDED), flying(HOLD))
    assert story.see(flying(GUIDED)), "each only once"


@pytest.mark.parametrize("is_first_ours", [True, False])
def test_a_pilot_who_changes_the_mode_at_the_same_moment_wins(is_first_ours: bool) -> None:
    story = in_flight(HOLD)
    story.command(GUIDED)
    states = [flying(GUIDED), flying(MANUAL)] if is_first_ours else [flying(MANUAL), flying(GUIDED)]
    assert story.see(*states)


def test_hold_before_the_climb_is_over_is_the_pilots() -> None:
    story = in_flight(TAKE_OFF)
    assert story.see(flying(HOLD), may_settle=False)


def test_a_hold_after_a_take_off_that_lost_its_driver_is_no_pilots() -> None:
    story = in_flight(TAKE_OFF)
    story.watch.begin()
    assert not story.see(flying(TAKE_OFF), flying(HOLD))
    assert story.see(flying(GUIDED), flying(HOLD)), "once is enough"


def test_what_happens_while_the_autopilot_is_silent_is_seen_afterwards() -> None:
    story = in_flight()
    silent = AutopilotState(is_connected=False, is_armed=True, mode=GUIDED)
    assert not story.see(*[silent] * 50)
    assert story.see(flying(MANUAL))


def test_a_driver_that_is_brought_up_again_soon_remembers_and_a_late_one_does_not() -> None:
    story = in_flight()
    story.command(HOLD)
    assert not story.see(flying(HOLD), after_s=2.0)
    story = in_flight()
    story.command(HOLD)
    story.watch.begin()
    assert story.see(flying(HOLD), after_s=8.0)
    assert "before this driver started" in story.watch.reason


def test_a_shadow_takes_its_primarys_modes_for_ours_and_steps_in_when_that_leaves_a_hold() -> None:
    story = Story()
    story.see(standing(HOLD, is_armed=True), flying(TAKE_OFF), flying(HOLD), flying(GUIDED), is_shadow=True)
    story.watch.step_in(story.now_s)
    assert not story.see(flying(GUIDED), flying(HOLD))
    story.command(GUIDED)
    assert not story.see(flying(GUIDED))
    assert story.see(flying(MANUAL))


def test_a_shadow_knows_the_pilots_modes_and_what_its_primary_says() -> None:
    story = Story()
    assert story.see(flying(GUIDED), flying(MANUAL), is_shadow=True)
    story = Story()
    story.see(flying(HOLD), is_shadow=True)
    story.watch.lose("mode HOLD was chosen by another party")
    story.watch.step_in(story.now_s)
    assert story.see(flying(HOLD))


def test_a_shadow_that_begins_in_flight_is_no_takeover() -> None:
    story = Story.__new__(Story)
    story.watch, story.now_s = PilotWatch(), 0.0
    assert not story.see(flying(GUIDED), is_shadow=True)


modes = st.sampled_from(list(FlightMode))


@settings(max_examples=100)
@given(st.lists(st.tuples(st.booleans(), modes), max_size=12))
def test_no_mode_that_was_never_commanded_is_ever_taken_for_ours(events: list[tuple[bool, FlightMode]]) -> None:
    story = in_flight(HOLD)
    commanded = {HOLD}
    mode = HOLD
    for is_ours, wanted in events:
        if is_ours and wanted in OURS:
            story.command(wanted)
            commanded.add(wanted)
        elif wanted is not mode:
            has_control = story.see(flying(wanted))
            known = any(wanted in FOLLOWS[one] for one in commanded)
            assert has_control or known
            mode = wanted


# a gap of ours


def test_a_hold_of_the_failsafe_after_a_gap_of_ours_is_neither_a_pilots_nor_the_failsafes() -> None:
    story = in_flight()
    story.poses(1.0, 1.05, 5.05)
    assert not story.see(flying(HOLD, is_failsafe=True))
    assert story.watch.held_after_gap_s == pytest.approx(4.0)
    assert not story.see(flying(GUIDED), may_return=True)


@pytest.mark.parametrize(
    ("poses", "state", "is_failsafe"),
    [
        ((1.0, 1.05, 1.1), flying(HOLD, is_failsafe=True), True),
        ((1.0, 1.05, 5.05), flying(HOLD), False),
        ((1.0, 1.05, 5.05), flying(MANUAL, is_failsafe=True), True),
    ],
    ids=["without a gap", "without a failsafe", "in another mode"],
)
def test_other_holds_are_somebody_elses(poses: tuple[float, ...], state: AutopilotState, is_failsafe: bool) -> None:
    story = in_flight()
    story.poses(*poses)
    assert story.see(state)
    assert (story.watch.is_failsafe, story.watch.held_after_gap_s) == (is_failsafe, 0.0)


def test_a_gap_explains_no_hold_that_comes_long_after_it() -> None:
    story = in_flight()
    story.poses(1.0, 1.05, 5.05)
    assert story.see(*[flying(GUIDED)] * 30, flying(HOLD, is_failsafe=True))


def test_a_stream_brings_guided_mode_back_where_the_autopilot_says_so_and_only_there() -> None:
    for may_return in (True, False):
        story = in_flight(HOLD)
        assert story.see(flying(GUIDED), may_return=may_return) is not may_return


def test_a_pilot_takes_over_from_the_failsafe_and_not_the_other_way() -> None:
    story = in_flight()
    assert story.see(flying(RETURN, is_failsafe=True))
    assert story.watch.is_failsafe
    assert story.see(flying(MANUAL))
    assert not story.watch.is_failsafe
    assert "another party" in story.watch.reason
    assert story.see(flying(RETURN, is_failsafe=True))
    assert not story.watch.is_failsafe


def test_what_was_commanded_and_carried_out_while_nothing_was_seen_is_ours() -> None:
    story = in_flight()
    story.command(LAND)
    assert not story.see(flying(LAND), after_s=ANSWER_S + 2.0)
    other = in_flight()
    other.command(LAND)
    other.see(flying(GUIDED), after_s=ANSWER_S + 2.0)
    assert other.see(flying(LAND), after_s=ANSWER_S), "it was seen meanwhile, and not in that mode"
