"""The executor runs the partial order, and obeys operators at the three levels while flying."""

import pytest

from gloc3.errors import Refused
from gloc3.mission.executing.requests import Grant
from gloc3.mission.model.states import ActionState
from gloc3.mission.reading.writer import single_action
from gloc3.platform.platform import Platform

from .executor_rig import Rig

MISSION = """\
mission: test
frame: hold
on_failure: land
hold_s: 30
tasks:
  depart:
    actions:
      climb:  {take_off: {height_m: 1.5}}
  sweep:
    after: [depart]
    actions:
      wall:   {follow_waypoints: {waypoints_m: [[2, 1, 2], [16, 1, 2]], speed_m_s: 0.5}}
      photos: {record_images: {camera: ground, every_m: 0.5}, until: wall}
  recover:
    after: [sweep]
    actions:
      pause:  {wait: {duration_s: 5}}
      home:   {return_home: {}, after: [pause]}
      down:   {land: {}, after: [home]}
"""


@pytest.fixture
def rig(pelican: Platform) -> Rig:
    return Rig(pelican, MISSION)


def sweep(rig: Rig) -> Rig:
    """Flies up to the middle of the sweep."""
    rig.start()
    rig.fly()
    rig.done("depart.climb")
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    return rig


def test_a_mission_runs_from_its_start_to_its_end(rig: Rig) -> None:
    assert rig.state() == "waiting"
    rig.start()
    assert rig.running() == ["depart.climb"]
    assert rig.grant == Grant(action_id="depart.climb#1", component="flight")
    rig.fly()
    rig.done("depart.climb")
    assert rig.state("depart") == "done"
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    order = rig.started[1]
    assert order.arguments["waypoints_ned_m"][0] == pytest.approx((2.0, -1.0, -2.0))
    assert rig.executor.claims() == {"motion": "sweep.wall", "camera": "sweep.photos"}
    rig.report(rig.id_of("sweep.wall"), ActionState.RUNNING, progress=0.4)
    assert rig.executor.progress() == {"sweep.wall": 0.4, "sweep.photos": 0.0}
    rig.done("sweep.wall")
    assert rig.state("sweep.photos") == "done"
    assert rig.running() == []
    assert rig.grant.action_id == "hold"
    rig.pass_s(4.9)
    assert rig.state("recover.pause") == "running"
    rig.pass_s(0.2)
    assert rig.running() == ["recover.home"]
    rig.done("recover.home")
    rig.done("recover.down")
    assert rig.state() == "done"
    assert rig.grant == Grant(action_id="", component="")
    rig.fly(is_airborne=False)
    assert rig.executor.policy == ""
    assert rig.executor.next_tick_s() is None


def test_pausing_the_mission_holds_and_resuming_it_goes_on(rig: Rig) -> None:
    sweep(rig)
    rig.steer("pause")
    assert [rig.state(), rig.state("sweep"), rig.state("sweep.wall"), rig.state("sweep.photos")] == ["paused"] * 4
    assert set(rig.under_way.values()) == {"paused"}
    assert rig.grant == Grant(action_id="hold", component="flight")
    rig.pass_s(500)
    assert rig.state() == "paused"
    rig.steer("resume")
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    assert rig.grant.action_id == rig.id_of("sweep.wall")
    assert rig.state("sweep") == "running"


def test_an_action_paused_by_itself_stays_paused_when_the_mission_is_resumed(rig: Rig) -> None:
    sweep(rig)
    rig.steer("pause", "sweep.photos")
    rig.steer("pause")
    with pytest.raises(Refused, match="the mission is paused; resume it first"):
        rig.steer("resume", "sweep.photos")
    rig.steer("resume")
    assert rig.running() == ["sweep.wall"]
    rig.steer("resume", "sweep.photos")
    assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_a_paused_task_begins_nothing_new(rig: Rig) -> None:
    sweep(rig)
    rig.done("sweep.wall")
    rig.steer("pause", "recover")
    rig.pass_s(10)
    assert rig.state("recover.pause") == "paused"
    rig.steer("resume", "recover")
    rig.pass_s(6)
    assert rig.running() == ["recover.home"]


def test_skipping_an_action_starts_what_comes_after_it(rig: Rig) -> None:
    sweep(rig)
    rig.steer("skip", "sweep.wall")
    assert rig.state("sweep.wall") == "skipped"
    assert rig.state("sweep.photos") == "done"
    assert rig.under_way == {}
    assert rig.state("recover.pause") == "running"


def test_skipping_a_task_skips_what_is_in_it(rig: Rig) -> None:
    sweep(rig)
    rig.steer("skip", "sweep")
    assert [rig.state("sweep"), rig.state("sweep.wall"), rig.state("sweep.photos")] == ["skipped"] * 3
    rig.steer("skip", "recover")
    assert rig.state() == "done"
    assert rig.grant.action_id == "hold"


def test_skipping_the_mission_leaves_the_vehicle_in_a_hold(rig: Rig) -> None:
    sweep(rig)
    rig.steer("skip")
    assert rig.state() == "skipped"
    assert rig.grant.action_id == "hold"
    assert rig.under_way == {}


def test_aborting_cancels_everything_and_does_what_the_mission_says_on_failure(rig: Rig) -> None:
    sweep(rig)
    rig.steer("abort")
    assert rig.state() == "aborted"
    assert rig.state("recover.down") == "aborted"
    assert rig.state("depart") == "done"
    assert rig.running() == ["policy.land"]
    assert rig.executor.policy == "land"
    assert rig.grant.action_id == rig.id_of("policy.land")
    rig.done("policy.land")
    assert rig.executor.policy == ""
    assert rig.grant.action_id == ""


def test_aborting_on_the_ground_ends_the_mission_and_moves_nothing(rig: Rig) -> None:
    rig.steer("abort")
    assert rig.state() == "aborted"
    assert rig.under_way == {}
    assert rig.executor.policy == ""


@pytest.mark.parametrize(("on_failure", "running"), [("land", ["policy.land"]), ("skip", ["sweep.photos"])])
def test_aborting_an_action_is_followed_by_the_mission_s_on_failure(
    pelican: Platform, on_failure: str, running: list[str]
) -> None:
    text = MISSION.replace("on_failure: land", f"on_failure: {on_failure}").replace(", until: wall", "")
    rig = sweep(Rig(pelican, text))
    rig.steer("abort", "sweep.wall")
    assert rig.state("sweep.wall") == "aborted"
    assert rig.running() == running


@pytest.mark.parametrize(
    ("verb", "target", "reason"),
    [
        ("start", "", "start is not accepted in running; accepted: pause, skip, abort"),
        ("resume", "", "resume is not accepted in running"),
        ("retry", "sweep.wall", "retry is not accepted in running"),
        ("pause", "depart", "pause is not accepted in done; accepted: nothing"),
        ("pause", "recover", "pause is not accepted in waiting"),
        ("start", "recover", "recover starts when its predecessors have ended; start the mission"),
        ("pause", "swep", "there is no 'swep'; did you mean 'sweep'?"),
        ("finish", "", "no command 'finish'; known: start, pause, resume, skip, abort, retry"),
    ],
)
def test_commands_that_make_no_sense_are_refused_and_change_nothing(
    rig: Rig, verb: str, target: str, reason: str
) -> None:
    sweep(rig)
    before = rig.executor.snapshot(rig.now_s)
    with pytest.raises(Refused) as refusal:
        rig.steer(verb, target)
    assert str(refusal.value).startswith(reason)
    assert rig.executor.snapshot(rig.now_s) == before


def test_a_mission_starts_only_from_where_its_first_action_can_begin(rig: Rig, pelican: Platform) -> None:
    rig.fly()
    with pytest.raises(Refused, match="already in the air"):
        rig.start()
    rig.fly(is_airborne=False)
    rig.executor.available({"record_images": ("ground_camera",)}, 0.0)
    with pytest.raises(Refused, match="record_images is not available: it lacks ground_camera"):
        rig.start()
    rig.executor.available({}, 0.0)
    text = MISSION.replace("frame: hold", "frame: hold\ngeofence: {polygon_m: [[-2, -2], [20, -2], [20, 12]]}")
    fenced = Rig(pelican, text)
    with pytest.raises(Refused, match=r"home is 3.0 m outside the fence"):
        fenced.executor.steer("start", "", 0.0, home_ned_m=(3.0, 5.0, 0.0))
    without = Rig(pelican, MISSION.replace("take_off: {height_m: 1.5}", "go_to: {position_m: [0, 0, 1]}"))
    with pytest.raises(Refused, match="on the ground"):
        without.start()
    assert without.state() == "waiting"


def stands(rig: Rig, seconds: int) -> None:
    """The vehicle is reported on the ground once a second."""
    for _ in range(seconds):
        rig.now_s += 1.0
        rig.fly(is_airborne=False)


def test_a_take_off_that_was_skipped_on_the_ground_may_still_come_and_is_over_ten_seconds_later(rig: Rig) -> None:
    rig.start()
    rig.steer("skip")
    stands(rig, 10)
    assert rig.grant.action_id == "hold"
    stands(rig, 1)
    assert rig.grant.action_id == ""
    assert rig.log[-1] == "the vehicle is still on the ground"
    rig.executor.load(rig.read(MISSION), rig.now_s)
    rig.seen.clear()
    rig.start()
    assert rig.running() == ["depart.climb"]
    rig.steer("skip")
    stands(rig, 5)
    rig.fly()
    assert rig.grant.action_id == "hold"


def test_a_vehicle_that_a_pilot_disarmed_before_its_take_off_can_be_started_again(rig: Rig) -> None:
    rig.start()
    rig.executor.pilot(True, "the vehicle was disarmed by another party", rig.now_s)
    stands(rig, 11)
    rig.steer("abort")
    rig.steer("resume")
    rig.executor.load(rig.read(MISSION), rig.now_s)
    rig.seen.clear()
    rig.start()
    assert rig.running() == ["depart.climb"]


def test_a_take_off_that_is_resumed_after_a_long_pause_on_the_ground_is_one_again(rig: Rig) -> None:
    rig.start()
    rig.steer("pause")
    stands(rig, 11)
    assert (rig.grant.action_id, rig.executor.board.is_airborne) == ("", False)
    rig.steer("resume")
    stands(rig, 30)
    assert (rig.running(), rig.executor.board.is_airborne) == (["depart.climb"], True)


def test_a_second_take_off_after_a_landing_is_a_take_off_at_once(pelican: Platform) -> None:
    again = "after: [pause]}\n      down:   {land: {}, after: [home]}"
    text = MISSION.replace(again, again + "\n      up:     {take_off: {height_m: 2}, after: [down]}")
    rig = sweep(Rig(pelican, text))
    rig.steer("skip", "sweep")
    rig.pass_s(5.1)
    rig.done("recover.home")
    rig.done("recover.down")
    rig.fly(is_airborne=False)
    assert (rig.running(), rig.executor.board.is_airborne) == (["recover.up"], True)


def test_a_landing_before_the_take_off_was_seen_ends_the_flight(rig: Rig) -> None:
    rig.start()
    rig.steer("abort")
    assert rig.running() == ["policy.land"]
    rig.done("policy.land")
    rig.fly(is_airborne=False)
    assert (rig.executor.board.is_airborne, rig.grant.action_id) == (False, "")


def test_a_mission_under_way_is_not_replaced(rig: Rig) -> None:
    rig.start()
    with pytest.raises(Refused, match="the mission 'test' is running; abort it first"):
        rig.executor.load(rig.read(MISSION), 0.0)
    with pytest.raises(Refused, match="abort it first"):
        rig.executor.clear(0.0)
    rig.steer("abort")
    rig.executor.load(rig.read(MISSION), 0.0)
    assert rig.state() == "waiting"
    rig.executor.clear(0.0)
    with pytest.raises(Refused, match="no mission is loaded"):
        rig.start()


def order(rig: Rig, capability: str, arguments: dict[str, object]) -> str:
    """A low-level command, as a station would give it."""
    executor = rig.executor
    loaded = executor.mission.mission if executor.mission is not None else None
    text = single_action(executor.free_name(), capability, arguments, loaded, "hold")
    name = executor.command(rig.read(text), rig.now_s)
    rig.settle()
    return name


def test_a_single_action_runs_without_a_mission(pelican: Platform) -> None:
    rig = Rig(pelican)
    name = order(rig, "take_off", {"height_m": 2})
    rig.fly()
    rig.done(f"{name}.take_off")
    assert rig.grant.action_id == "hold"
    name = order(rig, "go_to", {"position_m": [1, 1, 2]})
    assert rig.running() == [f"{name}.go_to"]
    rig.steer("pause", name)
    assert rig.grant.action_id == "hold"
    rig.steer("resume", name)
    rig.failed(f"{name}.go_to")
    assert rig.state(f"{name}.go_to") == "failed"
    assert rig.grant.action_id == "hold"
    assert rig.executor.policy == ""


def test_a_single_action_on_a_claimed_resource_is_refused_naming_the_claimant(rig: Rig) -> None:
    sweep(rig)
    with pytest.raises(Refused, match=r"motion is claimed by sweep.wall; pause or abort it first"):
        order(rig, "go_to", {"position_m": [1, 1, 2]})
    with pytest.raises(Refused, match=r"camera is claimed by sweep.photos"):
        order(rig, "record_images", {"camera": "ground", "every_s": 1})
    rig.steer("pause")
    name = order(rig, "go_to", {"position_m": [1, 1, 2]})
    with pytest.raises(Refused, match=f"sweep.wall needs motion, claimed by {name}.go_to; pause or abort it first"):
        rig.steer("resume")
    rig.done(f"{name}.go_to")
    rig.steer("resume")
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    assert rig.started[-1].action_id == rig.id_of("sweep.wall")


@pytest.mark.parametrize("name", ["mission", "contingency"])
def test_a_single_task_may_have_any_name_and_leaves_the_mission_alone(rig: Rig, name: str) -> None:
    sweep(rig)
    rig.steer("pause")
    mission, policies = rig.executor.mission, rig.executor.board.policies
    text = f"mission: stay\nframe: hold\ntasks: {{{name}: {{actions: {{still: {{hold: {{duration_s: 5}}}}}}}}}}\n"
    assert rig.executor.command(rig.read(text), rig.now_s) == name
    rig.settle()
    assert (rig.executor.mission, rig.executor.board.policies) == (mission, policies)
    assert rig.running() == [f"{name}.still"]
    rig.steer("skip", name)
    rig.steer("resume")
    assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_a_component_is_in_use_by_the_actions_that_need_it(rig: Rig) -> None:
    sweep(rig)
    assert rig.executor.in_use("pose") == ["sweep.wall", "sweep.photos"]
    assert rig.executor.in_use("waypoints") == ["sweep.wall"]
    assert rig.executor.in_use("flight") == []
    assert rig.executor.in_use("gps", ("autopilot",)) == ["sweep.wall"]
