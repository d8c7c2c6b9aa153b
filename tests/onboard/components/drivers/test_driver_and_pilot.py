"""The human pilot wins; and a driver that goes quiet, stops, fails or steps in leaves nobody wondering who flies."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.onboard.driver_rig import DriverRig
from tests.onboard.messages import setpoint

from gloc3.errors import Refused
from gloc3.messages.vehicle import DriverState, FlightMode, Manoeuvre, ManoeuvreKind, TakeOver

STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])


def silence(rig: DriverRig) -> None:
    """Forgets what has been sent and commanded."""
    rig.autopilot.commands.clear()
    rig.autopilot.setpoints.clear()


@STYLES
@pytest.mark.parametrize("mode", [FlightMode.MANUAL, FlightMode.RETURN, FlightMode.MISSION, FlightMode.OTHER])
def test_when_the_pilot_takes_over_setpoints_stop_at_once_and_nothing_is_commanded(
    style: str, mode: FlightMode
) -> None:
    rig = DriverRig(style).in_flight()
    silence(rig)
    rig.autopilot.enter(mode)
    rig.see()
    rig.run(10.0)
    assert rig.autopilot.setpoints == []
    assert rig.autopilot.commands == ["abandon"], "nor is anything repeated that was commanded before"
    assert rig.state.has_pilot_control
    assert rig.state.pilot_reason == f"mode {mode} was chosen by another party"


@STYLES
def test_manoeuvres_are_not_begun_and_those_under_way_are_given_up(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.request(ManoeuvreKind.LAND)
    rig.run(1.0)
    silence(rig)
    rig.autopilot.enter(FlightMode.MANUAL)
    rig.see()
    rig.request(ManoeuvreKind.LAND)
    rig.run(3.0)
    assert rig.autopilot.commands == ["abandon"]
    assert rig.state.manoeuvre_state == "failed"


@STYLES
def test_a_busy_autopilot_that_carries_a_command_out_late_is_no_pilot(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.autopilot.delay_s = 7.0
    rig.request(ManoeuvreKind.LAND)
    rig.run(8.0)
    assert rig.autopilot.reported.mode is FlightMode.LAND
    assert not rig.state.has_pilot_control, rig.state.pilot_reason


@STYLES
def test_an_answer_that_waited_while_our_process_stood_still_is_still_ours(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.request(ManoeuvreKind.LAND)
    rig.stage.step(7.0)
    rig.run(1.0)
    assert rig.autopilot.reported.mode is FlightMode.LAND
    assert not rig.state.has_pilot_control, rig.state.pilot_reason


@STYLES
def test_a_disarm_by_the_pilot_stops_everything_too(style: str) -> None:
    rig = DriverRig(style).in_flight()
    silence(rig)
    rig.autopilot.reported = replace(rig.autopilot.reported, is_armed=False)
    rig.see()
    rig.request(ManoeuvreKind.TAKE_OFF, height_m=2.0, may_arm=True)
    rig.run(3.0)
    assert rig.autopilot.commands == ["abandon"]
    assert rig.autopilot.setpoints == []


@STYLES
def test_an_operator_gives_leave_and_then_it_goes_on(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.autopilot.enter(FlightMode.MANUAL)
    rig.see()
    rig.run(1.0)
    silence(rig)
    rig.step(take_over=TakeOver(is_resumed=False))
    rig.run(1.0)
    assert rig.autopilot.setpoints == []
    rig.step(take_over=TakeOver(is_resumed=True))
    rig.run(2.0)
    assert rig.autopilot.modes_asked == ["guided"]
    assert rig.state.is_guided
    rig.autopilot.enter(FlightMode.MANUAL)
    rig.see()
    assert rig.state.has_pilot_control


@STYLES
def test_setpoints_that_come_while_the_pilot_flies_are_still_judged(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.autopilot.enter(FlightMode.MANUAL)
    rig.see()
    rig.step(setpoint=setpoint(owner="thief"))
    assert rig.state.foreign == 1


@STYLES
def test_a_pilot_who_breaks_off_the_climb_by_hold_keeps_control(style: str) -> None:
    rig = DriverRig(style)
    rig.request(ManoeuvreKind.TAKE_OFF, height_m=3.0, may_arm=True)
    rig.run(1.0)
    rig.at = (0.0, 0.0, 0.8)
    rig.step()
    rig.autopilot.fly(FlightMode.HOLD)
    rig.hold()
    rig.see()
    rig.run(2.0)
    assert rig.state.has_pilot_control
    assert rig.autopilot.setpoints == []


# --- quiet, stop, faults ---


@STYLES
def test_going_quiet_in_flight_leaves_the_autopilot_in_hold(style: str) -> None:
    rig = DriverRig(style).in_flight()
    silence(rig)
    rig.driver.make_safe()
    rig.driver.goquiet()
    rig.stage.is_quiet = True
    rig.run(3.0)
    assert rig.autopilot.commands == ["mode hold"]
    assert rig.autopilot.setpoints == []
    assert not rig.driver._watch.has_control


@STYLES
def test_making_safe_leaves_alone_what_flies_by_itself_or_by_a_pilot(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.wants = lambda: None
    rig.request(ManoeuvreKind.LAND)
    rig.run(1.0)
    silence(rig)
    rig.driver.make_safe()
    assert rig.autopilot.commands == []
    rig = DriverRig(style).in_flight()
    rig.autopilot.enter(FlightMode.MANUAL)
    rig.see()
    silence(rig)
    rig.driver.make_safe()
    assert rig.autopilot.commands == []
    DriverRig(style).driver.make_safe()


@STYLES
def test_a_stop_in_flight_is_refused_until_the_autopilot_confirms_a_mode_of_its_own(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.driver.make_safe()
    with pytest.raises(Refused, match="hold has been commanded, ask again"):
        rig.driver.stop()
    rig.run(1.0)
    assert rig.autopilot.reported.mode is FlightMode.HOLD
    rig.driver.make_safe()
    rig.driver.stop()


@STYLES
def test_a_refused_stop_that_is_not_repeated_is_forgotten(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.driver.make_safe()
    with pytest.raises(Refused):
        rig.driver.stop()
    rig.run(5.0)
    assert rig.autopilot.reported.mode is FlightMode.HOLD
    rig.run(8.0)
    assert rig.state.is_guided


def test_on_the_ground_and_with_a_pilot_it_may_always_stop() -> None:
    rig = DriverRig()
    rig.driver.stop()
    rig.run(0.5)
    rig.driver.stop()
    rig = DriverRig().in_flight()
    rig.autopilot.enter(FlightMode.MANUAL)
    rig.see()
    rig.driver.stop()


@STYLES
def test_brought_up_again_in_flight_after_a_fault_it_goes_on(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.driver.make_safe()
    for _ in range(10):
        rig.autopilot.tick(rig.now_s)
    rig.stage.now_s += 0.4
    rig.autopilot.tick(rig.now_s)
    rig.driver.initialize(rig.driver.settings)
    rig.driver.start()
    rig.run(2.0)
    assert not rig.state.has_pilot_control
    assert rig.state.is_guided


@STYLES
def test_brought_up_again_it_still_knows_that_the_pilot_has_control(style: str) -> None:
    rig = DriverRig(style).in_flight()
    rig.autopilot.enter(FlightMode.MANUAL)
    rig.see()
    rig.driver.start()
    rig.autopilot.enter(FlightMode.HOLD)
    rig.run(2.0)
    assert rig.state.has_pilot_control


@STYLES
def test_a_new_process_in_flight_moves_nothing_until_it_is_told(style: str) -> None:
    rig = DriverRig(style)
    rig.at = (0.0, 0.0, 2.0)
    rig.autopilot.fly(FlightMode.HOLD)
    rig.hold()
    rig.run(2.0)
    assert rig.state.has_pilot_control
    assert rig.autopilot.setpoints == []
    assert rig.autopilot.modes_asked == []
    rig.step(take_over=TakeOver(is_resumed=True))
    rig.run(2.0)
    assert rig.state.is_guided


# --- a standby ---


class Pair:
    """A working driver and a quiet one, on one autopilot, that hear the same."""

    def __init__(self, style: str) -> None:
        self.primary = DriverRig(style)
        self.standby = DriverRig(style, self.primary.autopilot)
        self.standby.stage.is_quiet = True
        self.standby.driver.goquiet()
        self.is_primary_dead = False

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            if self.is_primary_dead:
                self.standby.step()
            else:
                self.primary.step()
                for state in self.primary.stage.new:
                    if isinstance(state, DriverState):
                        self.standby.stage.put(primary=state)
                self.standby.step()

    def both(self) -> tuple[DriverRig, DriverRig]:
        return self.primary, self.standby

    def in_flight(self) -> "Pair":
        manoeuvre = Manoeuvre(action_id="go", kind=ManoeuvreKind.TAKE_OFF, height_m=2.0, may_arm=True)
        self.run(0.2)
        for rig in self.both():
            rig.stage.put(manoeuvre=manoeuvre)
        self.run(1.0)
        for rig in self.both():
            rig.at = (0.0, 0.0, 2.0)
        self.run(0.1)
        autopilot = self.primary.autopilot
        autopilot.fly(FlightMode.HOLD if autopilot.is_px4 else FlightMode.GUIDED)
        for rig in self.both():
            rig.hold()
        self.run(2.0)
        assert self.primary.state.is_guided
        return self

    def fail_over(self) -> None:
        """The primary turns faulty, and the standby is told to resume in the next cycle."""
        self.primary.driver.make_safe()
        self.is_primary_dead = True
        self.run(0.05)
        self.standby.driver.resume()
        self.standby.stage.is_quiet = False


@STYLES
def test_a_quiet_driver_writes_nothing(style: str) -> None:
    pair = Pair(style).in_flight()
    pair.is_primary_dead = True
    silence(pair.primary)
    pair.run(3.0)
    assert pair.primary.autopilot.commands == []
    assert pair.primary.autopilot.setpoints == []


@STYLES
def test_a_standby_takes_over_within_a_tenth_of_a_second_and_takes_its_primary_for_no_pilot(style: str) -> None:
    pair = Pair(style).in_flight()
    silence(pair.primary)
    failed_s = pair.primary.now_s
    pair.fail_over()
    pair.run(0.05)
    assert pair.standby.autopilot.setpoints
    assert pair.standby.autopilot.setpoints[0][0] - failed_s <= 0.1 + 1e-9
    pair.run(3.0)
    assert not pair.standby.state.has_pilot_control, pair.standby.state.pilot_reason
    assert pair.standby.state.is_guided
    assert pair.standby.autopilot.modes_asked[0] == "hold"
    assert pair.standby.autopilot.modes_asked[-1] == "guided"
    pair.standby.autopilot.enter(FlightMode.MANUAL)
    pair.run(0.3)
    assert pair.standby.state.has_pilot_control


@STYLES
def test_a_standby_knows_a_pilot_who_took_over_from_its_primary(style: str) -> None:
    pair = Pair(style).in_flight()
    pair.primary.autopilot.enter(FlightMode.LAND)
    pair.run(0.5)
    assert pair.primary.state.has_pilot_control
    silence(pair.primary)
    pair.fail_over()
    pair.run(3.0)
    assert pair.standby.state.has_pilot_control
    assert pair.standby.autopilot.setpoints == []
    assert pair.standby.autopilot.modes_asked == []


@STYLES
def test_a_pilot_who_takes_over_in_the_very_gap_wins(style: str) -> None:
    pair = Pair(style).in_flight()
    silence(pair.primary)
    pair.is_primary_dead = True
    pair.primary.autopilot.enter(FlightMode.MANUAL)
    pair.run(0.2)
    pair.standby.driver.resume()
    pair.standby.stage.is_quiet = False
    pair.run(3.0)
    assert pair.standby.state.has_pilot_control
    assert pair.standby.autopilot.setpoints == []


@STYLES
def test_a_standby_finishes_the_take_off_of_its_primary(style: str) -> None:
    pair = Pair(style)
    manoeuvre = Manoeuvre(action_id="go", kind=ManoeuvreKind.TAKE_OFF, height_m=2.0, may_arm=True)
    pair.run(0.2)
    for rig in pair.both():
        rig.stage.put(manoeuvre=manoeuvre)
    pair.run(0.1)
    pair.fail_over()
    pair.run(2.0)
    assert pair.standby.autopilot.commands[-1] == "take off to 2"
    assert pair.standby.state.manoeuvre_state == "running"
    assert not pair.standby.state.has_pilot_control


modes = st.sampled_from(list(FlightMode))


@settings(max_examples=25)
@given(st.lists(st.tuples(modes, st.booleans(), st.integers(1, 12)), min_size=1, max_size=6), st.booleans())
def test_nothing_is_ever_sent_while_the_pilot_has_control(
    events: list[tuple[FlightMode, bool, int]], is_px4: bool
) -> None:
    rig = DriverRig("px4" if is_px4 else "ardupilot").in_flight()
    for mode, asks_to_land, cycles in events:
        rig.autopilot.enter(mode)
        rig.see()
        if asks_to_land:
            rig.request(ManoeuvreKind.LAND)
        for _ in range(cycles):
            sent, commanded = len(rig.autopilot.setpoints), len(rig.autopilot.commands)
            rig.step()
            if rig.state.has_pilot_control:
                assert len(rig.autopilot.setpoints) == sent
                assert rig.autopilot.commands[commanded:] in ([], ["abandon"])
                assert not rig.state.is_streaming
