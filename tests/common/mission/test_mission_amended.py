"""A running mission goes on by another text: tasks are added and taken away, and what has begun is not disturbed."""

import pytest
from tests.common.mission.executor_rig import Rig

from gloc3.errors import Refused
from gloc3.mission.executing.restore import restore
from gloc3.platform.platform import Platform

TEXT = """\
mission: places
frame: hold
on_failure: land
tasks:
  up: {platform: each, actions: {go: {take_off: {height_m: 3}}}}
  south: {platform: any, after: [up], actions: {go: {go_to: {position_m: [-9, 0, 3]}}}}
  north: {platform: any, after: [up], actions: {go: {go_to: {position_m: [9, 0, 3]}}}}
  east: {platform: any, after: [up], actions: {go: {go_to: {position_m: [0, -9, 3]}}}}
  down: {platform: each, after: [south, north, east], actions: {end: {land: {}}}}
"""
BEFORE = TEXT + "assigned: {pelican: [south, east], heron: [north]}\n"
AFTER = TEXT + "assigned: {pelican: [south, north], gannet: [east]}\n"


@pytest.fixture
def rig(pelican: Platform) -> Rig:
    """A pelican on its way south."""
    rig = Rig(pelican, BEFORE)
    rig.start()
    rig.done("up.go")
    rig.fly()
    assert rig.running() == ["south.go"]
    return rig


def test_what_runs_is_not_touched_and_what_is_new_comes_in_its_turn(rig: Rig) -> None:
    id_before, started = rig.id_of("south.go"), len(rig.started)
    rig.executor.amend(rig.read(AFTER), rig.now_s)
    rig.settle()
    assert (rig.id_of("south.go"), len(rig.started)) == (id_before, started)
    assert rig.state("up") == "done"
    assert "the mission goes on with north and without east" in rig.log
    rig.done("south.go")
    assert rig.running() == ["north.go"]
    rig.done("north.go")
    assert rig.running() == ["down.end"]
    rig.done("down.end")
    assert rig.state() == "done"


def test_a_restart_goes_on_by_the_new_text(rig: Rig, pelican: Platform) -> None:
    rig.executor.amend(rig.read(AFTER + "on_restart: continue\n"), rig.now_s)
    rig.settle()
    assert rig.kept is not None
    again = Rig(pelican, executor=restore(pelican, rig.kept, rig.read, True, rig.now_s))
    again.now_s = rig.now_s
    again.settle()
    assert again.running() == ["south.go"]
    again.done("south.go")
    assert again.running() == ["north.go"]


WAIT = "after: [up], retries: 1, when: {battery: {above: 0.5}}, otherwise: wait, deadline_s: 100"
AGAIN = "assigned: {pelican: [south], heron: [north, east]}\n"
TRIED = TEXT.replace("south: {platform: any, after: [up]", "south: {platform: any, " + WAIT)


@pytest.fixture
def tried(pelican: Platform) -> Rig:
    """A pelican that waits with its second attempt to go south until the battery is full again."""
    rig = Rig(pelican, TRIED + "assigned: {pelican: [south, east], heron: [north]}\n")
    rig.executor.sensed({"battery": 0.9}, 0.0)
    rig.start()
    rig.fly()
    rig.done("up.go")
    rig.executor.sensed({"battery": 0.4}, 0.0)
    rig.failed("south.go")
    rig.pass_s(50.0)
    assert rig.state("south") == "waiting"
    return rig


def test_what_waits_for_another_attempt_has_begun_and_has_no_more_attempts_by_another_text(tried: Rig) -> None:
    with pytest.raises(Refused, match="south has begun: it cannot be left out"):
        tried.executor.amend(tried.read(TRIED + "assigned: {pelican: [east], heron: [north, south]}\n"), tried.now_s)
    tried.executor.amend(tried.read(TRIED + AGAIN), tried.now_s)
    tried.executor.sensed({"battery": 0.9}, tried.now_s)
    tried.settle()
    assert tried.running() == ["south.go"]
    tried.failed("south.go")
    assert (tried.state("south"), tried.running()) == ("failed", ["policy.land"])


def test_what_waits_for_its_guard_has_waited_for_as_long_by_another_text(tried: Rig) -> None:
    tried.executor.amend(tried.read(TRIED + AGAIN), tried.now_s)
    tried.settle()
    tried.pass_s(49.0)
    assert tried.state("south") == "waiting"
    tried.pass_s(2.0)
    assert tried.state("south") == "failed"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            AFTER.replace("[south, north]", "[north]").replace("[east]", "[east, south]"),
            "south has begun: it cannot be left out",
        ),
        (AFTER.replace("[-9, 0, 3]", "[-8, 0, 3]"), "south has begun: its actions cannot be changed"),
        (AFTER.replace("[south, north]", "[north, south]"), "south has begun, and would come after north"),
        (AFTER + "geofence: {ceiling_m: 8}\n", "the geofence of a running mission cannot be changed"),
    ],
)
def test_what_would_change_what_has_begun_is_refused_and_nothing_changes(rig: Rig, text: str, reason: str) -> None:
    before = rig.executor.states()
    with pytest.raises(Refused, match=reason):
        rig.executor.amend(rig.read(text), rig.now_s)
    assert rig.executor.states() == before
    rig.done("south.go")
    assert rig.running() == ["east.go"]


def test_a_task_is_not_added_while_a_single_command_has_its_name(rig: Rig) -> None:
    photos = "tasks: {north: {actions: {photos: {record_images: {camera: ground, every_s: 1}}}}}\n"
    rig.executor.amend(
        rig.read(TEXT.replace("north", "west") + "assigned: {pelican: [south, east], heron: [west]}\n"), 0.0
    )
    rig.executor.command(rig.read("mission: photos\nframe: hold\n" + photos), rig.now_s)
    rig.settle()
    with pytest.raises(Refused, match="task 'north' already exists"):
        rig.executor.amend(rig.read(AFTER), rig.now_s)
    rig.steer("skip", "north")
    rig.executor.amend(rig.read(AFTER), rig.now_s)
    rig.done("south.go")
    assert rig.running() == ["north.go"]


def test_a_pilot_a_policy_and_an_end_come_first(rig: Rig) -> None:
    rig.executor.pilot(True, "stick", rig.now_s)
    with pytest.raises(Refused, match="the pilot has control"):
        rig.executor.amend(rig.read(AFTER), rig.now_s)
    rig.pass_s(1)
    rig.steer("resume")
    rig.executor.emergency("hold", "station 255", rig.now_s)
    with pytest.raises(Refused, match="hold"):
        rig.executor.amend(rig.read(AFTER), rig.now_s)
    rig.steer("abort")
    with pytest.raises(Refused, match="no mission is running"):
        rig.executor.amend(rig.read(AFTER), rig.now_s)
