"""Each invariant holds where it should, and is broken where it should be, with the values in words."""

from typing import Any

import pytest
from tests.sitl.proof.moments import facts, flown, message, moment

from gloc3.errors import Gloc3Error, Refused
from gloc3.evaluation.requested_path import RequestedFlight
from gloc3.messages.command_interface import (
    CiReply,
    CiRequest,
    Emergency,
    EmergencyVerb,
    Outcome,
    RequestTask,
    Steer,
    Verb,
)
from gloc3.messages.envelope import Envelope, Event, Severity
from gloc3.messages.frames import IDENTITY
from gloc3.messages.summaries import CiEvent, MissionSummary
from gloc3.messages.vehicle import DriverState, ManoeuvreState, Pose, Setpoint
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.states import ActionState
from gloc3_sitl.autopilot.modes import Behaviour
from gloc3_sitl.autopilot.verdict import Author
from gloc3_sitl.proof import invariant as invariant_module
from gloc3_sitl.proof.command import (
    CommandsAtMostOnce,
    HoldIsObeyed,
    MotionHasOneOwner,
    NothingArmsByItself,
    SetpointOrHold,
)
from gloc3_sitl.proof.course import GoesOn, ItEnds, OnlyTableTransitions
from gloc3_sitl.proof.invariant import Invariant, load_invariants
from gloc3_sitl.proof.record import LogComplete, NoTraceback, OnlyNumbers
from gloc3_sitl.proof.space import AboveFloor, DoneTrulyPassed, InsideFence, PoseHonest
from gloc3_sitl.proof.standard_invariants import STANDARD, invariants_but

OUTSIDE = {"position_ned_m": (25.0, 0.0, -2.0)}
"""Five metres beyond the fence of `hop`."""


def told(judge: Invariant) -> str:
    return judge.broken.text if judge.broken is not None else ""


# --- space ---


def test_a_vehicle_that_leaves_the_fence_is_told_with_the_distance() -> None:
    judge = InsideFence(facts())
    judge.observe(moment(5.0))
    assert not told(judge)
    judge.observe(moment(6.0, **OUTSIDE))
    assert told(judge).startswith("5.00 m outside the fence")


def test_the_distance_in_which_it_stops_is_set_aside() -> None:
    judge = InsideFence(facts())
    judge.observe(moment(5.0, position_ned_m=(20.5, 0.0, -2.0), velocity_ned_m_s=(2.0, 0.0, 0.0)))
    judge.observe(moment(5.5, position_ned_m=(21.3, 0.0, -2.0), velocity_ned_m_s=(1.0, 0.0, 0.0)))
    assert not told(judge), "2 m/s: 1 m in half a second, and 0.8 m of braking"
    judge.observe(moment(6.5, position_ned_m=(22.0, 0.0, -2.0)))
    assert told(judge)


def test_where_a_pilot_flies_is_his_own_matter_until_it_is_back_inside() -> None:
    judge = InsideFence(facts())
    judge.observe(moment(5.0, has_transmitter=True, mode_author=Author.PILOT, **OUTSIDE))
    judge.observe(moment(6.0, **OUTSIDE))
    assert not told(judge), "he has left it there"
    judge.observe(moment(7.0))
    judge.observe(moment(8.0, **OUTSIDE))
    assert told(judge)


@pytest.mark.parametrize(
    ("after_s", "author", "is_his"),
    [(1.0, Author.FAILSAFE, True), (3.0, Author.FAILSAFE, False), (1.0, Author.COMMAND, False)],
)
def test_what_a_pilot_has_flown_towards_the_fence_is_his_while_the_autopilot_brakes_it(
    after_s: float, author: Author, is_his: bool
) -> None:
    judge = InsideFence(facts())
    judge.observe(moment(5.0, has_transmitter=True, mode_author=Author.PILOT))
    judge.observe(moment(5.0 + after_s, has_transmitter=True, mode_author=author, **OUTSIDE))
    assert bool(told(judge)) != is_his


@pytest.mark.parametrize(
    ("fault", "crossed_s", "is_carried"),
    [
        ("cable_loss@5..40", 30.0, True),
        ("cable_loss@5..40", 47.0, True),
        ("cable_loss@5..40", 49.0, False),
        ("cable_loss@5..40", 8.0, False),
        ("cable_loss@5..9", 12.0, False),
        ("cable_loss=0.5@5..40", 30.0, False),
    ],
)
def test_a_diver_drifts_while_it_is_without_its_companion_and_a_moment_longer(
    fault: str, crossed_s: float, is_carried: bool
) -> None:
    judge = InsideFence(facts(fault, platform="auv"))
    judge.observe(moment(crossed_s, **OUTSIDE))
    assert bool(told(judge)) != is_carried
    copter = InsideFence(facts(fault))
    copter.observe(moment(crossed_s, **OUTSIDE))
    assert told(copter)


def test_what_was_left_outside_at_speed_may_have_come_to_rest_there_and_goes_no_further() -> None:
    judge = InsideFence(facts())
    judge.observe(moment(5.0))
    judge.observe(moment(5.1, velocity_ned_m_s=(4.0, 0.0, 0.0), is_landed=True, **OUTSIDE))
    judge.observe(moment(9.0, **OUTSIDE))
    assert not told(judge)
    judge.observe(moment(9.1, position_ned_m=(26.0, 0.0, -2.0)))
    assert told(judge)


@pytest.mark.parametrize(
    ("faults", "is_calm", "is_excused"),
    [
        (["sensor:imu=late@4..5"], True, True),
        (["sensor:imu=biased@4..5"], True, False),
        (["sensor:fix=stuck@4..5"], False, True),
        (["sensor:fix=stuck@4..5"], True, False),
        ([], False, False),
    ],
)
def test_what_nobody_can_steer_may_leave_the_fence(faults: list[str], is_calm: bool, is_excused: bool) -> None:
    judge = InsideFence(facts(*faults, is_calm=is_calm))
    judge.observe(moment(6.0))
    judge.observe(moment(6.1, **OUTSIDE))
    assert bool(told(judge)) is not is_excused


def test_a_diver_keeps_off_the_floor() -> None:
    judge = AboveFloor(facts(floor_height_m=-20.0))
    judge.observe(moment(5.0, position_ned_m=(0.0, 0.0, 19.0)))
    assert not told(judge)
    judge.observe(moment(6.0, position_ned_m=(0.0, 0.0, 19.9)))
    assert told(judge) == "0.10 m above the floor, 0.3 m is the least"


def pose(east_m: float, **changed: Any) -> Pose:
    position = (0.0, east_m, -2.0)
    values: dict[str, Any] = {"position_ned_m": position, "velocity_ned_m_s": (0.0, 0.0, 0.0), "ned_from_frd": IDENTITY}
    return Pose(**{**values, "position_std_m": (0.1, 0.1, 0.1), **changed})


def watch_poses(judge: PoseHonest, **given: Any) -> None:
    judge.observe(moment(4.9))
    for step in range(8):
        judge.receive("pose", message(pose(**given), t_s=5.0 + 0.1 * step - 0.05), 5.0 + 0.1 * step)
        judge.observe(moment(5.0 + 0.1 * step))


def test_a_pose_that_is_off_by_more_than_it_says_is_dishonest() -> None:
    judge = PoseHonest(facts())
    watch_poses(judge, east_m=0.5)
    assert told(judge) == "valid and 0.50 m beside the truth for 0.3 s, claiming 0.10 m"


@pytest.mark.parametrize(
    "given", [{"east_m": 0.35}, {"east_m": 0.5, "is_valid": False}, {"east_m": 0.5, "position_std_m": (0.2, 0.2, 0.2)}]
)
def test_a_pose_that_admits_it_is_honest(given: dict[str, Any]) -> None:
    judge = PoseHonest(facts())
    watch_poses(judge, **given)
    assert not told(judge)


def test_a_pose_is_not_judged_after_a_crash() -> None:
    judge = PoseHonest(facts())
    judge.observe(moment(4.7, velocity_ned_m_s=(0.0, 0.0, 3.0)))
    judge.observe(moment(4.8, is_on_ground=True))
    watch_poses(judge, east_m=0.5)
    assert not told(judge)


def test_a_pose_that_a_fault_corrupts_on_its_way_is_not_held_against_the_one_that_sent_it() -> None:
    judge = PoseHonest(facts("topic:pose=jump@3..4"))
    watch_poses(judge, east_m=2.0)
    assert not told(judge)


@pytest.mark.parametrize(("passes_at_m", "is_broken"), [(0.2, False), (1.0, True)])
def test_a_way_that_is_done_has_passed_its_waypoints(passes_at_m: float, is_broken: bool) -> None:
    judge = DoneTrulyPassed(facts())
    way = RequestedFlight("w1", 1.0, [(0.0, 0.0, -2.0), (4.0, 0.0, -2.0), (8.0, 0.0, -2.0)], 1.0)
    for step in range(100):
        judge.observe(moment(1.0 + 0.1 * step, position_ned_m=(0.1 * step, passes_at_m, -2.0)))
    judge.receive("action_status/waypoints", message(ActionStatus(action_id="w1", state=ActionState.DONE)), 10.5)
    judge.end(flown(requested=[way]))
    assert bool(told(judge)) == is_broken
    assert not is_broken or told(judge) == "w1 is done, and passed waypoint 1 of 2 at 1.00 m; 0.30 m counts as passed"


def test_a_pose_that_has_known_for_long_how_well_it_knows_still_knows() -> None:
    """Its standard deviation has been 0.2 m for 49 s when the way begins, so that 0.8 m aside may be passed."""
    judge = DoneTrulyPassed(facts())
    judge.receive("pose", message(pose(0.0, position_std_m=(0.2, 0.2, 0.2))), 1.0)
    for step in range(100):
        judge.observe(moment(50.0 + 0.1 * step, position_ned_m=(0.1 * step, 0.7, -2.0)))
    judge.receive("action_status/waypoints", message(ActionStatus(action_id="w1", state=ActionState.DONE)), 59.5)
    judge.end(flown(requested=[RequestedFlight("w1", 50.0, [(0.0, 0.0, -2.0), (8.0, 0.0, -2.0)], 1.0)]))
    assert not told(judge)


# --- command ---


def test_a_gap_without_a_hold_is_told() -> None:
    judge = SetpointOrHold(facts())
    for step in range(30):
        judge.observe(moment(5.0 + 0.1 * step, setpoint_age_s=0.1 * step))
    assert told(judge).startswith("no setpoint for 1.2 s")


@pytest.mark.parametrize(
    ("faults", "changed"),
    [
        (("cable_loss@4..9",), {}),
        (("hang:autopilot_driver@4..9",), {}),
        ((), {"behaviour": Behaviour.HOLD}),
        ((), {"is_landed": True}),
    ],
)
def test_a_gap_is_no_fault_of_ours_where_nothing_can_get_through_or_it_holds(
    faults: tuple[str, ...], changed: dict[str, Any]
) -> None:
    judge = SetpointOrHold(facts(*faults))
    for step in range(30):
        judge.observe(moment(5.0 + 0.1 * step, setpoint_age_s=0.1 * step, **changed))
    assert not told(judge)


def test_a_manoeuvre_of_the_autopilot_needs_no_setpoints() -> None:
    judge = SetpointOrHold(facts())
    judge.receive("driver", message(DriverState(manoeuvre_state=ManoeuvreState.RUNNING)), 4.0)
    for step in range(30):
        judge.observe(moment(5.0 + 0.1 * step, setpoint_age_s=0.1 * step))
    assert not told(judge)


@pytest.mark.parametrize(
    ("policy", "faults", "changed", "is_broken"),
    [
        ("hold", (), {}, True),
        ("hold", (), {"behaviour": Behaviour.RETURN}, True),
        ("land", (), {}, False),
        ("hold", (), {"behaviour": Behaviour.HOLD}, False),
        ("hold", (), {"mode_author": Author.PILOT}, False),
        ("hold", (), {"mode_author": Author.FAILSAFE}, False),
        ("hold", (), {"is_landed": True}, False),
        ("hold", ("cable_loss@4..9",), {}, False),
        ("hold", ("hang:autopilot_driver@4..9",), {}, False),
        ("hold", ("hang:waypoints@4..9",), {}, True),
    ],
)
def test_a_hold_ends_the_landing_that_we_have_commanded(
    policy: str, faults: tuple[str, ...], changed: dict[str, Any], *, is_broken: bool
) -> None:
    judge = HoldIsObeyed(facts(*faults))
    for step in range(40):
        now_s = 5.0 + 0.1 * step
        judge.receive("ci/mission", message(MissionSummary(name="hop", digest="", state="", policy=policy)), now_s)
        judge.observe(moment(now_s, **{"behaviour": Behaviour.LAND, "mode_name": "LAND", **changed}))
    assert bool(told(judge)) == is_broken
    assert not is_broken or told(judge) == "the policy has been to hold for 3 s, and LAND goes on"


def test_a_command_server_that_is_dead_holds_nothing() -> None:
    judge = HoldIsObeyed(facts())
    judge.receive("ci/mission", message(MissionSummary(name="hop", digest="", state="", policy="hold")), 5.0)
    for step in range(100):
        judge.observe(moment(5.0 + 0.1 * step, behaviour=Behaviour.LAND))
    assert not told(judge)


def stream(judge: MotionHasOneOwner, *senders: str) -> None:
    for step, sender in enumerate(senders):
        judge.receive("setpoint", message(Setpoint(action_id="a"), component=sender), 5.0 + 0.1 * step)


def test_two_that_stream_by_turns_are_told_and_a_standby_that_takes_over_is_not() -> None:
    judge = MotionHasOneOwner(facts())
    stream(judge, *["limiter"] * 5, *["limiter_standby"] * 5)
    assert not told(judge)
    stream(judge, *["limiter", "limiter_standby"] * 5)
    assert told(judge).startswith("limiter and limiter_standby stream setpoints by turns")


def take_back(judge: MotionHasOneOwner, *said: Any, has_transmitter: bool = True) -> None:
    judge.observe(moment(5.0))
    judge.observe(moment(6.0, mode_author=Author.PILOT, has_transmitter=True))
    for payload in said:
        judge.receive("ci/mission", message(payload), 8.0)
    judge.observe(moment(9.0, mode_author=Author.COMMAND, has_transmitter=has_transmitter))


def test_to_take_the_vehicle_back_from_a_pilot_is_told() -> None:
    judge = MotionHasOneOwner(facts())
    take_back(judge)
    assert told(judge) == "Offboard was commanded 3.0 s after a pilot has taken over, and nobody said resume"


@pytest.mark.parametrize(("policy", "is_right"), [("", False), ("pilot", False), ("failsafe", False), ("land", True)])
def test_only_a_safety_policy_takes_the_vehicle_back_by_itself(policy: str, *, is_right: bool) -> None:
    """The summary names the pilot where a policy stands, while one has control."""
    judge = MotionHasOneOwner(facts())
    take_back(judge, MissionSummary(name="hop", digest="1", state="paused", policy=policy))
    assert (not told(judge)) == is_right


@pytest.mark.parametrize(
    ("body", "is_right"),
    [
        (Steer(verb=Verb.RESUME), True),
        (Steer(verb=Verb.PAUSE), False),
        (Steer(verb=Verb.SKIP, target="hop.up"), False),
        (RequestTask(text="land: {}"), True),
        (Emergency(verb=EmergencyVerb.HOLD), True),
    ],
)
def test_to_go_on_is_right_when_an_operator_says_so(body: Any, *, is_right: bool) -> None:
    judge = MotionHasOneOwner(facts())
    take_back(judge, CiRequest(sender="255", boot=1, sequence=1, body=body))
    assert (not told(judge)) == is_right


def test_to_go_on_when_the_pilot_is_gone_is_right() -> None:
    alone = MotionHasOneOwner(facts())
    take_back(alone, has_transmitter=False)
    assert not told(alone)


def test_a_hold_that_a_pilot_chooses_in_the_autopilots_own_climb_may_be_taken_for_the_end_of_it() -> None:
    for behaviour, is_broken in ((Behaviour.HOLD, False), (Behaviour.POSITION, True)):
        judge = MotionHasOneOwner(facts())
        judge.observe(moment(5.0, behaviour=Behaviour.TAKE_OFF))
        for t_s in (6.0, 6.1):
            judge.observe(moment(t_s, behaviour=behaviour, mode_author=Author.PILOT, has_transmitter=True))
        judge.observe(moment(9.0, has_transmitter=True))
        assert bool(told(judge)) is is_broken


def arm(judge: NothingArmsByItself, state: str, policy: str = "") -> None:
    judge.receive("ci/mission", message(MissionSummary(name="hop", digest="1", state=state, policy=policy)), 4.0)
    judge.observe(moment(5.0, is_armed=False))
    judge.observe(moment(5.1, is_armed=True))


def test_what_arms_without_a_running_mission_is_told() -> None:
    judge = NothingArmsByItself(facts())
    arm(judge, "running")
    assert not told(judge)
    judge = NothingArmsByItself(facts())
    arm(judge, "failed", "return")
    assert told(judge) == "armed while the mission is failed, policy return"
    judge = NothingArmsByItself(facts("pilot:arm@5"))
    arm(judge, "failed")
    assert not told(judge), "a pilot may"


def reply(outcome: Outcome) -> Envelope[Any]:
    return message(CiReply(sender="255", boot=1, sequence=3, outcome=outcome))


def test_a_repeat_that_is_answered_otherwise_is_told() -> None:
    judge = CommandsAtMostOnce(facts())
    judge.receive("ci/reply", reply(Outcome.ACCEPTED), 4.0)
    judge.receive("ci/reply", reply(Outcome.ACCEPTED), 5.0)
    assert not told(judge)
    judge.receive("ci/reply", reply(Outcome.REFUSED), 6.0)
    assert told(judge) == "request 3 of 255 was answered accepted, then refused"


def event(text: str, boot: int = 1) -> Envelope[Any]:
    return message(CiEvent(severity=Severity.INFO, source="mission", text=text, t_s=1.0), boot=boot)


def test_a_mission_that_starts_more_often_than_it_was_asked_to_is_told() -> None:
    judge = CommandsAtMostOnce(facts())
    judge.receive("ci/request", message(CiRequest(sender="255", boot=1, sequence=1, body=Steer(verb=Verb.START))), 3.0)
    judge.receive("ci/event", event("mission running: by an operator"), 3.0)
    assert not told(judge)
    judge.receive("ci/event", event("mission running: by an operator"), 4.0)
    assert told(judge) == "the mission was started 2 times, asked for 1 times"


# --- course ---


def run_events(*texts: str, boots: tuple[int, ...] = ()) -> OnlyTableTransitions:
    judge = OnlyTableTransitions(facts())
    for index, text in enumerate(texts):
        judge.receive("ci/event", event(text, boot=boots[index] if boots else 1), float(index))
    return judge


def test_a_transition_that_the_table_does_not_have_is_told() -> None:
    assert not told(run_events("hop.up running", "hop.up paused", "hop.up running", "hop.up done"))
    assert (
        told(run_events("hop.up running", "hop.up aborted: land", "hop.up running"))
        == "hop.up went from aborted to running"
    )


def test_repetitions_restarts_and_new_starts_begin_anew() -> None:
    assert not told(run_events("round.way done", "round: 2 of 3", "round.way running"))
    assert not told(run_events("hop.up done", "hop.up running", boots=(1, 2)))
    assert not told(run_events("mission aborted", "mission running: by an operator"))


def test_a_flight_that_does_not_end_is_told() -> None:
    judge = ItEnds(facts())
    judge.end(flown())
    assert not told(judge)
    judge.end(flown(state="running", last=moment(20.0)))
    assert told(judge) == "still armed in Offboard after 100 s; mission running, policy none"


def test_a_pilot_or_an_operator_who_is_there_has_the_vehicle() -> None:
    judge = ItEnds(facts())
    judge.receive("driver", message(DriverState(has_pilot_control=True)), 10.0)
    judge.end(flown(last=moment(20.0, has_transmitter=True)))
    assert not told(judge)
    judge = ItEnds(facts())
    judge.receive(
        "ci/mission", message(MissionSummary(name="h", digest="1", state="paused", reason="by an operator")), 9.0
    )
    judge.end(flown(last=moment(20.0)))
    assert not told(judge)
    judge = ItEnds(facts("link_loss@5.."))
    judge.receive(
        "ci/mission", message(MissionSummary(name="h", digest="1", state="paused", reason="by an operator")), 9.0
    )
    judge.end(flown(last=moment(20.0)))
    assert told(judge), "nobody hears him"


def _ends_aloft(summary: MissionSummary, *faults: str) -> bool:
    """Whether a mission that is over, with the vehicle in the air, breaks the invariant."""
    judge = ItEnds(facts(*faults))
    judge.receive("ci/mission", message(summary), 9.0)
    judge.end(flown(last=moment(20.0)))
    return bool(told(judge))


def test_what_an_operator_has_skipped_is_his() -> None:
    done = MissionSummary(name="h", digest="1", state="done", tasks={"back": "skipped"})
    assert not _ends_aloft(done, "operator:skip=back@5")
    assert _ends_aloft(done, "operator:pause@5"), "he has skipped nothing"
    assert _ends_aloft(done)
    landed_by_nobody = MissionSummary(name="h", digest="1", state="done", tasks={"back": "done"})
    for command in ("skip", "abort"):
        assert not _ends_aloft(landed_by_nobody, f"operator:{command}=back.down@5")
    assert _ends_aloft(landed_by_nobody, "operator:abort=back@5"), "it was refused: the task is done"


def test_what_an_operator_takes_back_from_a_pilot_with_no_mission_left_is_his() -> None:
    aborted = MissionSummary(name="h", digest="1", state="aborted", reason="abort by an operator: land")
    assert not _ends_aloft(aborted, "pilot:hold@6", "operator:resume@8")
    assert _ends_aloft(aborted, "pilot:hold@6", "operator:resume@4"), "he was asked for nothing since"
    assert _ends_aloft(aborted, "operator:resume@8"), "nobody had taken it"


def test_an_emergency_hold_is_the_operators_from_then_on() -> None:
    held = MissionSummary(name="h", digest="1", state="paused", policy="hold", reason="pose is lost")
    assert not _ends_aloft(held, "operator:hold@5")
    assert _ends_aloft(held, "operator:hold@30"), "he comes later"


def test_a_diver_ends_at_the_surface() -> None:
    judge = ItEnds(facts(platform="auv"))
    judge.end(flown(last=moment(20.0, is_armed=False, position_ned_m=(0.0, 0.0, 0.4))))
    assert not told(judge)
    judge.end(flown(last=moment(20.0, is_armed=False, position_ned_m=(0.0, 0.0, 6.0))))
    assert told(judge)


# --- record ---


@pytest.mark.parametrize(
    ("faults", "is_judged"),
    [
        ((), True),
        (("crash:pose@5",), True),
        (("disk_full@5..", "clock_jump=1000@3", "link_twice=0.5@2..9", "crash:limiter@5"), True),
        (("link_loss@5..9",), True),
        (("cable_loss@5..5.3",), True),
        (("link_loss@5..12",), False),
        (("cable_loss@5..6",), False),
        (("hang:pose@5..5.5",), True),
        (("hang:pose@5..6",), False),
        (("crash:pose@5..",), False),
        (("crash:hold@5",), False),
        (("crash:command_server@5",), False),
        (("crash:pose@5", "link_loss@5..9"), False),
        (("restart@5",), False),
    ],
)
def test_a_mission_goes_on_through_what_the_stack_gets_over(faults: tuple[str, ...], *, is_judged: bool) -> None:
    judge = GoesOn(facts(*faults))
    judge.end(flown(state="failed", reason="pose is lost"))
    assert told(judge) == ("the mission is failed: pose is lost" if is_judged else "")
    done = GoesOn(facts(*faults))
    done.end(flown())
    assert not told(done)


def test_wind_may_end_a_mission() -> None:
    judge = GoesOn(facts("crash:pose@5", is_calm=False))
    judge.end(flown(state="failed"))
    assert not told(judge)


def test_a_value_that_is_no_number_is_told() -> None:
    judge = OnlyNumbers(facts())
    judge.receive("pose", message(pose(float("nan"), is_valid=False)), 5.0)
    assert not told(judge)
    judge.receive("pose", message(pose(float("nan")), component="pose"), 5.0)
    assert told(judge) == "pose of pose holds a value that is no finite number"


def test_an_error_that_no_fault_has_injected_is_told() -> None:
    judge = NoTraceback(facts())
    crash = Event(severity=Severity.ERROR, text="working -> faulty: injected crash of pose")
    judge.receive("components/pose/event", message(crash), 5.0)
    assert not told(judge)
    error = Event(severity=Severity.ERROR, text="working -> faulty: KeyError: 'a'")
    judge.receive("components/pose/event", message(error, component="pose"), 5.0)
    assert told(judge) == "pose: working -> faulty: KeyError: 'a'"
    unhandled = NoTraceback(facts())
    unhandled.end(flown(failures=["KeyError('b')"]))
    assert told(unhandled) == "not handled: KeyError('b')"


def test_a_gap_in_the_numbers_is_told() -> None:
    judge = LogComplete(facts())
    for sequence in (4, 5, 7):
        judge.receive("pose", message(pose(0.0), component="pose", sequence=sequence), 5.0)
    assert told(judge) == "pose of pose: number 7 follows 5"
    judge = LogComplete(facts())
    for sequence in (4, 6):
        judge.receive("ci/request", message(pose(0.0), component="command_client", sequence=sequence), 5.0)
    assert not told(judge), "lost on its way from a station"
    judge.end(flown(log_problem="3 messages were not recorded"))
    assert told(judge) == "3 messages were not recorded"


# --- all of them ---


def test_each_has_a_name_of_its_own_and_a_sentence() -> None:
    assert len({kind.name for kind in STANDARD}) == len(STANDARD)
    assert all(kind.sentence.endswith(".") for kind in STANDARD)


def test_invariants_are_left_out_by_name_and_a_wrong_name_is_refused() -> None:
    assert ItEnds not in invariants_but(["it_ends"])
    with pytest.raises(Refused, match="did you mean 'it_ends'"):
        invariants_but(["it_end"])


class _Point:
    """An entry point of an installed package."""

    def __init__(self, loaded: object) -> None:
        self.name, self.value, self._loaded = "of_a_package", "package:Thing", loaded

    def load(self) -> object:
        return self._loaded


class PackagesOwn(Invariant):
    name = "of_a_package"
    sentence = "It holds."


def test_packages_bring_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(invariant_module, "installed_points", lambda group: (_Point(PackagesOwn),))
    assert load_invariants(STANDARD)[-1] is PackagesOwn
    monkeypatch.setattr(invariant_module, "installed_points", lambda group: (_Point(object),))
    with pytest.raises(Gloc3Error, match="is no invariant"):
        load_invariants(STANDARD)
