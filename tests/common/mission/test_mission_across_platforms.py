"""One mission file for two platforms: each performs its own tasks, and waits for what is told of the other's."""

import msgspec
import pytest

from gloc3.errors import InputError, Refused
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.model.states import ActionState
from gloc3.platform.platform import Platform

from .executor_rig import FRAMES, Rig

TEXT = """\
mission: two in the hold
frame: hold
on_failure: hold
hold_s: 30
tasks:
  rise:
    platform: pelican
    actions: {climb: {take_off: {height_m: 2}}}
  look:
    platform: pelican
    after: [rise]
    actions: {wall: {follow_waypoints: {waypoints_m: [[2, 1, 2]]}}}
  follow:
    platform: hummingbird
    after: [look]
    actions: {climb: {take_off: {height_m: 2}}, home: {return_home: {}, after: [climb]}, down: {land: {}, after: [home]}}
  back:
    platform: pelican
    after: [follow]
    actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}
"""


@pytest.fixture
def hummingbird(pelican: Platform) -> Platform:
    return msgspec.structs.replace(pelican, platform="hummingbird")


class Pair:
    """Both platforms, with somebody between them who passes on what each is at."""

    def __init__(self, pelican: Platform, hummingbird: Platform, text: str = TEXT) -> None:
        self.pelican, self.hummingbird = Rig(pelican, text), Rig(hummingbird, text)
        for rig in (self.pelican, self.hummingbird):
            rig.fly(is_airborne=False)
            rig.start()

    def report(self) -> None:
        for reported, of in ((self.pelican, self.hummingbird), (self.hummingbird, self.pelican)):
            program = of.executor.mission
            assert program is not None
            states = {task.target: task.state for task in program.own_tasks}
            reported.executor.elsewhere(of.platform.platform, program.state, states, reported.now_s)
            reported.settle()

    def pass_s(self, seconds: int) -> None:
        for _ in range(seconds):
            self.pelican.pass_s(1.0)
            self.hummingbird.pass_s(1.0)
            self.report()


@pytest.fixture
def pair(pelican: Platform, hummingbird: Platform) -> Pair:
    return Pair(pelican, hummingbird)


def looked(pair: Pair) -> None:
    """The first has looked, and hovers until the second has followed."""
    pair.pelican.done("rise.climb")
    pair.pelican.fly()
    pair.pelican.done("look.wall")


def test_each_performs_its_own_tasks_and_waits_for_the_other(pair: Pair) -> None:
    assert pair.pelican.running() == ["rise.climb"]
    assert pair.hummingbird.running() == []
    looked(pair)
    assert pair.hummingbird.running() == []
    pair.report()
    assert pair.hummingbird.running() == ["follow.climb"]
    assert pair.pelican.running() == []
    pair.hummingbird.done("follow.climb")
    pair.hummingbird.fly()
    pair.hummingbird.done("follow.home")
    pair.hummingbird.done("follow.down")
    assert pair.hummingbird.state() == "done"
    pair.report()
    assert pair.pelican.running() == ["back.home"]
    assert pair.pelican.state("follow") == "done"


def test_a_task_of_another_platform_is_neither_checked_nor_claimed_here(pelican: Platform) -> None:
    frames = Circumstances(platform=pelican, frames=FRAMES)
    text = TEXT.replace("return_home: {}, after: [climb]", "turn_somersaults: {}, after: [climb]")
    report = check_text(text, "mission.yaml", frames)
    assert report.is_ok, report.findings
    assert report.estimate is not None
    assert {target.partition(".")[0] for target in report.estimate.actions} == {"rise", "look", "back"}


def test_its_order_counts_all_the_same(pelican: Platform) -> None:
    text = TEXT.replace("after: [look]\n", "after: [back]\n")
    report = check_text(text, "mission.yaml", Circumstances(platform=pelican, frames=FRAMES))
    assert any("wait for each other" in finding.message for finding in report.findings)


def test_each_task_names_its_platform_or_none_does(pelican: Platform) -> None:
    with pytest.raises(InputError, match="task 'rise' names no platform, and others do"):
        Rig(pelican, TEXT.replace("    platform: pelican\n", "", 1))


def test_a_mission_without_a_task_for_it_is_refused(pelican: Platform) -> None:
    text = TEXT.replace("pelican", "albatross")
    report = check_text(text, "mission.yaml", Circumstances(platform=pelican, frames=FRAMES))
    assert [finding.message for finding in report.findings if not finding.is_warning] == ["no task names pelican"]


def test_a_silent_platform_is_lost_after_its_time_and_the_policy_holds(pair: Pair) -> None:
    looked(pair)
    pair.pass_s(20)
    assert pair.pelican.executor.policy == ""
    pair.pelican.pass_s(9.9)
    assert pair.pelican.executor.policy == ""
    pair.pelican.pass_s(0.2)
    assert pair.pelican.executor.policy == "hold"
    assert "platform lost: hummingbird: no report for 10 s; policy: hold" in pair.pelican.log
    pair.pass_s(1)
    assert "platform lost: over" in pair.pelican.log
    pair.pelican.steer("resume")
    assert pair.pelican.state() == "running"


def test_nobody_minds_a_silent_platform_that_is_not_waited_for(pair: Pair) -> None:
    pair.pelican.pass_s(100)
    assert pair.pelican.executor.policy == ""
    assert pair.pelican.running() == ["rise.climb"]


@pytest.mark.parametrize(("policy", "expected"), [("return", "return"), ("land", "land"), ("abort", "hold")])
def test_the_policy_is_the_mission_s(pelican: Platform, hummingbird: Platform, policy: str, expected: str) -> None:
    pair = Pair(pelican, hummingbird, f"{TEXT}on_platform_loss: {policy}\nplatform_loss_after_s: 3\n")
    looked(pair)
    pair.pelican.pass_s(3.1)
    assert pair.pelican.executor.policy == expected


def test_skip_goes_on_without_the_lost_platform(pelican: Platform, hummingbird: Platform) -> None:
    pair = Pair(pelican, hummingbird, f"{TEXT}on_platform_loss: skip\n")
    looked(pair)
    pair.pelican.pass_s(10.1)
    assert pair.pelican.state("follow") == "skipped"
    assert pair.pelican.running() == ["back.home"]
    pair.report()
    assert pair.pelican.state("follow") == "skipped"


THREE = """\
mission: three
frame: hold
hold_s: 1000
platform_loss_after_s: 10
tasks:
  rise: {platform: pelican, actions: {climb: {take_off: {height_m: 2}}}}
  one: {platform: hummingbird, actions: {climb: {take_off: {height_m: 2}}}}
  two: {platform: albatross, actions: {climb: {take_off: {height_m: 2}}}}
  back: {platform: pelican, after: [rise, one, two], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""


def risen(pelican: Platform, text: str) -> Rig:
    rig = Rig(pelican, text)
    rig.start()
    rig.fly()
    rig.done("rise.climb")
    return rig


def test_skip_goes_on_without_two_lost_platforms(pelican: Platform) -> None:
    rig = risen(pelican, f"{THREE}on_platform_loss: skip\n")
    rig.pass_s(10.1)
    assert (rig.state("one"), rig.state("two"), rig.running()) == ("skipped", "skipped", ["back.home"])
    rig = risen(pelican, f"{THREE}on_platform_loss: skip\n")
    rig.pass_s(5)
    rig.executor.elsewhere("albatross", ActionState.RUNNING, {"two": ActionState.RUNNING}, rig.now_s)
    rig.pass_s(5.1)
    assert (rig.state("one"), rig.state("two"), rig.running()) == ("skipped", "running", [])
    rig.pass_s(5)
    assert rig.state("two") == "skipped"
    assert rig.running() == ["back.home"]


def test_the_loss_of_another_platform_is_answered_although_one_is_lost_already(pelican: Platform) -> None:
    rig = risen(pelican, THREE)
    rig.pass_s(5)
    rig.executor.elsewhere("albatross", ActionState.RUNNING, {"two": ActionState.RUNNING}, rig.now_s)
    rig.pass_s(5.1)
    assert rig.executor.policy == "hold"
    rig.steer("resume")
    rig.pass_s(3)
    assert rig.executor.policy == ""
    rig.pass_s(2)
    assert rig.executor.policy == "hold"
    assert "platform lost: albatross: no report for 10 s; policy: hold" in rig.log
    rig.steer("resume")
    rig.pass_s(300)
    assert rig.executor.policy == "", "each loss is answered once"


def flown_once(pair: Pair) -> None:
    """Both have flown the mission; then it is loaded again on the first."""
    looked(pair)
    pair.report()
    pair.hummingbird.fly()
    for target in ("follow.climb", "follow.home", "follow.down"):
        pair.hummingbird.done(target)
    pair.hummingbird.fly(is_airborne=False)
    pair.report()
    pair.pelican.done("back.home")
    pair.pelican.done("back.down")
    pair.pelican.fly(is_airborne=False)
    assert (pair.pelican.state(), pair.hummingbird.state()) == ("done", "done")
    load_again(pair.pelican)
    pair.report()


def load_again(rig: Rig, text: str = TEXT) -> None:
    rig.executor.load(rig.read(text), rig.now_s)
    rig.seen = {}
    rig.settle()


def test_what_another_platform_did_in_an_earlier_run_of_the_mission_does_not_count(pair: Pair) -> None:
    flown_once(pair)
    assert pair.pelican.state("follow") == "waiting"
    pair.pelican.start()
    looked(pair)
    pair.report()
    assert pair.pelican.running() == []
    load_again(pair.hummingbird)
    pair.hummingbird.start()
    pair.report()
    assert pair.hummingbird.running() == ["follow.climb"]
    assert pair.pelican.running() == []
    pair.hummingbird.fly()
    for target in ("follow.climb", "follow.home", "follow.down"):
        pair.hummingbird.done(target)
    pair.report()
    assert pair.pelican.running() == ["back.home"]


def test_a_platform_that_does_not_load_the_mission_again_is_lost_with_that_reason(pair: Pair) -> None:
    flown_once(pair)
    pair.pelican.start()
    looked(pair)
    pair.pass_s(9)
    assert pair.pelican.executor.policy == ""
    pair.pass_s(2)
    assert pair.pelican.executor.policy == "hold"
    assert any(
        "hummingbird: its mission is done from an earlier run; start it there" in line for line in pair.pelican.log
    )
    pair.pelican.steer("skip", "follow")
    pair.pelican.steer("resume")
    assert pair.pelican.running() == ["back.home"]


def test_a_mission_that_was_aborted_there_in_an_earlier_run_is_no_loss_in_the_next(pair: Pair) -> None:
    pair.report()
    pair.hummingbird.steer("abort")
    pair.pelican.fly()
    pair.pelican.steer("abort")
    pair.pelican.fly(is_airborne=False)
    load_again(pair.pelican)
    pair.pelican.start()
    looked(pair)
    pair.report()
    assert pair.pelican.executor.policy == ""
    load_again(pair.hummingbird)
    pair.hummingbird.start()
    pair.report()
    pair.report()
    assert (pair.pelican.state("follow"), pair.pelican.executor.policy) == ("running", "")


def test_a_task_that_was_skipped_there_in_an_earlier_run_is_waited_for_in_the_next(pair: Pair) -> None:
    pair.report()
    pair.hummingbird.steer("skip", "follow")
    looked(pair)
    pair.report()
    assert pair.pelican.state("follow") == "skipped"
    for target in ("back.home", "back.down"):
        pair.pelican.done(target)
    pair.pelican.fly(is_airborne=False)
    for rig in (pair.pelican, pair.hummingbird):
        load_again(rig)
        pair.report()
    for rig in (pair.pelican, pair.hummingbird):
        rig.start()
    looked(pair)
    assert (pair.pelican.state("follow"), pair.pelican.running()) == ("waiting", [])


def test_an_end_that_is_reported_after_a_restart_here_counts(pair: Pair) -> None:
    looked(pair)
    pair.report()
    again = pair.pelican.restart(is_airborne=True)
    again.executor.elsewhere("hummingbird", ActionState.DONE, {"follow": ActionState.SKIPPED}, again.now_s)
    again.steer("resume")
    assert again.running() == ["back.home"]


def test_continue_waits_on(pelican: Platform, hummingbird: Platform) -> None:
    pair = Pair(pelican, hummingbird, f"{TEXT}on_platform_loss: continue\n")
    looked(pair)
    pair.pelican.pass_s(300)
    assert pair.pelican.executor.policy == ""
    assert pair.pelican.state() == "running"
    pair.report()
    assert pair.hummingbird.running() == ["follow.climb"]


def test_a_platform_that_gives_the_mission_up_is_lost_at_once(pair: Pair) -> None:
    looked(pair)
    pair.report()
    pair.hummingbird.steer("abort")
    pair.report()
    assert pair.pelican.executor.policy == "hold"
    assert pair.pelican.running() == []
    assert pair.pelican.state("follow") == "failed"


def test_a_failure_there_that_its_policy_goes_on_from_counts_as_an_end(
    pelican: Platform, hummingbird: Platform
) -> None:
    text = TEXT.replace("after: [look]\n", "after: [look]\n    on_failure: continue\n")
    pair = Pair(pelican, hummingbird, text)
    looked(pair)
    pair.report()
    pair.hummingbird.fly()
    pair.hummingbird.failed("follow.climb")
    pair.hummingbird.done("follow.home")
    pair.hummingbird.done("follow.down")
    pair.report()
    assert pair.pelican.state("follow") == "failed"
    assert pair.pelican.running() == ["back.home"]


def test_a_failure_there_that_waits_for_an_operator_is_waited_for(pair: Pair) -> None:
    looked(pair)
    pair.report()
    pair.hummingbird.fly()
    pair.hummingbird.failed("follow.climb")
    pair.pass_s(5)
    assert pair.hummingbird.state() == "paused"
    assert pair.pelican.state("follow") == "failed"
    assert pair.pelican.running() == []


def test_a_task_of_another_platform_can_only_be_skipped_here(pair: Pair) -> None:
    looked(pair)
    for verb in ("abort", "pause", "start"):
        with pytest.raises(Refused, match="follow belongs to hummingbird; command it there"):
            pair.pelican.steer(verb, "follow")
    pair.pelican.steer("skip", "follow")
    assert pair.pelican.running() == ["back.home"]


def test_pause_and_abort_leave_the_other_platform_s_tasks_as_they_are(pair: Pair) -> None:
    looked(pair)
    pair.report()
    pair.report()
    assert pair.pelican.state("follow") == "running"
    pair.pelican.steer("pause")
    assert pair.pelican.state("follow") == "running"
    pair.pelican.steer("abort")
    assert pair.pelican.state("follow") == "running"
    assert pair.pelican.state("back") == "aborted"


def test_what_was_told_survives_a_restart_and_the_others_must_be_heard_anew(pair: Pair) -> None:
    looked(pair)
    pair.report()
    pair.report()
    again = pair.pelican.restart(is_airborne=True)
    assert again.state("follow") == "running"
    again.steer("resume")
    again.pass_s(10.1)
    assert "platform lost: hummingbird: no report for 10 s; policy: hold" in again.log
    again.executor.elsewhere("hummingbird", ActionState.DONE, {"follow": ActionState.DONE}, again.now_s)
    again.steer("resume")
    assert again.running() == ["back.home"]


def test_what_is_told_of_a_stranger_changes_nothing(pair: Pair) -> None:
    looked(pair)
    pair.pelican.executor.elsewhere("albatross", ActionState.DONE, {"follow": ActionState.DONE}, 0.0)
    assert pair.pelican.state("follow") == "waiting"


def test_each_part_is_checked_for_its_own_platform_and_all_findings_come_at_once(
    pelican: Platform, hummingbird: Platform
) -> None:
    text = TEXT.replace("[[2, 1, 2]]", "[[2, 1, 200]]").replace(
        "take_off: {height_m: 2}}, home", "take_off: {height_m: 99}}, home"
    )
    known = {"pelican": pelican, "hummingbird": hummingbird}
    report = check_text(text, "mission.yaml", Circumstances(known=known.get, frames=FRAMES))
    heights = [(finding.line, finding.message) for finding in report.findings if "above home" in finding.message]
    assert [(line, message.partition(";")[0]) for line, message in heights[:2]] == [
        (12, "waypoint 1 is 200.0 m above home"),
        (16, "climb's end is 99.0 m above home"),
    ]
    assert check_text(TEXT, "mission.yaml", Circumstances(known=known.get, frames=FRAMES)).is_ok
    assert check_text(TEXT, "mission.yaml", Circumstances(frames=FRAMES)).is_ok


def test_a_platform_that_nobody_knows_is_warned_of_with_the_nearest_name() -> None:
    text = TEXT.replace("platform: hummingbird", "platform: hummingbrd")
    (warning,) = check_text(text, "mission.yaml", Circumstances(frames=FRAMES)).findings
    assert warning.is_warning
    assert "'hummingbrd' is not known here" in warning.message
    assert "hummingbird" in warning.hint
