"""Each policy is carried out as the mission says, the most severe one wins, and the pilot goes before all of them."""

import pytest

from gloc3.errors import Refused
from gloc3.mission.executing.board import PolicyCondition
from gloc3.mission.model.states import ActionState
from gloc3.platform.platform import Platform

from .executor_rig import MISSION, Rig, flying


@pytest.fixture
def rig(pelican: Platform) -> Rig:
    return flying(pelican)


# failures


@pytest.mark.parametrize("level", ["action", "task"])
def test_retry_starts_what_failed_again_and_then_goes_by_the_next_level(pelican: Platform, level: str) -> None:
    text = (
        MISSION.replace("[16, 1, 2]]}}", "[16, 1, 2]]}, retries: 2}")
        if level == "action"
        else MISSION.replace("    after: [depart]", "    after: [depart]\n    on_failure: retry\n    retries: 2")
    )
    rig = flying(pelican, text)
    for attempt in (1, 2):
        rig.failed("sweep.wall")
        assert rig.running() == ["sweep.photos", "sweep.wall"], attempt
        assert rig.state("sweep") == "running"
    rig.failed("sweep.wall")
    assert rig.state("sweep.wall") == "failed"
    assert rig.executor.policy == "hold"


def test_skip_counts_what_failed_as_skipped_and_goes_on(pelican: Platform) -> None:
    rig = flying(pelican, MISSION.replace("[16, 1, 2]]}}", "[16, 1, 2]]}, on_failure: skip}"))
    rig.failed("sweep.wall")
    assert rig.state("sweep.wall") == "skipped"
    assert rig.state("sweep.photos") == "done"
    assert rig.state("sweep") == "done"
    assert rig.running() == ["recover.home"]


def test_a_task_that_skips_ends_all_that_is_in_it(pelican: Platform) -> None:
    rig = flying(pelican, MISSION.replace("    after: [depart]", "    after: [depart]\n    on_failure: skip"))
    rig.failed("sweep.photos")
    assert [rig.state("sweep"), rig.state("sweep.wall"), rig.state("sweep.photos")] == ["skipped"] * 3
    assert rig.running() == ["recover.home"]


def test_continue_leaves_what_failed_as_failed_and_goes_on(pelican: Platform) -> None:
    rig = flying(pelican, MISSION.replace("until: wall", "until: wall, on_failure: continue"))
    rig.failed("sweep.photos")
    assert rig.state("sweep.photos") == "failed"
    assert rig.running() == ["sweep.wall"]
    rig.done("sweep.wall")
    assert rig.state("sweep") == "done"
    rig = flying(pelican, MISSION.replace("on_failure: hold", "on_failure: continue"))
    rig.failed("sweep.photos")
    assert rig.running() == ["sweep.wall"]
    rig.done("sweep.wall")
    assert rig.state("sweep") == "failed"
    assert rig.running() == ["recover.home"]
    rig.done("recover.home")
    rig.done("recover.down")
    assert rig.state() == "done"


def test_hold_waits_for_an_operator_and_then_lands(rig: Rig) -> None:
    rig.failed("sweep.wall")
    assert rig.state() == "paused"
    assert rig.state("sweep.wall") == "failed"
    assert rig.state("sweep.photos") == "paused"
    assert rig.grant.action_id == "hold"
    rig.pass_s(29.9)
    assert rig.executor.policy == "hold"
    rig.pass_s(0.2)
    assert rig.executor.policy == "land"
    assert rig.running() == ["policy.land"]
    assert rig.state() == "failed"
    assert rig.executor.mission is not None
    assert rig.executor.mission.reason == ("sweep failed: wall failed: no luck; no operator command for 30 s: land")


@pytest.mark.parametrize("verb", ["resume", "retry", "skip"])
def test_an_operator_who_acts_ends_the_hold(rig: Rig, verb: str) -> None:
    rig.failed("sweep.wall")
    rig.pass_s(10)
    if verb == "resume":
        rig.steer("resume")
    else:
        rig.steer(verb, "sweep.wall")
        rig.pass_s(100)
        assert rig.state() == "paused"
        rig.steer("resume")
    assert rig.running() == (["recover.home"] if verb == "skip" else ["sweep.photos", "sweep.wall"])
    assert rig.state() == "running"


def test_land_and_return_end_the_mission_as_failed(pelican: Platform) -> None:
    rig = flying(pelican, MISSION.replace("on_failure: hold", "on_failure: land"))
    rig.failed("sweep.photos")
    assert rig.state() == "failed"
    assert rig.running() == ["policy.land"]
    rig = flying(pelican, MISSION.replace("on_failure: hold", "on_failure: return"))
    rig.failed("sweep.photos")
    assert rig.running() == ["policy.return_home"]
    assert rig.grant.action_id == rig.id_of("policy.return_home")
    rig.done("policy.return_home")
    assert rig.executor.policy == "land"
    rig.done("policy.land")
    assert rig.executor.policy == ""
    assert rig.state("sweep.wall") == "aborted"
    assert rig.state("sweep.photos") == "failed"


def test_abort_means_the_mission_s_on_failure(pelican: Platform) -> None:
    text = MISSION.replace("until: wall", "until: wall, on_failure: abort").replace(
        "on_failure: hold", "on_failure: return"
    )
    rig = flying(pelican, text)
    rig.failed("sweep.photos")
    assert rig.running() == ["policy.return_home"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (MISSION.replace("[16, 1, 2]]}}", "[16, 1, 2]]}, deadline_s: 10, on_failure: skip}"), "skipped"),
        (MISSION.replace("    after: [depart]", "    after: [depart]\n    deadline_s: 10\n    on_failure: skip"), "skipped"),
        (MISSION.replace("    after: [depart]", "    after: [depart]\n    deadline_s: 10\n    on_failure: continue"), "failed"),
        (MISSION.replace("hold_s: 30", "hold_s: 30\ndeadline_s: 10"), "aborted"),
    ],
)  # fmt: skip
def test_a_deadline_that_passes_is_a_failure_and_pauses_do_not_count(
    pelican: Platform, text: str, expected: str
) -> None:
    rig = flying(pelican, text)
    rig.pass_s(6)
    rig.steer("pause")
    rig.pass_s(60)
    rig.steer("resume")
    rig.pass_s(3.9)
    assert rig.state("sweep.wall") == "running"
    rig.pass_s(0.2)
    assert rig.state("sweep.wall") == expected
    if "\ndeadline_s" in text:
        assert rig.state() == "failed"
        assert rig.executor.policy == "hold"
    else:
        assert rig.running() == ["recover.home"]


# components


def test_a_refused_start_is_a_failure(pelican: Platform) -> None:
    rig = Rig(pelican, MISSION)
    rig.refusing["flight"] = "not armable"
    rig.start()
    assert rig.state("depart.climb") == "failed"
    assert rig.state() == "paused"
    assert "depart.climb failed: flight refused to start: not armable" in rig.log
    assert rig.grant.action_id == ""
    rig.refusing.clear()
    rig.steer("resume")
    assert rig.running() == ["depart.climb"]


def test_a_component_that_does_not_answer_or_goes_silent_has_failed(pelican: Platform) -> None:
    rig = Rig(pelican, MISSION)
    rig.deaf.add("flight")
    rig.start()
    rig.pass_s(1.9)
    assert rig.state() == "running"
    rig.pass_s(0.2)
    assert "depart.climb failed: flight does not answer" in rig.log
    rig = flying(pelican)
    rig.deaf.add("waypoints")
    rig.pass_s(4.9)
    assert rig.state("sweep.wall") == "running"
    rig.pass_s(1)
    assert "sweep.wall failed: waypoints has stopped reporting" in rig.log


def test_a_component_that_turns_faulty_fails_its_actions(rig: Rig) -> None:
    rig.executor.component_failed("images", "faulty: no camera", rig.now_s)
    rig.settle()
    assert "sweep.photos failed: images: faulty: no camera" in rig.log
    assert rig.executor.policy == "hold"


def test_no_attempt_is_wasted_on_a_faulty_component(pelican: Platform) -> None:
    rig = flying(pelican, MISSION.replace("until: wall", "until: wall, retries: 1"))
    for _ in range(20):
        rig.under_way.pop(next((one for one in rig.under_way if one.startswith("sweep.photos")), ""), None)
        rig.executor.component_failed("images", "faulty: no camera", rig.now_s)
        rig.executor.available({"record_images": ("images",)}, rig.now_s)
        rig.settle()
        rig.pass_s(0.05)
    assert rig.state("sweep.photos") == "waiting"
    rig.executor.available({}, rig.now_s)
    rig.settle()
    assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_a_standby_or_a_second_start_has_a_second_and_a_half(rig: Rig) -> None:
    for outage_s, expected in ((1.4, "running"), (1.6, "failed")):
        rig.executor.available({"follow_waypoints": ("limiter",)}, rig.now_s)
        rig.pass_s(outage_s)
        rig.executor.available({}, rig.now_s)
        assert rig.state("sweep.wall") == expected


def test_an_action_waits_two_seconds_for_what_it_needs(pelican: Platform) -> None:
    for outage_s, expected in ((1.9, "running"), (2.1, "failed")):
        rig = Rig(pelican, MISSION)
        rig.start()
        rig.fly()
        rig.executor.available({"follow_waypoints": ("limiter",)}, rig.now_s)
        rig.done("depart.climb")
        assert rig.state("sweep.wall") == "waiting"
        assert rig.grant.action_id == "hold"
        rig.pass_s(outage_s)
        rig.executor.available({}, rig.now_s)
        rig.settle()
        assert rig.state("sweep.wall") == expected


def test_a_component_that_forgot_a_paused_action_gets_it_anew(rig: Rig) -> None:
    rig.report(rig.id_of("sweep.wall"), ActionState.RUNNING, progress=0.6)
    rig.steer("pause")
    del rig.under_way[rig.id_of("sweep.wall")]
    rig.steer("resume")
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    assert rig.started[-1].progress == 0.6


def test_an_action_that_cannot_pause_is_cancelled_and_begun_again(rig: Rig) -> None:
    rig.refusing["waypoints"] = "not now"
    rig.steer("pause")
    assert rig.state("sweep.wall") == "paused"
    assert rig.grant.action_id == "hold"
    assert list(rig.under_way.values()) == ["paused"]
    rig.refusing.clear()
    rig.steer("resume")
    assert rig.running() == ["sweep.photos", "sweep.wall"]


# conditions


def test_link_loss_is_noticed_after_the_time_that_the_mission_gives(rig: Rig) -> None:
    rig.executor.link(4.9, rig.now_s)
    assert rig.executor.policy == ""
    rig.executor.link(5.0, rig.now_s)
    rig.settle()
    assert rig.executor.policy == "hold"
    rig.executor.link(0.0, rig.now_s)
    rig.settle()
    assert rig.state() == "paused"
    rig.steer("resume")
    assert rig.state() == "running"


def test_continue_does_nothing_about_a_condition(pelican: Platform) -> None:
    rig = flying(pelican, MISSION.replace("on_link_loss: hold", "on_link_loss: continue"))
    rig.arise(PolicyCondition.LINK_LOST)
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    assert "link lost; policy: continue" in rig.log


@pytest.mark.parametrize(
    ("condition", "running"),
    [
        (PolicyCondition.LOW_BATTERY, ["policy.return_home"]),
        (PolicyCondition.POSE_LOST, ["policy.land"]),
        (PolicyCondition.FENCE_BREACHED, []),
    ],
)
def test_each_condition_has_its_policy(rig: Rig, condition: PolicyCondition, running: list[str]) -> None:
    rig.arise(condition)
    assert rig.running() == running
    assert rig.executor.policy == (running[0].removeprefix("policy.").partition("_")[0] if running else "hold")


def test_the_most_severe_policy_wins_whatever_the_order(pelican: Platform) -> None:
    conditions = [PolicyCondition.LINK_LOST, PolicyCondition.LOW_BATTERY, PolicyCondition.POSE_LOST]
    for order in ((0, 1, 2), (2, 1, 0), (1, 2, 0)):
        rig = flying(pelican)
        for index in order:
            rig.arise(conditions[index])
        assert rig.running() == ["policy.land"]
        assert rig.executor.policy == "land"


def test_a_return_that_cannot_be_flown_becomes_a_landing(rig: Rig) -> None:
    rig.executor.available({"return_home": ("pose",)}, rig.now_s)
    rig.arise(PolicyCondition.LOW_BATTERY)
    rig.pass_s(5.5)
    assert rig.running() == ["policy.land"]
    rig = flying(rig.platform)
    rig.arise(PolicyCondition.LOW_BATTERY)
    rig.failed("policy.return_home")
    assert rig.running() == ["policy.land"]


def test_a_landing_is_tried_until_it_is_done(rig: Rig) -> None:
    rig.refusing["flight"] = "busy"
    rig.arise(PolicyCondition.POSE_LOST)
    rig.pass_s(3.5)
    assert rig.log.count("start policy.land") == 4
    rig.refusing.clear()
    rig.pass_s(1)
    rig.done("policy.land")
    assert rig.executor.policy == ""


def test_a_lost_pose_is_answered_by_its_own_policy_and_not_by_that_for_failures(pelican: Platform) -> None:
    text = MISSION.replace("on_pose_lost: land", "on_pose_lost: continue").replace(
        "on_failure: hold", "on_failure: land"
    )
    rig = flying(pelican, text)
    rig.arise(PolicyCondition.POSE_LOST)
    rig.executor.available({"follow_waypoints": ("pose",)}, rig.now_s)
    rig.pass_s(5)
    assert rig.state("sweep.wall") == "running"
    rig.arise(PolicyCondition.POSE_LOST, is_on=False)
    rig.pass_s(1)
    assert rig.running() == ["policy.land"]


@pytest.mark.parametrize(
    ("missing", "lasts_s"), [(("pose",), 3.5), (("pose", "autopilot_pose"), 3.5), (("pose", "limiter"), 1.5)]
)
def test_an_action_waits_for_a_late_pose_until_its_policy_would_have_acted(
    pelican: Platform, missing: tuple[str, ...], lasts_s: float
) -> None:
    rig = flying(pelican, MISSION)
    rig.executor.available({"follow_waypoints": missing}, rig.now_s)
    rig.pass_s(lasts_s - 0.1)
    assert rig.state("sweep.wall") == "running"
    rig.pass_s(0.2)
    assert rig.state("sweep.wall") != "running"


def test_conditions_on_the_ground_move_nothing_and_keep_a_mission_from_starting(pelican: Platform) -> None:
    rig = Rig(pelican, MISSION)
    rig.arise(PolicyCondition.LOW_BATTERY)
    assert rig.state("sweep") == "waiting"
    assert rig.under_way == {}
    with pytest.raises(Refused, match="low battery"):
        rig.start()
    rig.arise(PolicyCondition.LOW_BATTERY, is_on=False)
    rig.start()
    assert rig.running() == ["depart.climb"]


def test_conditions_count_in_the_air_also_without_a_mission(rig: Rig) -> None:
    rig.steer("skip")
    rig.arise(PolicyCondition.LOW_BATTERY)
    assert rig.running() == ["policy.return_home"]


# the emergency key


def test_the_emergency_key_holds_and_lands_whatever_else_is_going_on(rig: Rig) -> None:
    rig.arise(PolicyCondition.LOW_BATTERY)
    rig.executor.emergency("hold", "ann", rig.now_s)
    rig.settle()
    assert rig.grant.action_id == "hold"
    assert rig.under_way == {}
    rig.pass_s(100)
    assert rig.executor.policy == "hold"
    rig.executor.emergency("land", "ann", rig.now_s)
    rig.settle()
    assert rig.running() == ["policy.land"]
    assert "emergency land by ann" in rig.log


def test_after_an_emergency_hold_the_mission_can_go_on(rig: Rig) -> None:
    rig.executor.emergency("hold", "ann", rig.now_s)
    rig.settle()
    assert rig.state() == "paused"
    rig.steer("resume")
    assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_nothing_moves_the_vehicle_while_a_policy_does(rig: Rig) -> None:
    rig.arise(PolicyCondition.LOW_BATTERY)
    text = "{mission: c, frame: hold, tasks: {c: {actions: {go: {go_to: {position_m: [1, 1, 1]}}}}}}"
    with pytest.raises(Refused, match="the policy return is being carried out"):
        rig.executor.command(rig.read(text), rig.now_s)


def test_a_companion_that_was_left_out_while_it_waited_for_its_component_wakes_nobody(pelican: Platform) -> None:
    rig = flying(pelican, MISSION.replace("until: wall", "until: wall, retries: 1"))
    rig.executor.component_failed("images", "broken", rig.now_s)
    rig.settle()
    rig.done("sweep.wall")
    assert rig.state("sweep.photos") == "skipped"
    rig.pass_s(5.0)


@pytest.mark.parametrize("is_under_way", [False, True])
def test_a_return_waits_a_moment_for_what_performs_it(rig: Rig, is_under_way: bool) -> None:
    component = rig.executor.board.rows["return_home"].performed_by
    if not is_under_way:
        rig.executor.available({"return_home": (component,)}, rig.now_s)
    rig.arise(PolicyCondition.LOW_BATTERY)
    if is_under_way:
        rig.executor.component_failed(component, "crashed", rig.now_s)
        rig.settle()
    rig.pass_s(4.0)
    assert "policy.return_home" not in rig.running()
    assert "policy.land" not in rig.running()
    rig.executor.available({}, rig.now_s)
    rig.settle()
    assert rig.running() == ["policy.return_home"]
    rig.executor.component_failed(component, "crashed again", rig.now_s)
    rig.settle()
    rig.pass_s(5.5)
    assert rig.running() == ["policy.land"], "what stays away for 5 s is not waited for"
