"""The autopilot behind its link: who is taken for it, what it tells, and that no command waits, lingers or gets lost."""

import asyncio
import math
from collections.abc import Callable
from random import Random

import pytest
from tests.direct_link import wire
from tests.onboard.fake_autopilot import VEHICLE, FakeAutopilot

from gloc3.clock import Clock, VirtualLoop
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL
from gloc3.mavlink.transport.memory import Conditions, MemoryLink
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint
from gloc3.messages.vehicle import FlightMode, LandedState, Style
from gloc3_onboard.autopilot.commands import KEPT, NO_OWNER
from gloc3_onboard.autopilot.device import AutopilotDevice
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.autopilot.link_reports import SAID_S
from gloc3_onboard.autopilot.style import (
    ARM_DISARM,
    COMMON_STREAMS,
    NAV_LAND,
    NAV_TAKEOFF,
    PROGRESS,
    SET_MODE,
    MavCommand,
)
from gloc3_onboard.companion.link_watch import RateWatch
from gloc3_onboard.sensors.devices import AutopilotSetpoint, GeoPath

STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])
REQUEST_MESSAGE = 512
FENCE_ENABLE = 207
SET_POSITION = "SET_POSITION_TARGET_LOCAL_NED"


class Rig:
    """A companion and an autopilot on a link of 20 ms."""

    def __init__(self, style: str = "px4", *, loss: float = 0.0, own: Address = VEHICLE, vehicle_type: int = 2) -> None:
        self.loop = VirtualLoop()
        self.wire = MemoryLink(self.loop, Random(3), Conditions(latency_s=0.02, loss=loss))
        self.reported: list[str] = []
        self.why_not_arm = ""
        self.link = AutopilotLink(
            self.loop, Clock(self.loop), report=self._report, why_not_arm=lambda: self.why_not_arm
        )
        self.device = AutopilotDevice(self.link)
        self.autopilot = FakeAutopilot(self.loop, self.wire.b, style, own, vehicle_type)
        self.routed = wire(self.link, self.wire.a, self.loop)

    def _report(self, severity: Severity, text: str, /, *, cause: str = "") -> None:
        self.reported.append(text)

    def run(self, seconds: float) -> "Rig":
        self.loop.run_until_complete(asyncio.sleep(seconds))
        return self

    def requested(self, command: int) -> list[tuple[float, ...]]:
        return [request.params for request in self.autopilot.ran if request.command == command]

    def until(self, condition: Callable[[], bool], within_s: float) -> float:
        begin_s = self.loop.time()
        while not condition():
            assert self.loop.time() - begin_s < within_s
            self.run(0.02)
        return self.loop.time() - begin_s

    def __enter__(self) -> "Rig":
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()
        self.loop.close()
        assert self.loop.failures == []


@STYLES
def test_it_is_found_told_apart_and_asked_for_everything_that_is_needed(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        assert rig.reported[0] == f"{style} autopilot found as 1/1, on a copter"
        assert rig.device.state().style is Style(style)
        for stream in COMMON_STREAMS:
            name = codec.name_of(stream.message_id)
            assert rig.autopilot.rate_hz(name or "") == pytest.approx(stream.rate_hz), name
        assert rig.autopilot.rate_hz("HEARTBEAT") == (0.0 if style == "px4" else 5.0), "PX4 would refuse"


@STYLES
def test_what_it_tells(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        state, pose, height = rig.device.state(), rig.device.pose(), rig.device.height()
        assert (state.is_connected, state.is_armed, state.mode) == (True, False, FlightMode.HOLD)
        assert (state.landed, state.is_armable) == (LandedState.ON_GROUND, True)
        assert (state.battery_v, state.battery_a, state.battery_remaining) == pytest.approx((11.5, 1.5, 0.8))
        assert pose is not None
        assert height is not None
        assert pose.pose.position_ned_m == (0.0, 0.0, -2.0)
        assert pose.pose.origin_geo == pytest.approx((39.5, 2.6, 5.0))
        assert rig.loop.time() - pose.t_s < 0.1
        assert height.height.height_m == pytest.approx(2.1)
        assert height.height.is_valid


def test_over_a_bad_link_all_streams_are_asked_for_in_the_end() -> None:
    with Rig(loss=0.3) as rig:
        rig.run(20.0)
        for stream in COMMON_STREAMS:
            assert rig.autopilot.rate_hz(codec.name_of(stream.message_id) or "") == pytest.approx(stream.rate_hz)


@pytest.mark.parametrize("off_s", [0.5, 6.0])
def test_after_a_restart_the_streams_and_the_origin_are_asked_for_again(off_s: float) -> None:
    with Rig() as rig:
        rig.run(10.0)
        origins = [values[0] for values in rig.requested(REQUEST_MESSAGE)].count(49.0)
        assert origins == 1, "it is known"
        contacts = rig.device.contacts
        rig.autopilot.is_off = True
        rig.run(off_s)
        assert rig.device.state().is_connected == (off_s < 2.5)
        rig.autopilot.is_off = False
        rig.autopilot.boot()
        rig.until(lambda: rig.autopilot.rate_hz("LOCAL_POSITION_NED") == pytest.approx(20.0), 8.0)
        rig.run(3.0)
        assert rig.device.state().is_connected
        pose = rig.device.pose()
        assert pose is not None
        assert rig.loop.time() - pose.t_s < 0.2
        assert pose.pose.origin_geo is not None
        assert [values[0] for values in rig.requested(REQUEST_MESSAGE)].count(49.0) == origins + 1
        assert "the autopilot has restarted" in rig.reported
        assert contacts == 1 < rig.device.contacts


def test_a_stream_that_stays_away_is_asked_for_again_and_a_refused_one_is_not() -> None:
    with Rig() as rig:
        rig.run(5.0)
        rig.autopilot._streams.set_rate("DISTANCE_SENSOR", 0.0, rig.loop.time())
        rig.until(lambda: rig.autopilot.rate_hz("DISTANCE_SENSOR") == pytest.approx(20.0), 8.0)
    with Rig() as rig:
        rig.autopilot.refuses[511] = CommandResult.DENIED, "no"
        rig.run(10.0)
        assert len(rig.requested(511)) == len(rig.link.style.streams)
        assert len([text for text in rig.reported if "refuses to send" in text]) == len(rig.link.style.streams)
        assert any(text.startswith("the autopilot refuses to send SYS_STATUS at 2 Hz: denied") for text in rig.reported)


def test_a_stream_that_another_station_has_slowed_down_is_asked_for_again_and_one_that_flows_is_not() -> None:
    with Rig() as rig:
        rig.run(5.0)
        requested = len(rig.requested(511))
        rig.run(30.0)
        assert len(rig.requested(511)) == requested
        usual_hz = rig.autopilot.rate_hz("LOCAL_POSITION_NED")
        assert usual_hz > 8.0
        rig.autopilot._streams.set_rate("LOCAL_POSITION_NED", 4.0, rig.loop.time())
        rig.until(lambda: rig.autopilot.rate_hz("LOCAL_POSITION_NED") == pytest.approx(usual_hz), 12.0)
        assert len(rig.requested(511)) == requested + 1


def test_when_a_station_asks_for_all_streams_ours_are_asked_for_right_behind_it() -> None:
    with Rig() as rig:
        rig.run(5.0)
        watch, station = RateWatch(rig.link.request_streams_again, rig.loop.time), codec.Encoder(255, 190)
        wanted = {codec.name_of(stream.message_id): stream.rate_hz for stream in rig.link.style.streams}
        parser = codec.Parser()
        slow = codec.message(
            "REQUEST_DATA_STREAM", target_system=1, target_component=1, req_message_rate=4, start_stop=1
        )
        other = codec.message("COMMAND_LONG", target_system=1, target_component=1, command=ARM_DISARM)
        watch.receive(parser.receive(station.encode(other)))
        rig.run(1.0)
        requested = len(rig.requested(511))
        for _ in range(2):  # as MAVProxy sends it
            rig.autopilot._streams.receive(slow, codec.Address(255, 190), rig.loop.time())
            watch.receive(parser.receive(station.encode(slow)))
            rig.run(0.02)
        assert {name: rig.autopilot.rate_hz(name) for name in wanted} == pytest.approx(wanted, rel=1e-3)
        rig.run(2.0)
        assert len(rig.requested(511)) <= requested + 4 * len(wanted)
        requested = len(rig.requested(511))
        for _ in range(500):  # a flood of them is answered a few times
            rig.autopilot._streams.receive(slow, codec.Address(255, 190), rig.loop.time())
            watch.receive(parser.receive(station.encode(slow)))
        rig.run(1.0)
        assert {name: rig.autopilot.rate_hz(name) for name in wanted} == pytest.approx(wanted)
        assert len(rig.requested(511)) <= requested + 8 * len(wanted)


def test_an_autopilot_of_another_kind_is_left_alone() -> None:
    with Rig("paparazzi") as rig:
        rig.run(5.0)
        kind = "an unsupported autopilot (MAV_AUTOPILOT 4, MAV_TYPE 2)"
        assert rig.reported == [f"1/1 is {kind}: it is ignored"]
        ticket = rig.device.command_arm()
        rig.device.send_setpoint(AutopilotSetpoint((0.0, 0.0, 0.0), None, None))
        rig.run(1.0)
        assert rig.device.answer(ticket) == (False, NO_OWNER)
        assert rig.autopilot.ran == []
        assert not rig.device.state().is_connected


def test_an_autopilot_of_another_system_is_taken_when_it_has_been_alone() -> None:
    with Rig(own=Address(7, 1)) as rig:
        rig.run(2.0)
        assert rig.reported == []
        rig.run(2.0)
        assert rig.reported == ["px4 autopilot found as 7/1, on a copter"]


def test_something_else_that_calls_itself_an_autopilot_does_not_keep_it_from_ours() -> None:
    with Rig() as rig:
        gimbal = codec.Encoder(1, 154).encode(codec.message("HEARTBEAT", type=26, autopilot=0))
        rig.routed.receive(gimbal)
        rig.run(2.0)
        assert rig.reported[0] == "px4 autopilot found as 1/1, on a copter"


def test_a_command_before_there_is_an_autopilot_is_refused_and_never_sent_later() -> None:
    with Rig() as rig:
        rig.autopilot.is_off = True
        ticket = rig.device.command_arm()
        assert rig.device.answer(ticket) == (False, NO_OWNER)
        rig.autopilot.is_off = False
        rig.run(5.0)
        assert rig.requested(ARM_DISARM) == []


@STYLES
def test_modes_arming_and_take_off_in_the_words_of_each_style(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        tickets = [rig.device.command_arm(), rig.device.command_take_off(1.5)]
        rig.run(0.5)
        for mode in (FlightMode.GUIDED, FlightMode.HOLD, FlightMode.LAND):
            tickets.append(rig.device.command_mode(mode))
            rig.run(0.5)
        assert all(rig.device.answer(ticket) == (True, "") for ticket in tickets)
        assert rig.requested(ARM_DISARM)[0][0] == 1.0
        (take_off,) = rig.requested(NAV_TAKEOFF)
        if style == "px4":
            assert take_off[6] == pytest.approx(9.0), "altitude above the sea"
            assert math.isnan(take_off[3])
            assert [params[:3] for params in rig.requested(SET_MODE)] == [(1.0, 6.0, 0.0), (1.0, 4.0, 3.0)]
            assert len(rig.requested(NAV_LAND)) == 1
        else:
            assert take_off[6] == pytest.approx(1.5), "height above home"
            assert [params[:2] for params in rig.requested(SET_MODE)] == [(1.0, 4.0), (1.0, 17.0), (1.0, 9.0)]


def test_a_take_off_before_the_altitude_is_known_is_refused() -> None:
    with Rig() as rig:
        rig.autopilot.refuses[511] = CommandResult.DENIED, "no"
        rig.run(4.0)
        ticket = rig.device.command_take_off(2.0)
        assert rig.device.answer(ticket) == (False, "the autopilot has not sent its altitude yet")


@STYLES
def test_a_refusal_is_answered_with_what_the_autopilot_says_at_once_or_a_moment_later(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        why = "Arming denied: the compass is not calibrated, and the battery is low, too"
        rig.autopilot.refuses[ARM_DISARM] = CommandResult.TEMPORARILY_REJECTED, why
        ticket = rig.device.command_arm()
        elapsed_s = rig.until(lambda: rig.device.answer(ticket) is not None, 2.0)
        answer = rig.device.answer(ticket)
        assert answer is not None
        assert not answer.is_accepted
        assert answer.reason == f"rejected for now; it may be accepted later: {why}"
        assert elapsed_s < 0.6


@pytest.mark.parametrize(("rate", "within_s"), [(1.0, 20.0), (1.2, 20.0), (2.0, 5.0), (5.0, 2.0)])
def test_an_autopilot_whose_clock_is_too_fast_is_noticed(rate: float, within_s: float) -> None:
    with Rig() as rig:
        rig.autopilot.clock_rate = rate
        rig.run(within_s)
        found = rig.link.inspection.setup.clock_rate
        assert found == pytest.approx(rate if rate >= 1.5 else 1.0, abs=0.3)


def test_a_link_that_stalls_and_catches_up_is_no_fast_clock() -> None:
    with Rig() as rig:
        rig.run(2.0)
        rig.wire.a.conditions = rig.wire.b.conditions = Conditions(latency_s=4.0)
        rig.run(5.0)
        rig.wire.a.conditions = rig.wire.b.conditions = Conditions(latency_s=0.02)
        rig.run(15.0)
        assert rig.link.inspection.setup.clock_rate == 1.0


@STYLES
def test_the_item_under_way_is_requested_only_where_its_rate_can_be_chosen(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        places = (GeoPoint(47.0, 8.0, 500.0), GeoPoint(47.001, 8.0, 500.0))
        rig.device.command_plan(GeoPath(places, 5.0, 2.0, 0.0, None))
        rig.run(1.0)
        assert any(m.name == "MISSION_COUNT" for m in rig.autopilot.received)
        requested = [params for params in rig.requested(SET_MESSAGE_INTERVAL) if params[0] == PROGRESS.message_id]
        assert len(requested) == (style == "ardupilot"), "PX4 refuses, and sends it at its own rate"


@STYLES
def test_warnings_of_the_autopilot_are_told_as_it_says_them_and_not_over_and_over(style: str) -> None:
    with Rig(style) as rig:
        rig.run(3.0)
        for severity, text in [
            (2, "Reposition is outside geofence\t"),
            (4, "EKF lane switch"),
            (6, "Takeoff detected"),
        ]:
            rig.autopilot.report(text, severity)
        rig.autopilot.report("PreArm: no fix", 2)
        rig.run(0.2)
        rig.autopilot.report("EKF lane switch", 4)
        rig.run(0.2)
        told = [text for text in rig.reported if text.startswith("the autopilot says")]
        assert told == ["the autopilot says: Reposition is outside geofence", "the autopilot says: EKF lane switch"]
        rig.run(SAID_S)
        rig.autopilot.report("EKF lane switch", 4)
        rig.run(0.2)
        assert [text for text in rig.reported if "lane switch" in text] == ["the autopilot says: EKF lane switch"] * 2


def test_reasons_against_arming_are_kept_until_it_would_arm() -> None:
    with Rig() as rig:
        rig.run(3.0)
        rig.link.telemetry._set(is_armable=False)
        rig.autopilot.report("PreArm: no fix")
        rig.run(0.1)
        assert "PreArm: no fix" in rig.device.state().reasons
        rig.run(1.0)
        assert rig.device.state().reasons == []


@STYLES
def test_hold_never_waits_behind_an_older_mode_command(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        rig.autopilot.silent_on = {SET_MODE}
        guided = rig.device.command_mode(FlightMode.GUIDED)
        rig.run(0.3)
        hold = rig.device.command_mode(FlightMode.HOLD)
        rig.run(0.05)
        wanted = (1.0, 4.0, 3.0) if style == "px4" else (1.0, 17.0, 0.0)
        message = next(
            m for m in reversed(rig.autopilot.received) if m.name == "COMMAND_LONG" and m.command == SET_MODE
        )
        assert (message.param1, message.param2, message.param3) == wanted
        assert rig.device.answer(guided) == (False, "superseded by a later command")
        assert rig.device.answer(hold) is None


@STYLES
@pytest.mark.parametrize("mode", [FlightMode.LAND, FlightMode.TAKE_OFF])
def test_an_unanswered_landing_or_take_off_is_not_repeated_after_a_hold(style: str, mode: FlightMode) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        rig.autopilot.silent_on = {NAV_LAND, NAV_TAKEOFF, SET_MODE}
        older = rig.device.command_take_off(2.0) if mode is FlightMode.TAKE_OFF else rig.device.command_mode(mode)
        rig.run(0.3)
        rig.autopilot.silent_on = set()
        rig.autopilot.received.clear()
        rig.device.command_mode(FlightMode.HOLD)
        rig.run(5.0)
        assert [m.command for m in rig.autopilot.received if m.name == "COMMAND_LONG"] == [SET_MODE]
        assert rig.device.answer(older) == (False, "superseded by a later command")


@STYLES
def test_after_the_pilot_has_taken_over_nothing_is_sent_again(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        rig.autopilot.silent_on = {SET_MODE, ARM_DISARM}
        tickets = [rig.device.command_mode(FlightMode.GUIDED), rig.device.command_arm()]
        rig.run(0.1)
        rig.device.abandon_commands()
        rig.autopilot.received.clear()
        rig.run(10.0)
        assert not [
            m for m in rig.autopilot.received if m.name == "COMMAND_LONG" and m.command in (SET_MODE, ARM_DISARM)
        ]
        assert all(rig.device.answer(ticket) == (False, "control was taken over") for ticket in tickets)


def test_a_command_that_is_never_answered_is_told_in_good_time() -> None:
    with Rig() as rig:
        rig.run(4.0)
        rig.wire.a.conditions = Conditions(loss=1.0)
        ticket = rig.device.command_mode(FlightMode.HOLD)
        rig.until(lambda: rig.device.answer(ticket) is not None, 6.0)
        assert rig.device.answer(ticket) == (False, "not answered")


def test_answers_are_kept_for_the_last_commands_only() -> None:
    with Rig() as rig:
        rig.run(4.0)
        tickets = [rig.device.command_mode(FlightMode.HOLD) for _ in range(3 * KEPT)]
        rig.run(1.0)
        assert len(rig.link.commands._answers) <= KEPT
        assert rig.device.answer(tickets[0]) is None
        assert rig.device.answer(tickets[-1]) == (True, "")


@pytest.mark.parametrize(
    ("position", "velocity", "yaw", "mask"),
    [
        ((1.0, 2.0, -3.0), (0.1, 0.2, 0.3), 0.5, 0b1001_1100_0000),
        ((1.0, 2.0, -3.0), None, 0.5, 0b1001_1111_1000),
        (None, (0.1, 0.2, 0.3), None, 0b1101_1100_0111),
    ],
)
@STYLES
def test_setpoints_and_what_of_them_is_to_be_ignored(
    style: str,
    position: tuple[float, float, float] | None,
    velocity: tuple[float, float, float] | None,
    yaw: float | None,
    mask: int,
) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        rig.device.send_setpoint(AutopilotSetpoint(position, velocity, yaw))
        rig.run(0.1)
        received = next(message for message in rig.autopilot.received if message.name == SET_POSITION)
        assert (received.type_mask, received.coordinate_frame, received.target_system) == (mask, 1, 1)
        assert (received.x, received.y, received.z) == (position or (0.0, 0.0, 0.0))
        assert (received.vx, received.vy, received.vz) == pytest.approx(velocity or (0.0, 0.0, 0.0))
        assert received.time_boot_ms == pytest.approx(4000, abs=60)


def test_garbage_and_others_do_no_harm() -> None:
    with Rig() as rig:
        rig.run(4.0)
        stranger = codec.Encoder(9, 1)
        rig.routed.receive(stranger.encode(codec.message("EXTENDED_SYS_STATE", landed_state=2)))
        rig.routed.receive(bytes(range(256)) * 4)
        assert rig.device.state().landed is LandedState.ON_GROUND
        rig.run(1.0)
        assert rig.device.state().is_connected


@pytest.mark.parametrize("later", [CommandResult.ACCEPTED, CommandResult.FAILED])
def test_a_refusal_that_may_end_soon_is_followed_by_other_attempts_for_a_time(later: CommandResult) -> None:
    with Rig("ardupilot") as rig:
        rig.run(3.0)
        rig.autopilot.refuses[FENCE_ENABLE] = (CommandResult.FAILED, "")
        ticket = rig.link.commands.ticket()
        command = MavCommand(FENCE_ENABLE, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        rig.link.commands.send(ticket, command, VEHICLE, rig.loop.time(), patience_s=3.0)
        rig.run(1.2)
        assert rig.link.commands.answer(ticket) is None
        if later is CommandResult.ACCEPTED:
            del rig.autopilot.refuses[FENCE_ENABLE]
        begin_s = rig.loop.time()
        rig.until(lambda: rig.link.commands.answer(ticket) is not None, 3.0)
        answer = rig.link.commands.answer(ticket)
        assert answer is not None
        assert answer.is_accepted is (later is CommandResult.ACCEPTED)
        assert (rig.loop.time() - begin_s > 1.0) is (later is CommandResult.FAILED)
        tries = len(rig.requested(FENCE_ENABLE))
        rig.run(3.0)
        assert len(rig.requested(FENCE_ENABLE)) == tries


def test_no_further_attempt_follows_a_later_command_of_its_kind() -> None:
    with Rig("ardupilot") as rig:
        rig.run(3.0)
        rig.autopilot.refuses[FENCE_ENABLE] = (CommandResult.FAILED, "")
        tickets = [rig.link.commands.ticket() for _ in range(2)]
        for ticket, value in zip(tickets, (1.0, 0.0), strict=True):
            command = MavCommand(FENCE_ENABLE, (value, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
            rig.link.commands.send(ticket, command, VEHICLE, rig.loop.time(), patience_s=3.0 * value)
            rig.run(0.2)
        rig.run(2.0)
        assert [params[0] for params in rig.requested(FENCE_ENABLE)] == [1.0, 0.0]
        assert "superseded" in str(rig.link.commands.answer(tickets[0]))
