"""The human pilot goes before everything of ours; a restart in flight goes on where it was, and never arms."""

import pytest
from msgspec import structs

from gloc3.errors import Refused
from gloc3.mission.executing.board import PolicyCondition
from gloc3.mission.executing.requests import Grant
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState
from gloc3.mission.reading.writer import single_action
from gloc3.platform.platform import Platform

from .executor_rig import MISSION, Rig, flying


@pytest.fixture
def rig(pelican: Platform) -> Rig:
    return flying(pelican)


# the pilot


def pilot(rig: Rig, has_control: bool) -> None:
    rig.executor.pilot(has_control, "mode stabilize", rig.now_s)
    rig.settle()


def test_a_pilot_stops_everything_of_ours_at_once(rig: Rig) -> None:
    pilot(rig, has_control=True)
    assert rig.state() == "paused"
    assert rig.executor.mission is not None
    assert rig.executor.mission.reason == "pilot: mode stabilize"
    assert rig.grant == Grant(action_id="", component="")
    assert rig.executor.policy == "pilot"
    rig.arise(PolicyCondition.LINK_LOST)
    rig.arise(PolicyCondition.POSE_LOST)
    rig.executor.emergency("land", "ann", rig.now_s)
    rig.pass_s(200)
    assert rig.running() == []
    assert rig.grant.action_id == ""
    for verb, target in (("resume", "sweep"), ("resume", "sweep.wall")):
        with pytest.raises(Refused, match="the pilot has control"):
            rig.steer(verb, target)


def test_after_a_pilot_only_an_operator_s_resume_goes_on(rig: Rig) -> None:
    pilot(rig, has_control=True)
    pilot(rig, has_control=False)
    rig.pass_s(100)
    assert rig.state() == "paused"
    assert rig.grant.action_id == ""
    rig.steer("resume")
    assert rig.taken_back == 1
    assert rig.running() == ["sweep.photos", "sweep.wall"]
    assert rig.grant.action_id == rig.id_of("sweep.wall")


def test_a_resume_of_an_operator_who_cannot_have_seen_the_pilot_yet_is_refused(rig: Rig) -> None:
    pilot(rig, has_control=True)
    rig.pass_s(0.9)
    with pytest.raises(Refused, match="a pilot has taken over within the last second; resume again"):
        rig.steer("resume")
    assert rig.state() == "paused"
    assert rig.taken_back == 0
    rig.pass_s(0.1)
    rig.steer("resume")
    assert rig.taken_back == 1


@pytest.mark.parametrize(("reason", "after_s"), [("mode stabilize", 3.0), ("mode return", 0.1)])
def test_a_pilot_who_takes_over_again_before_we_are_told_that_he_had_let_go_has_control(
    rig: Rig, reason: str, after_s: float
) -> None:
    """The driver missed that control was taken back, or has lost it to him again in between."""
    pilot(rig, has_control=True)
    rig.pass_s(5)
    rig.steer("resume")
    assert rig.executor.policy == ""
    taken_s = rig.now_s
    rig.executor.pilot(True, reason, rig.now_s, reported_s=taken_s)
    assert rig.executor.policy == "", "said before the driver could know"
    rig.pass_s(after_s)
    rig.executor.pilot(True, reason, rig.now_s, reported_s=taken_s)
    assert rig.executor.policy == "", "the driver is silent"
    rig.executor.pilot(True, reason, rig.now_s, reported_s=rig.now_s)
    rig.settle()
    assert rig.executor.policy == "pilot"
    assert rig.running() == []
    rig.pass_s(2)
    rig.steer("resume")
    assert rig.taken_back == 2


def test_a_pilot_who_has_left_leaves_safety_to_the_policies_and_nothing_else(rig: Rig) -> None:
    pilot(rig, has_control=True)
    rig.arise(PolicyCondition.OBSTACLE)
    rig.executor.unattended(30.0, rig.now_s)
    rig.settle()
    assert rig.executor.policy == "pilot"
    rig.arise(PolicyCondition.POSE_LOST)
    assert rig.executor.policy == "pilot"
    rig.executor.unattended(30.0, rig.now_s)
    rig.settle()
    assert rig.taken_back == 1
    assert rig.executor.policy == "land"


def test_a_vehicle_that_holds_with_nobody_in_charge_lands_after_the_time_of_a_hold(rig: Rig) -> None:
    pilot(rig, has_control=True)
    hold_s = rig.executor.board.policies.hold_s
    rig.executor.unattended(29.9 + hold_s, rig.now_s, is_held=True)
    rig.executor.unattended(31.0 + hold_s, rig.now_s)  # it is flown somewhere
    rig.settle()
    assert rig.executor.policy == "pilot"
    rig.executor.unattended(30.0 + hold_s, rig.now_s, is_held=True)
    rig.settle()
    assert rig.taken_back == 1
    assert rig.executor.policy == "land"


def test_what_arose_under_the_pilot_is_answered_when_he_has_handed_back(rig: Rig) -> None:
    pilot(rig, has_control=True)
    rig.arise(PolicyCondition.LOW_BATTERY)
    rig.arise(PolicyCondition.POSE_LOST)
    rig.arise(PolicyCondition.POSE_LOST, is_on=False)
    rig.pass_s(1)
    rig.steer("resume")
    assert rig.running() == ["policy.return_home"]


def lose(rig: Rig, component: str, policy: Policy) -> None:
    rig.executor.component_lost(component, policy, "no attempt left", rig.now_s)
    rig.settle()


def test_a_component_lost_under_the_pilot_is_answered_when_he_has_handed_back(rig: Rig) -> None:
    pilot(rig, has_control=True)
    lose(rig, "images", Policy.LAND)
    lose(rig, "host cabin", Policy.RETURN)
    assert rig.executor.policy == "pilot"
    rig.pass_s(1)
    rig.steer("resume")
    assert rig.running() == ["policy.land"]
    assert rig.state() == "failed"


def test_a_restart_under_the_pilot_loses_none_of_the_lost_components(rig: Rig) -> None:
    pilot(rig, has_control=True)
    lose(rig, "images", Policy.LAND)
    again = rig.restart(is_airborne=True)
    again.pass_s(1)
    again.steer("resume")
    assert again.running() == ["policy.land"]


def test_a_hand_back_without_a_mission_is_known_after_a_restart(pelican: Platform) -> None:
    rig = Rig(pelican)
    rig.fly()
    pilot(rig, has_control=True)
    assert rig.kept is not None
    assert rig.kept.has_pilot
    rig.pass_s(1)
    rig.steer("resume")
    assert not rig.kept.has_pilot


def test_a_component_that_works_again_before_the_pilot_hands_back_is_not_lost(rig: Rig) -> None:
    pilot(rig, has_control=True)
    lose(rig, "images", Policy.LAND)
    rig.executor.restored(["images", "waypoints"])
    rig.pass_s(1)
    rig.steer("resume")
    assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_what_arose_under_a_pilot_who_has_left_is_answered_with_what_matters_for_safety(rig: Rig) -> None:
    pilot(rig, has_control=True)
    lose(rig, "images", Policy.LAND)
    rig.arise(PolicyCondition.LOW_BATTERY)
    rig.executor.unattended(30.0, rig.now_s)
    rig.settle()
    assert rig.executor.policy == "land"


def test_a_pilot_ends_a_policy_and_handing_back_holds(rig: Rig) -> None:
    rig.arise(PolicyCondition.LOW_BATTERY)
    pilot(rig, has_control=True)
    assert rig.running() == []
    rig.pass_s(1)
    rig.steer("resume")
    assert rig.grant.action_id == "hold"
    assert rig.executor.policy == ""


def test_a_mission_whose_vehicle_a_pilot_has_landed_is_not_resumed(rig: Rig) -> None:
    pilot(rig, has_control=True)
    rig.fly(is_airborne=False)
    rig.pass_s(1)
    with pytest.raises(Refused, match=r"the vehicle is on the ground, and sweep.wall was paused in the air; abort it"):
        rig.steer("resume")
    rig.steer("abort")
    assert rig.state() == "aborted"
    assert rig.under_way == {}


def test_a_landing_that_was_paused_as_it_ended_goes_on_and_is_done(rig: Rig) -> None:
    rig.done("sweep.wall")
    rig.done("recover.home")
    rig.steer("pause")
    rig.fly(is_airborne=False)
    rig.steer("resume")
    assert rig.running() == ["recover.down"]
    rig.done("recover.down")
    assert rig.state() == "done"


# an operator at the autopilot itself

SENT = "station 255 sent return"


def test_a_mode_that_an_operator_chose_is_no_pilot_s_and_the_safety_policies_apply(rig: Rig) -> None:
    pilot(rig, has_control=True)
    rig.executor.operated(SENT, rig.now_s)
    rig.arise(PolicyCondition.LINK_LOST)
    assert (rig.executor.policy, rig.state(), rig.running()) == ("operator", "paused", [])
    rig.executor.unattended(0.0, rig.now_s)
    rig.settle()
    assert rig.taken_back == 1
    assert rig.executor.policy not in ("operator", "pilot", "")


def test_a_hold_that_was_taken_for_ours_pauses_the_mission_by_an_operator(rig: Rig) -> None:
    rig.executor.operated("station 255 sent hold", rig.now_s)
    rig.settle()
    assert rig.executor.mission is not None
    assert (rig.state(), rig.executor.mission.reason, rig.executor.policy) == ("paused", "by an operator", "")
    rig.steer("resume")
    assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_the_emergency_key_overrules_what_an_operator_sent_and_never_a_pilot(rig: Rig) -> None:
    pilot(rig, has_control=True)
    rig.executor.operated(SENT, rig.now_s)
    rig.executor.pilot_after_operator("mode stabilize", rig.now_s)
    rig.executor.emergency("land", "ann", rig.now_s)
    rig.settle()
    assert (rig.executor.policy, rig.taken_back) == ("pilot", 0)
    rig.executor.operated(SENT, rig.now_s)
    rig.executor.emergency("land", "ann", rig.now_s)
    rig.settle()
    assert (rig.executor.policy, rig.taken_back) == ("land", 1)


def test_a_failsafe_s_mode_stays_the_failsafe_s(rig: Rig) -> None:
    failsafe(rig)
    rig.executor.operated(SENT, rig.now_s)
    assert rig.executor.policy == "failsafe"


# the autopilot's failsafe


def failsafe(rig: Rig) -> None:
    rig.executor.pilot(True, "mode AUTO.RTL was chosen by the autopilot", rig.now_s, is_failsafe=True)
    rig.settle()


def test_a_failsafe_that_lands_ends_the_mission_and_gives_control_back(rig: Rig) -> None:
    failsafe(rig)
    assert rig.executor.policy == "failsafe"
    assert rig.executor.mission is not None
    assert rig.executor.mission.reason.startswith("failsafe: mode AUTO.RTL")
    with pytest.raises(Refused, match="the autopilot's failsafe has control"):
        rig.steer("resume", "sweep")
    rig.fly(is_airborne=False)
    assert rig.state() == "paused"
    rig.executor.failsafe_landed(rig.now_s)
    rig.settle()
    assert (rig.state(), rig.executor.mission.reason) == ("aborted", "ended by the autopilot's failsafe")
    assert (rig.taken_back, rig.executor.policy) == (1, "")


def test_a_failsafe_s_hold_with_nobody_in_charge_ends_in_a_landing(rig: Rig) -> None:
    failsafe(rig)
    rig.executor.failsafe_holds(rig.now_s)
    rig.settle()
    assert (rig.executor.policy, rig.state(), rig.taken_back) == ("hold", "paused", 1)
    rig.pass_s(rig.executor.board.policies.hold_s + 1.0)
    assert rig.running() == ["policy.land"]


def test_what_arose_under_a_failsafe_is_answered_when_it_holds_and_after_its_landing_no_component_is_lost(
    rig: Rig,
) -> None:
    failsafe(rig)
    rig.arise(PolicyCondition.LOW_BATTERY)
    rig.executor.failsafe_holds(rig.now_s)
    rig.settle()
    assert rig.running() == ["policy.return_home"]
    failsafe(rig)
    rig.executor.pilot(False, "", rig.now_s)
    failsafe(rig)
    lose(rig, "images", Policy.LAND)
    rig.fly(is_airborne=False)
    rig.executor.failsafe_landed(rig.now_s)
    rig.settle()
    assert not rig.executor.board.lost


def test_a_pilot_s_hold_and_landing_are_his_own(rig: Rig) -> None:
    pilot(rig, has_control=True)
    rig.executor.failsafe_holds(rig.now_s)
    rig.executor.failsafe_landed(rig.now_s)
    rig.pass_s(200)
    assert (rig.executor.policy, rig.state(), rig.taken_back) == ("pilot", "paused", 0)


def test_a_process_that_stood_still_has_missed_reports_for_as_long(rig: Rig) -> None:
    rig.now_s += 8.0
    rig.executor.stalled(8.0)
    rig.settle()
    assert rig.running() == ["sweep.photos", "sweep.wall"]


# restart


@pytest.mark.parametrize(
    ("on_restart", "state", "running"),
    [
        ("continue", "running", ["sweep.photos", "sweep.wall"]),
        ("hold", "paused", []),
        ("land", "failed", ["policy.land"]),
    ],
)
def test_a_restart_in_flight_goes_by_the_mission_s_policy(
    pelican: Platform, on_restart: str, state: str, running: list[str]
) -> None:
    rig = flying(pelican, MISSION.replace("hold_s: 30", f"hold_s: 30\non_restart: {on_restart}"))
    rig.report(rig.id_of("sweep.wall"), ActionState.RUNNING, progress=0.5)
    again = rig.restart(is_airborne=True)
    assert again.state() == state
    assert again.running() == running
    assert again.state("depart.climb") == "done"
    if on_restart == "continue":
        assert next(one for one in again.started if one.capability == "follow_waypoints").progress == 0.5
        assert not set(again.components) & set(rig.components)
    if on_restart == "hold":
        assert again.grant.action_id == "hold"
        again.steer("resume")
        assert again.running() == ["sweep.photos", "sweep.wall"]


def test_progress_is_kept_in_steps_and_with_each_achievement(rig: Rig) -> None:
    wall = rig.id_of("sweep.wall")

    def kept() -> float:
        assert rig.kept is not None
        return rig.kept.programs[0].items["sweep.wall"].progress

    rig.report(wall, ActionState.RUNNING, progress=0.06)
    assert kept() == 0.06
    rig.report(wall, ActionState.RUNNING, progress=0.09)
    assert kept() == 0.06
    rig.report(wall, ActionState.RUNNING, progress=0.091, achieved=1)
    assert kept() == 0.091


@pytest.mark.parametrize("duration_s", [4, 100])
def test_a_wait_goes_on_where_it_was_after_a_restart(pelican: Platform, duration_s: int) -> None:
    text = MISSION.replace(
        "wall:   {follow_waypoints: {waypoints_m: [[2, 1, 2], [16, 1, 2]]}}", "wall: {wait: {duration_s: %d}}"
    )
    rig = flying(pelican, text.replace("hold_s: 30", "on_restart: continue") % duration_s)
    rig.pass_s(0.75 * duration_s)
    assert rig.executor.progress()["sweep.wall"] == pytest.approx(0.75, abs=0.051)
    again = rig.restart(is_airborne=True)
    again.pass_s(0.31 * duration_s)
    assert again.state("sweep.wall") == "done"


def test_a_task_that_will_end_as_failed_does_so_after_a_restart_too(pelican: Platform) -> None:
    text = MISSION.replace("on_failure: hold", "on_failure: continue\non_restart: continue")
    rig = flying(pelican, text)
    rig.failed("sweep.photos")
    again = rig.restart(is_airborne=True)
    assert again.running() == ["sweep.wall"]
    again.done("sweep.wall")
    assert again.state("sweep") == "failed"
    assert again.running() == ["recover.home"]


def test_a_restart_on_the_ground_moves_nothing(pelican: Platform) -> None:
    rig = Rig(pelican, MISSION.replace("hold_s: 30", "hold_s: 30\non_restart: continue"))
    rig.start()
    again = rig.restart(is_airborne=False)
    assert again.state() == "paused"
    again.pass_s(100)
    assert again.under_way == {}
    again.steer("resume")
    assert again.running() == ["depart.climb"]


def test_a_mission_is_resumed_on_the_ground_only_inside_its_fence(pelican: Platform) -> None:
    fence = "geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}\non_failure: hold"
    rig = Rig(pelican, MISSION.replace("on_failure: hold", fence, 1))
    rig.executor.steer("start", "", 0.0, (1.0, -1.0, 0.0))
    rig.settle()
    again = rig.restart(is_airborne=False)
    with pytest.raises(Refused, match="outside the fence"):
        again.executor.steer("resume", "", 0.0, (100.0, 100.0, 0.0))
    assert again.state() == "paused"
    again.executor.steer("resume", "", 0.0, (1.0, -1.0, 0.0))
    again.settle()
    assert again.running() == ["depart.climb"]


@pytest.mark.parametrize("is_loaded", [False, True])
def test_a_single_command_that_a_restart_ends_in_flight_leaves_a_hold_also_beside_a_mission_that_has_not_begun(
    pelican: Platform, is_loaded: bool
) -> None:
    rig = Rig(pelican, MISSION if is_loaded else "")
    rig.fly()
    action = "mission: c\nframe: hold\ntasks: {c1: {actions: {go: {go_to: {position_m: [5, 5, 3]}}}}}\n"
    rig.executor.command(rig.read(action), 0.0)
    rig.settle()
    again = rig.restart(is_airborne=True)
    assert again.executor.policy == "hold"
    again.pass_s(200)
    assert again.executor.policy == "land"


@pytest.mark.parametrize(("on_restart", "policy"), [("continue", "hold"), ("hold", "hold"), ("land", "land")])
@pytest.mark.parametrize("times", [1, 2])
def test_a_take_off_that_was_commanded_before_a_restart_on_the_ground_ends_under_the_mission_s_policy(
    pelican: Platform, on_restart: str, policy: str, times: int
) -> None:
    rig = Rig(pelican, MISSION.replace("hold_s: 30", f"hold_s: 30\non_restart: {on_restart}"))
    rig.start()
    for _ in range(times):
        rig = rig.restart(is_airborne=False)
        assert rig.executor.policy == ""
    rig.fly()
    assert rig.executor.policy == policy
    if policy == "hold":
        rig.steer("resume")
        assert rig.running() == ["sweep.photos", "sweep.wall"]


def test_a_take_off_after_a_restart_that_an_operator_or_a_pilot_wants_is_theirs(pelican: Platform) -> None:
    rig = Rig(pelican, MISSION)
    rig.start()
    resumed = rig.restart(is_airborne=False)
    resumed.steer("resume")
    resumed.fly()
    assert resumed.executor.policy == ""
    assert resumed.running() == ["depart.climb"]
    flown = rig.restart(is_airborne=False)
    flown.executor.pilot(True, "armed by another party", flown.now_s)
    flown.fly()
    assert flown.executor.policy == "pilot"


def test_a_policy_that_was_being_carried_out_goes_on_after_a_restart(rig: Rig) -> None:
    rig.arise(PolicyCondition.LOW_BATTERY)
    again = rig.restart(is_airborne=True)
    assert again.state() == "failed"
    assert again.running() == ["policy.return_home"]
    landed = rig.restart(is_airborne=False)
    assert landed.under_way == {}
    assert landed.executor.policy == ""


def test_a_restart_during_take_off_or_landing_knows_how_it_ended(pelican: Platform) -> None:
    rig = Rig(pelican, MISSION.replace("hold_s: 30", "hold_s: 30\non_restart: continue"))
    rig.start()
    again = rig.restart(is_airborne=True)
    assert again.running() == ["sweep.photos", "sweep.wall"]
    again.done("sweep.wall")
    again.done("recover.home")
    last = again.restart(is_airborne=False)
    assert last.state("recover.down") == "done"
    assert last.state() == "done"


def test_a_hold_lasts_no_longer_because_the_process_came_back_and_its_cause_is_told_as_before(
    pelican: Platform,
) -> None:
    rig = flying(pelican)
    rig.arise(PolicyCondition.LINK_LOST)
    for _ in range(3):
        rig.pass_s(9.0)
        rig = rig.restart(is_airborne=True)
    assert rig.executor.policy == "hold"
    assert rig.log[-1] == "policy hold: link lost, restart"
    rig.pass_s(3.5)
    assert rig.executor.policy == "land"


def test_a_hold_that_an_operator_ordered_has_no_end_after_a_restart_either(pelican: Platform) -> None:
    rig = flying(pelican)
    rig.executor.emergency("hold", "ann", rig.now_s)
    rig.settle()
    rig = rig.restart(is_airborne=True)
    rig.pass_s(100.0)
    assert rig.executor.policy == "hold"


@pytest.mark.parametrize("kept_as", ["command ", ""])
@pytest.mark.parametrize("has_ended", [True, False])
def test_a_restart_takes_no_single_task_for_a_contingency(pelican: Platform, kept_as: str, has_ended: bool) -> None:
    rig = flying(pelican)
    rig.steer("pause")
    text = "mission: go\nframe: hold\ntasks: {contingency: {actions: {go: {go_to: {position_m: [5, 5, 3]}}}}}\n"
    rig.executor.command(rig.read(text), rig.now_s)
    rig.settle()
    if has_ended:
        rig.done("contingency.go")
    assert rig.kept is not None
    mission, command = rig.kept.programs
    assert (mission.name, command.name) == ("mission", "command contingency")
    command = structs.replace(command, name=f"{kept_as}contingency")  # an earlier process named it by its task alone
    rig.kept = structs.replace(rig.kept, programs=[mission, command])
    again = rig.restart(is_airborne=True)
    assert again.state() == "paused"
    assert again.state("contingency.go") == ("done" if has_ended else "aborted")
    again.steer("resume")
    assert again.running() == ["sweep.photos", "sweep.wall"]


def test_progress_after_a_restart_is_put_on_disk_as_a_change_from_what_is_there(pelican: Platform) -> None:
    rig = flying(pelican)
    rig.report(rig.id_of("sweep.wall"), ActionState.RUNNING, progress=0.5)
    rig = rig.restart(is_airborne=True)
    rig.steer("resume")
    rig.report(rig.id_of("sweep.wall"), ActionState.RUNNING, progress=0.04)
    assert rig.kept is not None
    assert rig.kept.programs[0].items["sweep.wall"].progress == 0.04


def test_what_waits_for_its_capability_wakes_nobody_while_a_single_command_has_its_resource(pelican: Platform) -> None:
    rig = flying(pelican)
    rig.done("sweep.wall")
    rig.executor.available({"land": ("autopilot",)}, rig.now_s)
    rig.done("recover.home")
    stay = single_action("stay", "hold", {"duration_s": 60}, None, "hold")
    rig.executor.command(rig.read(stay), rig.now_s)
    rig.settle()
    rig.pass_s(10.0)
    assert rig.state("recover.down") == "waiting"
    assert "stay" in rig.running()[0]
