"""A planned silence: a lost link is no fault until the stated time, then contact is overdue; the checker sees misfits."""

import pytest
from msgspec.structs import replace

from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.platform.platform import Failsafes, LinkLossFailsafe, Platform
from gloc3.store import MemoryRecords
from gloc3_onboard.command_server.site import Site

from .executor_rig import MISSION, Rig, flying

DIVE = MISSION.replace("    after: [depart]", "    after: [depart]\n    silence: {expected_s: 100}").replace(
    "on_link_loss: hold", "on_link_loss: land\non_overdue: return"
)


def silent(rig: Rig, seconds: float, already_s: float = 0.0) -> None:
    """Nothing is heard of the holder of control for so long, after so long a silence already."""
    begin_s = rig.now_s
    while rig.now_s < begin_s + seconds:
        rig.pass_s(1.0)
        rig.executor.link(already_s + rig.now_s - begin_s, rig.now_s)
        rig.settle()


def received(rig: Rig) -> None:
    """Something is heard of the holder of control."""
    rig.executor.link(0.0, rig.now_s)
    rig.settle()


def test_a_lost_link_is_no_fault_until_the_stated_time_and_then_contact_is_overdue(pelican: Platform) -> None:
    rig = flying(pelican, DIVE)
    silent(rig, 99.0)
    assert rig.executor.policy == ""
    assert not rig.executor.board.conditions
    silent(rig, 10.0, already_s=99.0)
    assert rig.executor.policy == "return"
    assert any("overdue: contact was due 100 s after sweep began; policy: return" in line for line in rig.log)


def test_without_a_policy_of_its_own_what_is_overdue_is_a_lost_link(pelican: Platform) -> None:
    rig = flying(pelican, DIVE.replace("on_overdue: return\n", ""))
    silent(rig, 110.0)
    assert rig.executor.policy == "land"


def test_who_is_heard_in_time_may_be_silent_again_as_long_as_the_mission_goes_on(pelican: Platform) -> None:
    rig = flying(pelican, DIVE)
    silent(rig, 50.0)
    received(rig)
    rig.done("sweep.wall")
    received(rig)
    silent(rig, 20.0)
    assert rig.executor.policy == "", "the stated time has not passed"
    rig.done("recover.home")
    rig.done("recover.down")
    assert rig.executor.board.silence is not None
    received(rig)
    assert rig.executor.board.silence is None, "the mission has ended, and there is contact"


def test_contact_at_its_time_ends_the_silence_and_from_then_on_a_lost_link_is_a_fault(pelican: Platform) -> None:
    rig = flying(pelican, DIVE)
    silent(rig, 95.0)
    rig.pass_s(6.0)
    received(rig)
    assert rig.executor.board.silence is None
    silent(rig, 7.0)
    assert rig.executor.policy == "land"


def test_who_is_heard_again_is_no_longer_overdue(pelican: Platform) -> None:
    rig = flying(pelican, DIVE.replace("on_overdue: return", "on_overdue: continue"))
    silent(rig, 110.0)
    assert list(rig.executor.board.conditions) == ["overdue"]
    rig.executor.link(0.0, rig.now_s)
    assert not rig.executor.board.conditions
    assert rig.executor.board.silence is None


def test_a_restart_below_keeps_the_stated_time(pelican: Platform) -> None:
    rig = flying(pelican, DIVE.replace("on_failure: hold", "on_restart: continue\non_failure: hold"))
    silent(rig, 60.0)
    rig = rig.restart(is_airborne=True)
    planned = rig.executor.board.silence
    assert planned is not None
    assert planned.until_s == pytest.approx(100.0, abs=0.5)
    rig.executor.link(60.0, rig.now_s)
    assert rig.executor.policy == ""


def test_after_a_reboot_the_stated_time_is_never_exceeded(pelican: Platform) -> None:
    rig = flying(pelican, DIVE)
    assert rig.kept is not None
    rig.now_s = -5000.0  # the computer's clock begins anew
    rig = rig.restart(is_airborne=False)
    assert rig.executor.board.silence is not None
    assert rig.executor.board.silence.until_s == -4900.0


def test_a_computer_that_starts_again_and_again_does_not_put_off_the_time(pelican: Platform) -> None:
    rig = flying(pelican, DIVE.replace("on_failure: hold", "on_restart: continue\non_failure: hold"))
    silent(rig, 61.0)
    files = MemoryRecords()
    for boot, left_s in enumerate((39.0, 31.0, 23.0)):
        assert rig.kept is not None
        Site(pelican, MemoryRecords(), files, MemoryRecords(), computer=f"start {boot}").keep_snapshot(rig.kept)
        rig.kept, _ = Site(pelican, MemoryRecords(), files, MemoryRecords(), computer=f"start {boot + 1}").load()
        rig.now_s = 8.0
        rig = rig.restart(is_airborne=True)
        assert rig.executor.board.silence is not None
        assert rig.executor.board.silence.until_s == pytest.approx(left_s, abs=1.0), boot
    silent(rig, 16.0, already_s=70.0)
    assert rig.executor.policy == "return"


def findings(text: str, platform: Platform) -> str:
    found = check_text(text, "m.yaml", Circumstances(platform=platform)).findings
    return "\n".join(map(str, found))


def test_the_checker_knows_what_does_not_fit_a_silence(pelican: Platform) -> None:
    dive = DIVE
    assert "silence" not in findings(dive, pelican)
    watched = replace(pelican, failsafes=Failsafes(link_loss=LinkLossFailsafe(action="land", after_s=30.0)))
    assert "a silence of 100 s is planned, but after 30 s the autopilot's failsafe is land" in findings(dive, watched)
    short = dive.replace("expected_s: 100", "expected_s: 4")
    assert "a silence of 4 s ends before link_loss_after_s (5 s)" in findings(short, pelican)
    assert "s are needed, but contact is due after 6 s" in findings(dive.replace("100", "6"), pelican)
    careless = dive.replace("on_overdue: return", "on_overdue: continue")
    assert "nothing is done onboard when contact is overdue (on_overdue: continue)" in findings(careless, pelican)
    idle = dive.replace("    silence: {expected_s: 100}\n", "")
    assert "no task or action has a planned silence" in findings(idle, pelican)
