"""Guards keep tasks and actions from beginning, and loops have tasks done again, by what is measured onboard."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3.errors import InputError
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.formats import exported
from gloc3.mission.model.conditions import QUANTITIES, Condition
from gloc3.mission.reading.reader import read_mission
from gloc3.mission.reading.writer import write_mission
from gloc3.mission.showing.show import drawing
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform

from .executor_rig import MISSION, Rig, flying

GUARDED = MISSION.replace("until: wall}", "until: wall, WHEN}")
LOOP = """\
mission: laps
frame: hold
on_failure: hold
tasks:
  up: {actions: {climb: {take_off: {height_m: 2}}}}
  laps:
    after: [up]
    repeat: {times: 3, until: {battery: {below: 0.5}}}
    actions:
      lap:  {go_to: {position_m: [10, 0, 2], speed_m_s: 1}}
      back: {go_to: {position_m: [0, 0, 2], speed_m_s: 1}, after: [lap]}
      look: {record_images: {camera: ground, every_s: 1}, until: back}
  end: {after: [laps], actions: {down: {land: {}}}}
"""


def checked(text: str, platform: Platform) -> CheckReport:
    return check_text(text, "m", Circumstances(platform=platform, home_ned_m=(0.0, 0.0, 0.0)))


def guarded(platform: Platform, when: str, **readings: float) -> Rig:
    """At the start of the sweep, whose pictures have the guard."""
    rig = Rig(platform, GUARDED.replace("WHEN", when))
    rig.executor.sensed(readings, 0.0)
    rig.start()
    rig.fly()
    rig.done("depart.climb")
    return rig


def sense(rig: Rig, **readings: float) -> None:
    rig.executor.sensed(readings, rig.now_s)
    rig.settle()


def test_an_action_whose_guard_holds_begins(pelican: Platform) -> None:
    rig = guarded(pelican, "when: {battery: {above: 0.4}}", battery=0.5)
    assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_one_whose_guard_does_not_hold_is_left_out_and_says_why(pelican: Platform) -> None:
    rig = guarded(pelican, "when: {battery: {above: 0.4}}", battery=0.3)
    assert rig.running() == ["sweep.wall"]
    assert rig.state("sweep.photos") == "skipped"
    assert "sweep.photos skipped: not battery above 40 %" in rig.log


def test_one_whose_guard_must_hold_fails_by_its_policy(pelican: Platform) -> None:
    rig = guarded(pelican, "when: {battery: {above: 0.4}}, otherwise: fail, on_failure: continue", battery=0.3)
    assert rig.state("sweep.photos") == "failed"
    assert rig.running() == ["sweep.wall"]


def test_one_that_waits_begins_when_its_guard_holds_and_its_deadline_counts_the_wait(pelican: Platform) -> None:
    rig = guarded(pelican, "when: {pose_quality: {above: 0.8}}, otherwise: wait, deadline_s: 20", pose_quality=0.5)
    assert rig.state("sweep.photos") == "waiting"
    assert rig.executor.states()["sweep.photos"] == "waiting"
    rig.pass_s(15.0)
    sense(rig, pose_quality=0.9)
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    rig.pass_s(6.0)
    assert rig.state("sweep.photos") == "failed"


def test_a_wait_that_takes_too_long_fails_and_says_what_it_waited_for(pelican: Platform) -> None:
    when = "when: {pose_quality: {above: 0.8}}, otherwise: wait, deadline_s: 20, on_failure: continue"
    rig = guarded(pelican, when, pose_quality=0.5)
    rig.pass_s(21.0)
    assert "sweep.photos failed: deadline passed while waiting for pose quality above 80 %" in rig.log


def test_a_pause_and_a_restart_stop_the_clock_of_a_wait(pelican: Platform) -> None:
    when = "when: {pose_quality: {above: 0.8}}, otherwise: wait, deadline_s: 20, on_failure: continue"
    rig = guarded(pelican, when, pose_quality=0.5)
    rig.pass_s(15.0)
    rig.steer("pause")
    rig.pass_s(25.0)
    assert rig.state("sweep.photos") == "waiting"
    back = rig.restart(is_airborne=True)
    sense(back, pose_quality=0.5)
    back.steer("resume")
    back.pass_s(4.0)
    assert back.state("sweep.photos") == "waiting"
    back.pass_s(2.0)
    assert back.state("sweep.photos") == "failed"


def test_what_is_not_measured_is_waited_for_a_moment_and_then_counts_as_not_met(pelican: Platform) -> None:
    rig = guarded(pelican, "when: {not: {altitude_m: {below: 3}}}")
    assert rig.state("sweep.photos") == "waiting"
    rig.pass_s(2.5)
    assert "sweep.photos skipped: not (altitude below 3 m) is not known" in rig.log


def test_a_task_whose_guard_does_not_hold_is_left_out_with_all_that_is_in_it(pelican: Platform) -> None:
    rig = flying(
        pelican, MISSION.replace("    after: [depart]", "    after: [depart]\n    when: {height_m: {above: 5}}")
    )
    rig.pass_s(3.0)
    assert (rig.state("sweep"), rig.state("sweep.wall")) == ("skipped", "skipped")
    assert rig.running() == ["recover.home"]


def lap(rig: Rig) -> None:
    rig.done("laps.lap")
    rig.done("laps.back")


def lapping(platform: Platform) -> Rig:
    rig = Rig(platform, LOOP)
    sense(rig, battery=0.9)
    rig.start()
    rig.fly()
    rig.done("up.climb")
    return rig


def test_a_task_is_done_as_often_as_is_said_with_all_its_actions_each_time(pelican: Platform) -> None:
    rig = lapping(pelican)
    for time in (1, 2, 3):
        task = rig.executor.board.programs["mission"].tasks["laps"]
        assert (task.repetition, rig.running()) == (time, ["laps.lap", "laps.look"])
        lap(rig)
    assert rig.running() == ["end.down"]
    assert [one.capability for one in rig.started].count("go_to") == 6


def test_a_loop_ends_early_when_its_condition_holds_after_a_time(pelican: Platform) -> None:
    rig = lapping(pelican)
    sense(rig, battery=0.4)
    assert rig.running() == ["laps.lap", "laps.look"]
    lap(rig)
    assert rig.running() == ["end.down"]


@pytest.mark.parametrize(("battery", "running"), [(0.45, ["end.down"]), (0.55, ["laps.lap", "laps.look"])])
def test_a_loop_waits_a_moment_for_what_is_not_measured_after_a_time(
    pelican: Platform, battery: float, running: list[str]
) -> None:
    rig = lapping(pelican)
    sense(rig)
    lap(rig)
    rig.pass_s(1.5)
    assert rig.running() == []
    sense(rig, battery=battery)
    assert rig.running() == running


def test_a_loop_goes_on_where_its_condition_stays_unknown_and_a_pause_begins_the_wait_anew(pelican: Platform) -> None:
    rig = lapping(pelican)
    sense(rig)
    lap(rig)
    rig.pass_s(1.5)
    rig.steer("pause")
    rig.pass_s(60.0)
    rig.steer("resume")
    rig.pass_s(1.5)
    assert rig.running() == []
    back = rig.restart(is_airborne=True)
    back.steer("resume")
    back.pass_s(2.5)
    assert back.running() == ["laps.lap", "laps.look"]
    assert back.executor.board.programs["mission"].tasks["laps"].repetition == 2
    lap(back)
    back.steer("skip", "laps")
    assert back.running() == ["end.down"]


def test_a_loop_whose_actions_were_all_aborted_is_over(pelican: Platform) -> None:
    rig = Rig(pelican, LOOP.replace("on_failure: hold", "on_failure: continue"))
    sense(rig, battery=0.9)
    rig.start()
    rig.fly()
    rig.done("up.climb")
    for action in ("look", "back"):
        rig.steer("abort", f"laps.{action}")
    assert rig.running() == ["laps.lap"]
    rig.steer("abort", "laps.lap")
    assert rig.state("laps") == "done"
    assert rig.running() == ["end.down"]


def test_a_paused_loop_does_not_begin_anew_and_a_skipped_one_ends(pelican: Platform) -> None:
    rig = lapping(pelican)
    rig.done("laps.lap")
    rig.steer("skip", "laps.look")
    rig.steer("pause", "laps")
    rig.steer("skip", "laps.back")
    assert rig.state("laps") == "paused"
    assert rig.running() == []
    rig.steer("resume", "laps")
    assert rig.running() == ["laps.lap", "laps.look"]
    rig.steer("skip", "laps")
    assert rig.running() == ["end.down"]


def test_a_restart_goes_on_in_the_lap_in_which_it_was(pelican: Platform) -> None:
    rig = lapping(pelican)
    lap(rig)
    rig.done("laps.lap")
    back = rig.restart(is_airborne=True)
    sense(back, battery=0.9)
    back.steer("resume")
    assert back.executor.board.programs["mission"].tasks["laps"].repetition == 2
    assert back.running() == ["laps.back", "laps.look"]
    back.done("laps.back")
    lap(back)
    assert back.running() == ["end.down"]


def test_the_estimate_of_a_loop_counts_every_lap_and_the_order_is_proved_for_two(pelican: Platform) -> None:
    once, thrice = (checked(LOOP.replace("times: 3", f"times: {n}"), pelican).estimate for n in (1, 3))
    assert once is not None
    assert thrice is not None
    assert thrice.length_m - once.length_m == pytest.approx(40.0)
    assert thrice.duration_s - once.duration_s == pytest.approx(2 * (20.0 + 2 * 1.0 / 2.5), abs=0.1)
    assert thrice.energy_wh > once.energy_wh
    up = LOOP.replace("lap:  {go_to: {position_m: [10, 0, 2], speed_m_s: 1}}", "lap:  {take_off: {height_m: 2}}")
    found = [str(one) for one in checked(up, pelican).findings]
    assert any("laps.lap takes off while in the air" in one for one in found)


def test_a_loop_s_deadline_counts_all_laps_and_an_action_s_each_one(pelican: Platform) -> None:
    assert checked(LOOP.replace("speed_m_s: 1}}\n", "speed_m_s: 1}, deadline_s: 15}\n"), pelican).is_ok
    late = checked(LOOP.replace("    repeat", "    deadline_s: 40\n    repeat"), pelican)
    assert any("up to 62 s may be needed, but deadline_s is 40" in str(one) for one in late.findings)


@pytest.mark.parametrize(
    ("when", "expected"),
    [
        ("when: {battery: {above: 0.4}}, otherwise: wait", "this wait may never end"),
        ("otherwise: fail", "no effect without when"),
        ("when: {batery: {above: 0.4}}", "unknown key 'batery' (did you mean 'battery'?)"),
        ("when: {battery: {}}", "above or below must be given"),
        ("when: {battery: {above: 0.4, below: 0.3}}", "above must be less than below"),
        ("when: {battery: {above: 0.4}, depth_m: {below: 3}}", "exactly one key, not 2"),
        ("when: {any: []}", "length >= 1"),
    ],
)
def test_guards_that_make_no_sense_are_told_with_their_place(pelican: Platform, when: str, expected: str) -> None:
    report = checked(GUARDED.replace("WHEN", when), pelican)
    assert not report.is_ok
    assert any(expected in str(one) and str(one).startswith("m:16:") for one in report.findings), report.findings


def test_guards_and_loops_are_drawn_in_words(pelican: Platform) -> None:
    text = LOOP.replace(
        "until: back}", "until: back, when: {all: [{depth_m: {below: 3}}, {not: {speed_m_s: {above: 2}}}]}}"
    )
    shown = drawing(checked(text, pelican), Circumstances(platform=pelican).capabilities(), pelican)
    assert "up to 3 times, until battery below 50 %" in shown
    assert "when depth below 3 m and not (speed above 2 m/s), else skip" in " ".join(shown.replace("│", "").split())


def test_every_quantity_is_a_key_of_a_condition_and_has_the_same_words() -> None:
    keys = set(Condition.__struct_encode_fields__) - {"all", "any", "not"}
    assert keys == set(QUANTITIES)


def test_a_platform_that_does_not_measure_what_a_guard_asks_for_is_named() -> None:
    text = LOOP.replace("{battery: {below: 0.5}}", "{altitude_m: {below: 1}}")
    rover = load_platform("rover")
    report = check_text(text.replace("hold", "site", 1), "m", Circumstances(platform=rover))
    assert any("altitude is not known on rover: no component publishes 'height'" in str(one) for one in report.findings)


def test_guards_and_loops_are_written_back_as_they_were_and_have_no_place_in_a_plan(pelican: Platform) -> None:
    text = LOOP.replace("until: back}", "until: back, when: {not: {depth_m: {above: 2}}}, otherwise: fail}")
    mission = checked(text, pelican).flyable()
    assert checked(write_mission(mission), pelican).flyable() == mission
    with pytest.raises(InputError) as caught:
        exported(read_mission(text.replace("hold", "geo", 1).replace("position_m", "position"), "m"), ".plan", "m")
    assert "laps is repeated, which a plan cannot express" in str(caught.value)
    assert "laps.look has a guard, which a plan cannot express" in str(caught.value)


readings = st.dictionaries(st.sampled_from(sorted(QUANTITIES)), st.floats(-10, 10))
leaves = st.sampled_from(sorted(QUANTITIES)).flatmap(
    lambda name: (st.floats(0, 1) if QUANTITIES[name].unit == "%" else st.floats(-10, 10)).map(
        lambda value: {name: {"above": value}}
    )
)
conditions = st.recursive(
    leaves,
    lambda inner: st.one_of(
        inner.map(lambda one: {"not": one}),
        st.lists(inner, min_size=1, max_size=3).map(lambda some: {"all": some}),
        st.lists(inner, min_size=1, max_size=3).map(lambda some: {"any": some}),
    ),
    max_leaves=6,
)


@given(written=conditions, known=readings, more=readings)
def test_what_is_known_of_a_condition_stays_true_when_more_is_measured(
    written: dict[str, object], known: dict[str, float], more: dict[str, float]
) -> None:
    condition = msgspec.convert(written, Condition)
    before = condition.holds(known)
    if before is not None:
        assert condition.holds(more | known) is before


def test_a_share_in_per_cent_is_refused_with_what_to_write(pelican: Platform) -> None:
    report = checked(
        LOOP.replace("battery: {below: 0.5}", "any: [{battery: {above: 30}}, {height_m: {above: 30}}]"), pelican
    )
    (finding,) = report.findings
    assert "battery is a share, 0 to 1: write 0.3 for 30 %" in str(finding)
