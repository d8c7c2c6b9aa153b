"""What an autopilot tells, and when it was so: its clock and ours."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.mavlink import codec
from gloc3.mavlink.message import Address
from gloc3.messages.vehicle import FlightMode
from gloc3_onboard.autopilot.ardupilot import ArduPilot
from gloc3_onboard.autopilot.px4 import Px4
from gloc3_onboard.autopilot.style import MavCommand
from gloc3_onboard.autopilot.telemetry import BootClock, ClockOffset, Telemetry


def test_the_fastest_message_tells_how_the_clocks_lie() -> None:
    clock = BootClock()
    assert clock.t_s(1000, 11.2) == pytest.approx(11.2)
    assert clock.t_s(2000, 12.05) == pytest.approx(12.05)
    assert clock.t_s(3000, 13.3) == pytest.approx(13.05, abs=1e-3)
    assert clock.boot_ms(13.3) == pytest.approx(3250, abs=1)


def test_a_burst_after_a_stall_is_old_and_not_taken_for_new() -> None:
    clock = BootClock()
    for step in range(20):
        clock.t_s(1000 + 50 * step, 11.0 + 0.05 * step)
    assert clock.t_s(2000, 15.0) == pytest.approx(12.0, abs=0.01)
    assert clock.restarts == 0


def test_a_clock_that_has_restarted_is_followed_from_its_second_stamp() -> None:
    clock = BootClock()
    clock.t_s(60_000, 100.0)
    assert clock.t_s(59_800, 100.01) == pytest.approx(99.8, abs=0.01), "only overtaken"
    assert clock.t_s(200, 103.0) == pytest.approx(40.2), "one alone may be anything"
    assert clock.restarts == 0
    assert clock.t_s(210, 103.01) == pytest.approx(103.01)
    assert clock.restarts == 1
    assert clock.t_s(700, 103.5) == pytest.approx(103.5)


def test_a_sensor_that_has_stopped_and_is_repeated_is_no_restart() -> None:
    clock = BootClock()
    for step in range(100):
        now_s = 100.0 + 0.1 * step
        assert clock.t_s(60_000 + 100 * step, now_s) == pytest.approx(now_s)
        assert clock.t_s(59_950, now_s) == pytest.approx(99.95, abs=0.01), "as old as it is"
        assert clock.t_s(59_950, now_s) == pytest.approx(99.95, abs=0.01)
    assert clock.restarts == 0


def test_a_slow_clock_is_followed() -> None:
    clock = BootClock()
    for step in range(4000):
        t_s = clock.t_s(int(step * 250 * (1.0 - 5e-5)), step * 0.25)
        assert abs(t_s - step * 0.25) < 0.02


def test_an_autopilot_that_stood_still_and_answers_all_at_once_has_not_restarted() -> None:
    telemetry = Telemetry()
    offset = ClockOffset(Address(1, 191), telemetry)
    service = offset.service
    service.request(Address(1, 1))
    requested = [3.15, 3.73, 4.27, 4.83, 5.35, 5.86, 6.36]
    questions = []
    for now_s in requested:
        service.tick(now_s)
        questions += [message.ts1 for message in service.outgoing()]
    # As heard of a simulation that was short of its computer: five answers in one burst, and two from 2.6 s later.
    answers = [(5.42, 0.255), *[(5.43, 0.255)] * 4, (6.48, 2.82), (6.49, 2.82)]
    telemetry.t_s(255, 5.42)
    for (now_s, reported_s), question in zip(answers, questions, strict=True):
        answer = codec.message("TIMESYNC", tc1=round(reported_s * 1e9), ts1=question)
        service.receive(answer, Address(1, 1), now_s)
        telemetry.t_s(reported_s * 1e3, now_s)
        offset.poll(now_s)
    assert telemetry.restarts == 0


def test_what_an_autopilot_tells_after_a_pause_of_its_clock_is_not_taken_for_old() -> None:
    telemetry = Telemetry()
    offset = ClockOffset(Address(1, 191), telemetry)
    service = offset.service
    service.request(Address(1, 1))

    def ask_and_answer(now_s: float, reported_s: float, late_s: float) -> None:
        service.tick(now_s)
        answer = codec.message("TIMESYNC", tc1=round(reported_s * 1e9), ts1=service.outgoing()[0].ts1)
        service.receive(answer, Address(1, 1), now_s + late_s)
        offset.poll(now_s + late_s)

    for step in range(10):
        assert telemetry.t_s(1000 * step, 100.0 + step) == pytest.approx(100.0 + step)
        ask_and_answer(100.0 + step, 0.001 + step, 0.002)
    assert telemetry.t_s(10_000, 110.7) == pytest.approx(110.0, abs=0.01), "late, as far as is known"
    ask_and_answer(110.7, 10.001, 0.4)
    assert telemetry.t_s(10_450, 111.15) == pytest.approx(111.15, abs=0.01), "one round trip shows it, however slow"
    assert telemetry.t_s(10_500, 111.5) == pytest.approx(111.2, abs=0.01), "what is late since then is late"


@settings(max_examples=50)
@given(st.lists(st.tuples(st.floats(0.0, 0.5), st.integers(1, 200)), min_size=2, max_size=30))
def test_nothing_is_ever_valid_later_than_it_was_heard(messages: list[tuple[float, int]]) -> None:
    clock = BootClock()
    boot_ms = 0
    for delay_s, step_ms in messages:
        boot_ms += step_ms
        now_s = 50.0 + boot_ms * 1e-3 + delay_s
        assert clock.t_s(boot_ms, now_s) <= now_s + 1e-9


def received(name: str, *, style: Any = None, **fields: Any) -> Telemetry:
    telemetry = Telemetry()
    telemetry.adopt(style or Px4())
    telemetry.receive(codec.message(name, **fields), 1.0)
    return telemetry


@pytest.mark.parametrize(
    ("style", "custom_mode", "mode", "name"),
    [
        (Px4(), 6 << 16, FlightMode.GUIDED, "OFFBOARD"),
        (Px4(), 4 << 16 | 3 << 24, FlightMode.HOLD, "AUTO.LOITER"),
        (Px4(), 3 << 16, FlightMode.MANUAL, "POSCTL"),
        (Px4(), 4 << 16 | 5 << 24, FlightMode.RETURN, "AUTO.RTL"),
        (Px4(), 10 << 16, FlightMode.OTHER, "TERMINATION"),
        (Px4(), 99 << 16, FlightMode.OTHER, f"mode {99 << 16}"),
        (ArduPilot(), 4, FlightMode.GUIDED, "GUIDED"),
        (ArduPilot(), 17, FlightMode.HOLD, "BRAKE"),
        (ArduPilot(), 5, FlightMode.MANUAL, "LOITER"),
        (ArduPilot(), 9, FlightMode.LAND, "LAND"),
        (ArduPilot(), 99, FlightMode.OTHER, "mode 99"),
    ],
)
def test_modes_are_read_by_the_style(style: Px4 | ArduPilot, custom_mode: int, mode: FlightMode, name: str) -> None:
    state = received("HEARTBEAT", style=style, custom_mode=custom_mode, base_mode=128 | 1, system_status=5).state
    assert (state.mode, state.mode_name, state.is_armed, state.is_failsafe) == (mode, name, True, True)


@pytest.mark.parametrize("is_mode_first", [True, False])
def test_the_mode_in_which_ardupilot_answers_a_breach_of_its_fence_is_its_failsafe(is_mode_first: bool) -> None:
    telemetry = Telemetry()
    telemetry.adopt(ArduPilot())
    guided, returning = (
        codec.message("HEARTBEAT", custom_mode=mode, base_mode=129, system_status=4) for mode in (4, 6)
    )
    breach = codec.message("FENCE_STATUS", breach_status=1, breach_count=3)
    telemetry.receive(codec.message("FENCE_STATUS", breach_status=0, breach_count=2), 1.0)
    telemetry.receive(guided, 1.0)
    assert not telemetry.state.is_failsafe
    for message in (returning, breach) if is_mode_first else (breach, returning):
        telemetry.receive(message, 10.0)
    assert telemetry.state.is_failsafe
    telemetry.receive(breach, 15.0)
    telemetry.receive(returning, 15.0)
    assert telemetry.state.is_failsafe, "as long as it returns"
    telemetry.receive(guided, 16.0)
    assert not telemetry.state.is_failsafe, "somebody has taken over"


@pytest.mark.parametrize("mode", [FlightMode.GUIDED, FlightMode.HOLD, FlightMode.LAND, FlightMode.RETURN])
@pytest.mark.parametrize("style", [Px4(), ArduPilot()])
def test_the_modes_that_are_asked_for_are_those_that_are_read(style: Px4 | ArduPilot, mode: FlightMode) -> None:
    command = style.mode_command(mode)
    assert isinstance(command, MavCommand)
    if command.number == 176:
        main, sub = int(command.parameters[1]), int(command.parameters[2])
        assert style.flight_mode(main << 16 | sub << 24 if isinstance(style, Px4) else main) is mode


def test_what_a_battery_does_not_tell() -> None:
    state = received("SYS_STATUS", voltage_battery=65535, current_battery=-1, battery_remaining=-1).state
    assert (state.battery_v, state.battery_a, state.battery_remaining) == (0.0, 0.0, -1.0)


def test_a_range_that_does_not_look_down_or_has_no_echo() -> None:
    limits = {"min_distance": 20, "max_distance": 700}
    assert received("DISTANCE_SENSOR", current_distance=100, orientation=0, **limits).height is None
    for distance, is_valid in ((10, False), (100, True), (701, False)):
        stamped = received("DISTANCE_SENSOR", current_distance=distance, orientation=25, **limits).height
        assert stamped is not None
        assert stamped.height.is_valid == is_valid
        assert bool(stamped.height.reason) != is_valid


def test_without_an_attitude_there_is_no_pose() -> None:
    assert received("LOCAL_POSITION_NED", time_boot_ms=5).pose is None
