"""The driver's stream: whose setpoints are obeyed, when it begins and runs dry, and that it rests on the ground."""

import math
from collections.abc import Callable

import pytest
from msgspec.structs import replace
from tests.onboard.driver_rig import STEP_S, DriverRig
from tests.onboard.messages import LIMITS, at, autopilot_pose, pose, setpoint

from gloc3.messages.vehicle import AutopilotState, EmergencyDisarm, FlightMode, LandedState, ManoeuvreKind
from gloc3_onboard.components.drivers.autopilot import AutopilotDriver
from gloc3_onboard.components.drivers.setpoint_stream import SetpointStream

STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])


def airborne(style: str = "px4", mode: FlightMode = FlightMode.HOLD) -> DriverRig:
    """In the air in a mode of the autopilot's own, with leave to go on."""
    rig = DriverRig(style)
    rig.step()
    rig.at = (0.0, 0.0, 2.0)
    rig.autopilot.fly(mode)
    rig.see()
    rig.driver._watch.yield_back()
    return rig


def test_px4_gets_a_stream_for_a_second_before_it_is_asked_to_follow() -> None:
    rig = airborne("px4")
    rig.hold()
    rig.run(0.95)
    assert rig.autopilot.modes_asked == []
    assert len(rig.autopilot.setpoints) >= 18
    rig.run(0.3)
    assert rig.autopilot.modes_asked == ["guided"]
    assert rig.state.is_guided


@pytest.mark.parametrize(("style", "asked"), [("px4", ["hold"]), ("ardupilot", [])])
@pytest.mark.parametrize("mode", [FlightMode.GUIDED, FlightMode.LAND])
def test_on_the_ground_px4_is_taken_out_of_modes_in_which_it_cannot_be_armed(
    style: str, asked: list[str], mode: FlightMode
) -> None:
    rig = DriverRig(style)
    rig.step()
    rig.autopilot.reported = replace(rig.autopilot.reported, mode=mode)
    rig.see()
    rig.run(0.5)
    assert rig.autopilot.modes_asked == asked


def test_ardupilot_is_asked_with_the_first_setpoint() -> None:
    rig = airborne("ardupilot")
    rig.hold()
    rig.step()
    assert rig.autopilot.modes_asked == ["guided"]


def test_setpoints_go_out_in_the_autopilots_own_frame() -> None:
    rig = airborne()
    rig.hold()
    rig.run(0.2)
    assert rig.autopilot.setpoints[-1][1] == pytest.approx((-10.0, 0.0, -2.0))


def test_two_estimates_of_slightly_different_times_tell_the_same_frames() -> None:
    rig = airborne()
    rig.stage.put(rig.now_s, pose=pose(velocity_ned_m_s=(1.0, 0.0, 0.0)))
    rig.stage.put(rig.now_s + 0.04, autopilot_pose=autopilot_pose(-9.96, velocity_ned_m_s=(1.0, 0.0, 0.0)))
    rig.stage.put(setpoint=setpoint())
    rig.stage.cycle()
    assert rig.driver._stream._offset_ned_m == pytest.approx((10.0, 0.0, 0.0))


def test_until_the_autopilot_follows_the_stream_stays_at_the_vehicle_and_then_leaves_it_gently() -> None:
    rig = airborne()
    rig.wants = lambda: setpoint((8.0, 0.0, -2.0))
    rig.run(0.9)
    assert all(place == pytest.approx((-10.0, 0.0, -2.0), abs=0.01) for _, place, _ in rig.autopilot.setpoints)
    rig.run(0.6)
    steps = [
        math.dist(a or (), b or ())
        for (_, a, _), (_, b, _) in zip(rig.autopilot.setpoints, rig.autopilot.setpoints[1:], strict=False)
    ]
    assert 0.0 < max(steps) <= 3.0 * STEP_S + 1e-6
    assert rig.state.clamped > 0


def test_foreign_odd_and_old_setpoints_are_dropped_and_counted() -> None:
    rig = airborne()
    rig.step(setpoint=setpoint(owner="thief"))
    rig.step(setpoint=setpoint((math.inf, 0.0, -2.0)))
    for t_s in (rig.now_s - 0.3, rig.now_s + 9.0):
        rig.stage.put(t_s, setpoint=setpoint())
    rig.step()
    assert (rig.state.foreign, rig.state.not_finite, rig.state.stale) == (1, 1, 2)
    assert rig.autopilot.setpoints == []


@STYLES
def test_over_limit_setpoints_are_brought_inside_and_counted(style: str) -> None:
    rig = DriverRig(style).in_flight()
    clamped = rig.state.clamped
    rig.wants = lambda: setpoint((90.0, 0.0, -90.0), (30.0, 0.0, 0.0))
    rig.run(1.0)
    assert rig.state.clamped >= clamped + 19
    for _, _, velocity in rig.autopilot.setpoints:
        assert velocity is None or math.hypot(*velocity) <= math.hypot(3.0, 1.0) + 1e-6


@STYLES
def test_a_stream_that_runs_dry_stops_after_half_a_second_and_hold_is_asked_until_it_is_confirmed(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    sent = len(rig.autopilot.setpoints)
    rig.autopilot.is_deaf = True
    rig.run(0.5)
    assert rig.state.is_streaming
    rig.run(0.1)
    assert (rig.state.is_streaming, rig.state.expired) == (False, 1)
    braking = rig.autopilot.setpoints[sent:]
    assert [one[1] for one in braking] == [None] * len(braking), "meanwhile it is braked"
    assert 5 <= len(braking) <= 8
    rig.run(0.2)
    assert len(rig.autopilot.setpoints) == sent + len(braking)
    requested = len(rig.autopilot.modes_asked)
    rig.run(2.3)
    assert rig.autopilot.modes_asked[requested - 1 :] == ["hold"] * 3
    rig.autopilot.is_deaf = False
    rig.run(3.0)
    assert rig.autopilot.reported.mode is FlightMode.HOLD
    assert rig.autopilot.modes_asked[requested - 1 :] == ["hold"] * 4
    assert not rig.state.has_pilot_control


@STYLES
def test_setpoints_of_the_wrong_owner_do_not_keep_a_stream_alive(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.own("hold")
    rig.run(0.7)
    assert rig.state.expired == 1
    assert rig.autopilot.modes_asked[-1] == "hold"


@STYLES
def test_a_guided_mode_that_comes_after_the_stream_has_ended_is_left_again(style: str) -> None:
    rig = airborne(style)
    rig.autopilot.delay_s = 0.9
    rig.hold()
    rig.run(1.1)
    rig.wants = lambda: None
    rig.run(3.0)
    assert rig.autopilot.reported.mode is FlightMode.HOLD
    assert rig.autopilot.modes_asked[-1] == "hold"
    assert not rig.state.has_pilot_control


@STYLES
@pytest.mark.parametrize("landed", [LandedState.ON_GROUND, LandedState.UNKNOWN])
def test_on_the_ground_nothing_is_streamed(style: str, landed: LandedState) -> None:
    rig = airborne(style)
    rig.autopilot.reported = replace(rig.autopilot.reported, landed=landed)
    rig.see()
    rig.hold()
    rig.run(2.0)
    assert rig.autopilot.setpoints == []
    assert rig.autopilot.modes_asked == []


def without_limits(rig: DriverRig) -> None:
    rig.driver._stream._limiter = None


def disarmed(rig: DriverRig) -> None:
    rig.autopilot.reported = replace(rig.autopilot.reported, is_armed=False)
    rig.driver._watch.command_disarm(rig.now_s)
    rig.see()


def silent(rig: DriverRig) -> None:
    rig.autopilot.reported = AutopilotState(is_connected=False, is_armed=True, landed=LandedState.IN_AIR)
    rig.see()


@pytest.mark.parametrize("spoil", [without_limits, disarmed, silent])
def test_what_must_be_known_before_anything_is_sent(spoil: Callable[[DriverRig], None]) -> None:
    rig = airborne()
    spoil(rig)
    rig.hold()
    rig.run(2.0)
    assert rig.autopilot.setpoints == []
    assert rig.autopilot.modes_asked == []


def test_without_a_young_pose_nothing_is_sent() -> None:
    rig = airborne()
    for _ in range(20):
        rig.stage.step(STEP_S, setpoint=setpoint())
        rig.autopilot.tick(rig.now_s)
    assert rig.autopilot.setpoints[-1][0] <= 0.1 + 0.25 + 1e-6
    assert rig.state.expired == 1


@STYLES
def test_a_stream_goes_on_through_a_late_pose_but_only_to_rest(style: str) -> None:
    rig = DriverRig(style).in_flight()
    begin_s = rig.now_s
    for _ in range(60):
        rig.stage.step(STEP_S, setpoint=setpoint(None, (1.0, 0.0, 0.0)))
        rig.autopilot.tick(rig.now_s)
    sent = [one for one in rig.autopilot.setpoints if one[0] > begin_s + 0.3]
    assert sent[-1][0] == pytest.approx(begin_s + 1.9, abs=0.06)  # the pose was 0.1 s old
    assert all(place is None for _, place, _ in sent)
    assert math.hypot(*(sent[20][2] or (1.0,))) < 1e-9
    assert rig.state.expired == 1


def test_a_late_pose_leads_to_no_place() -> None:
    rig = DriverRig("px4").in_flight()
    begin_s = rig.now_s
    for _ in range(20):
        rig.stage.step(STEP_S, setpoint=setpoint((9.0, 0.0, -2.0)))
        rig.autopilot.tick(rig.now_s)
    assert rig.autopilot.setpoints[-1][0] <= begin_s + 0.25 + 1e-6
    assert rig.state.expired == 1


def stalled(rig: DriverRig, times: int) -> list[float]:
    """So often setpoints stay away for 0.7 s; for how long they then come until the autopilot follows."""
    wants, waited_s = rig.wants, []
    for _ in range(times):
        rig.wants = lambda: None
        rig.run(0.7)
        rig.wants = wants
        begin_s = rig.now_s
        while not (rig.state.is_guided and rig.autopilot.reported.mode is FlightMode.GUIDED):
            rig.step()
            assert rig.now_s < begin_s + 20.0
        waited_s.append(rig.now_s - begin_s)
    return waited_s


@STYLES
def test_after_each_stream_that_ran_dry_the_next_must_be_steady_for_longer(style: str) -> None:
    rig = DriverRig(style).in_flight()
    assert rig.state.steady_s == 0.0
    waited_s = stalled(rig, 5)
    assert waited_s == pytest.approx([1.0, 2.0, 4.0, 8.0, 8.0], abs=0.4)
    assert (rig.state.expired, rig.state.steady_s) == (5, 8.0)
    rig.run(31.0)
    assert rig.state.steady_s == 0.0


@STYLES
def test_gaps_while_it_holds_do_not_prolong_the_hold(style: str) -> None:
    rig = DriverRig(style).in_flight()
    stalled(rig, 3)
    wants = rig.wants
    rig.wants = lambda: None
    rig.run(0.7)
    begin_s, expired = rig.now_s, rig.state.expired
    while not (rig.state.is_guided and rig.autopilot.reported.mode is FlightMode.GUIDED):
        is_away = (rig.now_s - begin_s) % 3.0 > 2.2
        rig.wants = (lambda: None) if is_away else wants
        rig.step()
        assert rig.now_s < begin_s + 12.0, "it holds without end"
    assert rig.now_s - begin_s > 7.0
    assert rig.state.expired > expired + 1


@STYLES
@pytest.mark.parametrize(("has_stalled", "is_failsafe"), [(True, True), (True, False), (False, True), (False, False)])
def test_only_a_failsafe_hold_that_follows_from_a_gap_of_ours_is_no_pilots_choice(
    style: str, has_stalled: bool, is_failsafe: bool
) -> None:
    rig = DriverRig(style).in_flight()
    if has_stalled:
        rig.stage.now_s += 1.3
    rig.autopilot.fly(FlightMode.HOLD)
    rig.autopilot.reported = replace(rig.autopilot.reported, is_failsafe=is_failsafe)
    rig.see()
    rig.run(3.5)
    is_ours = has_stalled and is_failsafe
    assert rig.state.has_pilot_control is not is_ours
    assert rig.state.is_guided is is_ours


@STYLES
def test_a_stream_with_holes_is_not_steady(style: str) -> None:
    rig = DriverRig(style).in_flight()
    wants = rig.wants
    rig.wants = lambda: None
    rig.run(0.8)
    asked = len(rig.autopilot.modes_asked)
    for _ in range(6):
        rig.wants = wants
        rig.run(0.6)
        rig.wants = lambda: None
        rig.run(0.4)
    assert "guided" not in rig.autopilot.modes_asked[asked:]


@STYLES
def test_a_new_owner_goes_on_without_a_step(style: str) -> None:
    rig = DriverRig(style).in_flight()
    speed = 0.0
    north = 0.0
    for _ in range(40):
        speed = min(0.5, speed + 0.1)
        north += speed * STEP_S
        rig.at = (north - 0.2, 0.05, 2.0)
        rig.step(setpoint=setpoint((north, 0.0, -2.0), (speed, 0.0, 0.0)))
    before = rig.autopilot.setpoints[-1][1]
    rig.own("hold")
    rig.step(setpoint=setpoint((north, 0.0, -2.0), owner="hold"))
    after = rig.autopilot.setpoints[-1][1]
    assert before is not None
    assert after is not None
    assert math.dist(before, after) < 0.5 * STEP_S + 0.01
    assert not rig.state.expired


@STYLES
def test_a_refused_guided_mode_is_asked_again_and_the_reason_is_told(style: str) -> None:
    rig = airborne(style)
    rig.autopilot.refuses["mode guided"] = "no setpoints are streamed"
    rig.hold()
    rig.run(3.2)
    assert rig.autopilot.modes_asked.count("guided") >= 2
    assert rig.state.refusal == "no setpoints are streamed"
    rig.autopilot.refuses.clear()
    rig.run(1.5)
    assert rig.state.is_guided
    assert rig.state.refusal == ""


@STYLES
def test_limits_may_change_in_flight(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.step(limits=replace(LIMITS, height_max_m=1.5))
    rig.run(3.0)
    place = rig.autopilot.setpoints[-1][1]
    assert place is not None
    assert place[2] == pytest.approx(-1.5)


@STYLES
def test_a_refused_landing_ends_in_a_hold_not_in_silence(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.autopilot.refuses["mode land"] = "not now"
    rig.wants = lambda: None
    rig.request(ManoeuvreKind.LAND)
    rig.run(1.0)
    assert (rig.state.manoeuvre_state, rig.state.manoeuvre_reason) == ("failed", "not now")
    assert rig.autopilot.reported.mode is FlightMode.HOLD


def test_the_state_is_reported_on_change_and_five_times_a_second() -> None:
    rig = airborne()
    before = len(rig.stage.all(type(rig.state)))
    rig.run(2.0)
    assert len(rig.stage.all(type(rig.state))) - before == pytest.approx(10, abs=1)


def test_only_what_it_knows_can_be_written() -> None:
    rig = DriverRig()
    with pytest.raises(Exception, match="str cannot be written to an autopilot"):
        rig.driver.actuate("fly")
    assert at(0.0, setpoint()).payload.action_id == "go"
    assert AutopilotDriver.kind == "AD"


def test_an_emergency_disarm_goes_out_whoever_owns_motion() -> None:
    rig = DriverRig()
    rig.run(0.2)
    rig.step(emergency=EmergencyDisarm(author="ana"))
    assert "disarm, forced" in rig.autopilot.commands


def test_setpoints_that_go_slower_tell_how_much_no_more_than_the_platform_may_and_faster_ones_half_of_it() -> None:
    stream = SetpointStream()
    stream.adopt(LIMITS)
    place, told = 0.0, []
    for step in range(60):
        now_s = 1.0 + 0.05 * step
        speed = min(0.05 * step * 2.0, 2.0) if step < 40 else max(0.0, 2.0 - 2.0 * 0.05 * (step - 40))
        place += 0.05 * speed
        here = at(now_s, pose(place, 0.0, 2.0, velocity_ned_m_s=(speed, 0.0, 0.0)))
        stream.set_vehicle(here, at(now_s, autopilot_pose(place - 10.0, 0.0, 2.0)), is_guided=True)
        wanted = at(now_s, setpoint((place, 0.0, -2.0), (speed, 0.0, 0.0)))
        sent = stream.next_setpoint([wanted], "go", now_s, may_fly=True, is_guided=True)
        assert sent is not None
        told.append(sent.acceleration_ned_m_s2)
    assert told[0] is None
    known = [one[0] for one in told[1:] if one is not None]
    assert known[10] == pytest.approx(1.0, abs=0.1)
    assert known[30] == pytest.approx(0.0, abs=0.1)
    assert known[50] == pytest.approx(-2.0, abs=0.1)
    assert max(map(abs, known)) <= LIMITS.acceleration_m_s2 + 1e-9


def test_a_turn_tells_its_acceleration() -> None:
    stream = SetpointStream()
    stream.adopt(LIMITS)
    sent = None
    for step in range(20):
        angle, now_s = 0.05 * step, 1.0 + 0.05 * step
        place, velocity = (math.sin(angle), 1.0 - math.cos(angle), -2.0), (math.cos(angle), math.sin(angle), 0.0)
        here = at(now_s, pose(place[0], place[1], 2.0, velocity_ned_m_s=velocity))
        stream.set_vehicle(here, at(now_s, autopilot_pose(place[0], place[1], 2.0)), is_guided=True)
        sent = stream.next_setpoint([at(now_s, setpoint(place, velocity))], "go", now_s, may_fly=True, is_guided=True)
    assert sent is not None
    assert sent.acceleration_ned_m_s2 is not None
    assert math.hypot(*sent.acceleration_ned_m_s2) == pytest.approx(1.0, abs=0.1)


def test_a_missed_setpoint_leaves_no_acceleration_and_no_velocity_to_go_on_by() -> None:
    stream = SetpointStream()
    stream.adopt(LIMITS)
    sent = None
    for step in range(20):
        now_s, speed, place = 1.0 + 0.05 * step, 2.0 - 0.1 * step, 0.1 * step - 0.0025 * step * step
        here = at(now_s, pose(place, 0.0, 2.0, velocity_ned_m_s=(speed, 0.0, 0.0)))
        stream.set_vehicle(here, at(now_s, autopilot_pose(place, 0.0, 2.0)), is_guided=True)
        wanted = [at(now_s, setpoint((place, 0.0, -2.0), (speed, 0.0, 0.0)))] if step < 12 else []
        following = stream.next_setpoint(wanted, "go", now_s, may_fly=True, is_guided=True)
        sent = sent if following is None else following
        if step == 11:
            assert sent is not None
            assert sent.acceleration_ned_m_s2 is not None
    assert sent is not None
    assert (sent.position_ned_m, sent.acceleration_ned_m_s2) == (None, None)
    assert sent.velocity_ned_m_s is not None
    assert math.hypot(*sent.velocity_ned_m_s) < 1.0


def test_a_stream_that_follows_the_vehicle_tells_no_acceleration() -> None:
    stream = SetpointStream()
    stream.adopt(LIMITS)
    for step in range(20):
        now_s, speed = 1.0 + 0.05 * step, 0.2 * (-1) ** step
        stream.set_vehicle(
            at(now_s, pose(0.0, 0.0, 2.0, velocity_ned_m_s=(speed, 0.0, 0.0))),
            at(now_s, autopilot_pose(0.0, 0.0, 2.0)),
            is_guided=False,
        )
        wanted = at(now_s, setpoint((0.0, 0.0, -2.0), (0.0, 0.0, 0.0)))
        sent = stream.next_setpoint([wanted], "go", now_s, may_fly=True, is_guided=False)
        assert sent is not None
        assert sent.acceleration_ned_m_s2 is None
