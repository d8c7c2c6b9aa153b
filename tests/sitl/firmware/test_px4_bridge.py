"""PX4's side is played by a peer written from its public interface; the real firmware has not flown on this yet."""

import pytest
from tests.sitl.firmware.px4_peer import Px4Peer

from gloc3.clock import VIRTUAL_EPOCH_S
from gloc3_sitl.firmware.body import BodySettings, SensedBody
from gloc3_sitl.firmware.px4 import RATE_HZ, Px4Bridge
from gloc3_sitl.world import World

HOVER = 0.524


def make(**settings: object) -> tuple[Px4Bridge, SensedBody]:
    body = SensedBody(World.load("open"), BodySettings(**settings), RATE_HZ)  # type: ignore[arg-type]
    return Px4Bridge(body, VIRTUAL_EPOCH_S), body


def run(bridge: Px4Bridge, peer: Px4Peer, steps: int) -> None:
    bridge.receive(peer.send_hello())
    for _ in range(steps):
        assert bridge.is_due
        bridge.receive(peer.take(bridge.step()))


def test_time_runs_freely_until_px4_answers_and_then_waits_for_each_answer() -> None:
    bridge, body = make()
    peer = Px4Peer(boot_steps=10)
    bridge.receive(peer.send_hello())
    for _ in range(10):
        assert bridge.is_due
        assert peer.take(bridge.step()) == b""
    answer = peer.take(bridge.step())
    bridge.receive(answer)
    assert bridge.is_in_step
    assert bridge.is_due
    answer = peer.take(bridge.step())
    assert not bridge.is_due
    bridge.receive(answer[:20])
    assert not bridge.is_due
    bridge.receive(answer[20:])
    assert bridge.is_due
    assert body.body.steps == 12
    assert peer.answered == bridge.answers == 2


def test_the_time_is_that_of_the_physics_in_microseconds() -> None:
    bridge, _ = make()
    peer = Px4Peer()
    run(bridge, peer, RATE_HZ)
    assert peer.now_us == 1_000_000


def test_sensors_come_at_their_rates_and_say_what_is_new() -> None:
    bridge, _ = make()
    peer = Px4Peer()
    run(bridge, peer, 4 * RATE_HZ)
    counts = peer.counts
    assert counts["HIL_SENSOR"] == counts["accel"] == counts["gyro"] == 1000
    assert counts["mag"] == pytest.approx(100, abs=2)
    assert counts["baro"] == pytest.approx(100, abs=2)
    assert counts["diff_press"] == 0
    assert counts["HIL_GPS"] == pytest.approx(40, abs=2)
    assert counts["DISTANCE_SENSOR"] == pytest.approx(80, abs=2)
    assert counts["HIL_STATE_QUATERNION"] == pytest.approx(800, abs=5)
    assert counts["HEARTBEAT"] == counts["SYSTEM_TIME"] == 4


def test_units_and_signs_are_those_of_the_interface() -> None:
    bridge, body = make()
    peer = Px4Peer()
    run(bridge, peer, RATE_HZ)
    sensor, fix, place = peer.sensor, peer.fix, body.truth()
    assert sensor is not None
    assert fix is not None
    assert peer.range is not None
    assert (sensor.xacc, sensor.yacc, sensor.zacc) == pytest.approx((0.0, 0.0, -9.81), abs=0.4)
    assert (sensor.xmag**2 + sensor.ymag**2 + sensor.zmag**2) ** 0.5 == pytest.approx(0.48, abs=0.1)  # gauss
    assert sensor.abs_pressure == pytest.approx(956.0, abs=25.0)  # hPa at 488 m
    assert sensor.pressure_alt == pytest.approx(488.0, abs=90.0)
    assert sensor.temperature == pytest.approx(11.8, abs=1.0)
    assert fix.lat * 1e-7 == pytest.approx(place.latitude_deg, abs=1e-6)
    assert fix.alt * 1e-3 == pytest.approx(place.altitude_m, abs=0.2)
    assert fix.fix_type == 6
    assert 1 <= fix.eph <= 10
    assert fix.time_usec * 1e-6 == pytest.approx(VIRTUAL_EPOCH_S + 0.8, abs=0.15)
    assert peer.range.orientation == 25
    assert peer.range.current_distance == pytest.approx(10, abs=6)


def test_without_satellites_there_is_no_fix() -> None:
    bridge, _ = make(is_without_gps=True)
    peer = Px4Peer()
    run(bridge, peer, RATE_HZ)
    assert peer.fix is not None
    assert peer.fix.fix_type == 1
    assert peer.fix.satellites_visible == 0
    assert peer.fix.eph == 65535


def test_an_inertial_unit_that_is_lost_does_not_stop_the_time() -> None:
    bridge, body = make()
    peer = Px4Peer()
    run(bridge, peer, 50)
    body.sensors.fail("imu", "lost")
    for _ in range(50):
        assert bridge.is_due
        bridge.receive(peer.take(bridge.step()))
    assert peer.counts["gyro"] == 50
    assert peer.now_us == 100 * 4000


def test_a_px4_without_lock_step_is_not_waited_for() -> None:
    bridge, _ = make()
    peer = Px4Peer(flags=0)
    run(bridge, peer, 100)
    bridge.step()
    assert bridge.is_due


def test_an_answer_that_comes_twice_or_late_makes_no_step_and_moves_nothing() -> None:
    bridge, _ = make()
    peer = Px4Peer(boot_steps=0, control=lambda peer: [0.0] * 4)
    first = peer.take(bridge.step())
    bridge.receive(first)
    peer.is_armed = False
    second = peer.take(bridge.step())
    bridge.receive(first)
    assert not bridge.is_due, "it answers the step before"
    bridge.receive(second + first)
    assert bridge.is_due
    assert not bridge.is_armed
    bridge.step()
    bridge.receive(second)
    assert not bridge.is_due, "and the next step is not answered in advance"
    assert (bridge.steps, bridge.answers, bridge.repeats) == (3, 5, 3)


def test_a_px4_that_connects_anew_finds_the_vehicle_at_home_at_time_0() -> None:
    bridge, body = make()
    run(bridge, Px4Peer(control=lambda peer: [0.8] * 4), 2 * RATE_HZ)
    assert body.truth().height_above_ground_m > 2.0
    assert bridge.is_armed
    bridge.connected()
    again = Px4Peer()
    assert not bridge.is_armed
    run(bridge, again, 100)
    assert again.now_us == 100 * 4000
    assert body.truth().height_above_ground_m == pytest.approx(0.0, abs=0.01)


def test_a_peer_that_controls_its_height_flies() -> None:
    def control(peer: Px4Peer) -> list[float]:
        assert peer.truth is not None
        height_m = peer.truth.alt * 1e-3 - 488.0
        climb_m_s = -peer.truth.vz * 1e-2
        return [HOVER - 0.15 * (height_m - 2.0) - 0.12 * climb_m_s] * 4

    bridge, body = make()
    peer = Px4Peer(control=control)
    run(bridge, peer, 5 * RATE_HZ)
    assert body.truth().height_above_ground_m == pytest.approx(2.0, abs=0.25)
    assert peer.answered == 5 * RATE_HZ - 25


def test_motors_are_numbered_as_those_of_px4s_quadrotor_in_x_form() -> None:
    def rates(*controls: float) -> tuple[float, float, float]:
        bridge, body = make()
        peer = Px4Peer(control=lambda peer: [0.7] * 4)
        run(bridge, peer, RATE_HZ)
        peer.control = lambda peer: list(controls)
        run(bridge, peer, RATE_HZ // 10)
        return body.truth().rate_frd_rad_s

    more, less = 0.74, 0.66
    assert rates(more, less, less, more)[0] < -0.3  # 1 and 4 are on the right
    assert rates(more, less, more, less)[1] > 0.3  # 1 and 3 are in front
    assert rates(more, more, less, less)[2] > 0.05  # 1 and 2 turn counter-clockwise
