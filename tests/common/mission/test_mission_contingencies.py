"""A mission has tasks ready for a low battery, a lost link, a lost pose, an obstacle and a lost component."""

import pytest

from gloc3.errors import Refused
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.executing.board import PolicyCondition
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState
from gloc3.mission.reading.writer import single_action, write_mission
from gloc3.mission.showing.show import drawing
from gloc3.platform.platform import Platform

from .executor_rig import MISSION, Rig, flying

READY = """\
contingencies:
  look_round:
    actions:
      up:    {go_to: {position_m: [2, 2, 4]}}
      turn:  {hold: {duration_s: 5}, after: [up]}
  alcove:
    actions:
      away:  {go_to: {position_m: [0, 1, 2]}}
      down:  {land: {}, after: [away]}
"""


def mission(**answers: str) -> str:
    text = MISSION
    for key, answer in answers.items():
        lines = [line for line in text.splitlines() if not line.startswith(f"{key}:")]
        text = "\n".join([*lines[:2], f"{key}: {answer}", *lines[2:]]) + "\n"
    return text + READY


RESUMED = "{task: look_round, then: resume}"


def checked(text: str, platform: Platform) -> CheckReport:
    return check_text(text, "m", Circumstances(platform=platform, home_ned_m=(0.0, 0.0, 0.0)))


def found(text: str, platform: Platform) -> list[str]:
    return [str(one) for one in checked(text, platform).findings]


def looked_round(rig: Rig) -> None:
    rig.done("look_round.up")
    rig.done("look_round.turn")


def test_a_lost_link_has_its_task_run_and_the_mission_goes_on_where_it_was(pelican: Platform) -> None:
    rig = flying(pelican, mission(on_link_loss=RESUMED))
    rig.report(rig.id_of("sweep.wall"), ActionState.RUNNING, progress=0.4)
    rig.arise(PolicyCondition.LINK_LOST)
    assert rig.state() == "paused"
    assert rig.running() == ["look_round.up"]
    assert rig.executor.policy == "look_round"
    looked_round(rig)
    assert rig.state() == "running"
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    assert rig.started[-1].progress == pytest.approx(0.4)


def test_what_follows_a_task_is_done_when_it_has_ended_and_also_when_it_has_failed(pelican: Platform) -> None:
    for ends in (looked_round, lambda rig: rig.failed("look_round.up")):
        rig = flying(pelican, mission(on_low_battery="{task: look_round, then: return}"))
        rig.arise(PolicyCondition.LOW_BATTERY)
        ends(rig)
        while "look_round.turn" in rig.running():
            rig.done("look_round.turn")
        assert rig.running() == ["policy.return_home"]
        assert rig.state() == "failed"


def test_a_task_that_lands_ends_the_flight(pelican: Platform) -> None:
    rig = flying(pelican, mission(on_low_battery="{task: alcove, then: land}"))
    rig.arise(PolicyCondition.LOW_BATTERY)
    rig.done("alcove.away")
    rig.done("alcove.down")
    rig.fly(False)
    assert rig.state() == "failed"
    assert rig.running() == []
    assert rig.grant.action_id == ""


def test_something_more_severe_ends_it_and_something_less_severe_does_not(pelican: Platform) -> None:
    rig = flying(pelican, mission(on_link_loss=RESUMED, on_low_battery="{task: alcove, then: return}"))
    rig.arise(PolicyCondition.LOW_BATTERY)
    rig.arise(PolicyCondition.LINK_LOST)
    assert rig.running() == ["alcove.away"]
    rig.arise(PolicyCondition.POSE_LOST)
    assert rig.running() == ["policy.land"]
    assert rig.executor.policy == "land"


def test_an_obstacle_that_stays_in_the_way_has_its_task_run(pelican: Platform) -> None:
    rig = flying(pelican, mission(on_obstacle=RESUMED, obstacle_after_s="4"))
    action_id = rig.id_of("sweep.wall")

    def see(is_blocked: bool) -> None:
        status = ActionStatus(action_id=action_id, state=ActionState.RUNNING, progress=0.3, is_blocked=is_blocked)
        rig.executor.reported(status, rig.now_s)
        rig.settle()

    def wait(seconds: float) -> None:
        rig.report(rig.id_of("sweep.photos"), ActionState.RUNNING)
        rig.now_s += seconds
        rig.executor.tick(rig.now_s)
        rig.settle()

    see(True)
    wait(2.0)
    see(False)
    see(True)
    wait(3.0)
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    wait(1.5)
    assert rig.running() == ["look_round.up"]
    looked_round(rig)
    assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_a_lost_component_has_its_task_run_unless_its_row_says_land(pelican: Platform) -> None:
    for policy, expected in ((Policy.HOLD, ["look_round.up"]), (Policy.LAND, ["policy.land"])):
        rig = flying(pelican, mission(on_component_fault=RESUMED))
        rig.executor.component_lost("images", policy, "burnt", rig.now_s)
        rig.settle()
        assert rig.running() == expected
    rig = flying(pelican, mission(on_component_fault="return"))
    rig.executor.component_lost("images", Policy.HOLD, "burnt", rig.now_s)
    rig.settle()
    assert rig.running() == ["policy.return_home"]


def test_operators_pause_resume_and_skip_it_and_cannot_resume_the_mission_under_it(pelican: Platform) -> None:
    rig = flying(pelican, mission(on_link_loss=RESUMED))
    rig.arise(PolicyCondition.LINK_LOST)
    with pytest.raises(Refused, match="the contingency look_round is under way"):
        rig.steer("resume")
    single = rig.read(single_action("x", "hold", {}, None, "hold"))
    with pytest.raises(Refused, match="the contingency look_round is under way"):
        rig.executor.command(single, rig.now_s)
    rig.steer("pause", "look_round")
    assert rig.running() == []
    rig.steer("resume", "look_round")
    assert rig.running() == ["look_round.up"]
    rig.steer("skip", "look_round")
    assert rig.running() == ["sweep.photos", "sweep.wall"]


@pytest.mark.parametrize(
    ("on_failure", "then", "policy"),
    [("hold", "resume", "hold"), ("land", "resume", "land"), ("hold", "land", "land"), ("land", "land", "land")],
)
def test_an_abort_of_the_mission_ends_it_and_the_more_severe_of_what_follows_both_is_done(
    pelican: Platform, on_failure: str, then: str, policy: str
) -> None:
    rig = flying(pelican, mission(on_failure=on_failure, on_link_loss=f"{{task: look_round, then: {then}}}"))
    rig.arise(PolicyCondition.LINK_LOST)
    rig.steer("abort")
    assert (rig.state(), rig.state("look_round.up"), rig.executor.policy) == ("aborted", "aborted", policy)
    assert rig.running() == ([] if policy == "hold" else ["policy.land"])


def test_operators_steer_it_also_where_a_single_task_of_its_name_has_ended(pelican: Platform) -> None:
    rig = flying(pelican, mission(on_link_loss=RESUMED))
    rig.steer("pause")
    single = single_action("look_round", "hold", {"duration_s": 5}, None, "hold")
    rig.executor.command(rig.read(single), rig.now_s)
    rig.settle()
    rig.done("look_round.hold")
    rig.steer("resume")
    rig.arise(PolicyCondition.LINK_LOST)
    assert rig.running() == ["look_round.up"]
    rig.steer("pause", "look_round")
    assert rig.running() == []
    rig.steer("skip", "look_round")
    assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_a_pilot_ends_it_and_on_the_ground_none_begins(pelican: Platform) -> None:
    rig = flying(pelican, mission(on_link_loss=RESUMED))
    rig.arise(PolicyCondition.LINK_LOST)
    rig.executor.pilot(True, "sticks", rig.now_s)
    rig.settle()
    assert rig.running() == []
    assert rig.state("look_round") == "aborted"
    rig = flying(pelican, mission(on_link_loss=RESUMED))
    rig.fly(False)
    rig.arise(PolicyCondition.LINK_LOST)
    assert "look_round" not in rig.executor.states()


@pytest.mark.parametrize(("on_restart", "expected"), [("continue", ["look_round.up"]), ("hold", [])])
def test_a_restart_takes_it_up_again_or_holds_as_the_mission_says(
    pelican: Platform, on_restart: str, expected: list[str]
) -> None:
    rig = flying(pelican, mission(on_link_loss=RESUMED, on_restart=on_restart))
    rig.arise(PolicyCondition.LINK_LOST)
    back = rig.restart(is_airborne=True)
    assert back.running() == expected
    if expected:
        looked_round(back)
        assert back.running() == ["sweep.photos", "sweep.wall"]


def test_a_mission_that_cannot_go_on_afterwards_holds_and_says_why(pelican: Platform) -> None:
    rig = flying(pelican, mission(on_link_loss=RESUMED))
    rig.arise(PolicyCondition.LINK_LOST)
    rig.executor.available({"follow_waypoints": ("laser",)}, rig.now_s)
    looked_round(rig)
    assert rig.state() == "paused"
    assert rig.executor.policy == "hold"
    assert "the mission cannot continue: follow_waypoints is not available: it lacks laser" in rig.log


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (mission(on_link_loss="{task: look_around}"), "there is no contingency 'look_around' (did you mean 'look_round'?)"),
        (mission(on_pose_lost="{task: alcove}"), "away cannot be flown when the pose is lost"),
        (mission().replace("  alcove:", "  sweep:"), "'sweep' is also the name of a task"),
        (mission().replace("  alcove:\n", "  alcove:\n    after: [look_round]\n"), "a contingency cannot have after"),
        (mission().replace("after: [away]", "after: [away], on_failure: hold"), "on_failure: hold inside a contingency"),
        (mission().replace("after: [away]", "after: [way]"), "no action 'way' here"),
        (mission().replace("[0, 1, 2]", "[0, 1, 99]"), "99.0 m above home"),
        (mission().replace("away:  {go_to", "away:  {goto"), "unknown capability 'goto'"),
        (mission().replace("away:  {", "away:  {deadline_s: 0.1, "), "are needed, but deadline_s is 0.1"),
        (mission(), "warning: no policy names 'alcove'"),
    ],
)  # fmt: skip
def test_contingencies_are_proved_like_tasks(pelican: Platform, text: str, expected: str) -> None:
    assert any(expected in one for one in found(text, pelican)), found(text, pelican)


def test_contingencies_are_drawn_and_written_back(pelican: Platform) -> None:
    text = mission(on_link_loss=RESUMED, on_low_battery="{task: alcove, then: land}")
    report = checked(text, pelican)
    read = report.flyable()
    assert checked(write_mission(read), pelican).flyable() == read
    shown = drawing(report, Circumstances(platform=pelican).capabilities(), pelican)
    assert "link loss look_round then resume" in shown
    assert "failsafe policies:\n" in shown
