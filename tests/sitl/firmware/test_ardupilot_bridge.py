"""ArduPilot's side is played by a peer that scans the text as the firmware does."""

import pytest
from tests.sitl.firmware.json_peer import JsonPeer

from gloc3_sitl.firmware.ardupilot import NO_ECHO_M, RATE_HZ, ArduPilotBridge
from gloc3_sitl.firmware.body import BodySettings, SensedBody
from gloc3_sitl.world import World

HERE, THERE = ("127.0.0.1", 40001), ("127.0.0.1", 40002)
STEP_S = 1.0 / RATE_HZ
HOVER_US = 1524


def make(**settings: object) -> tuple[ArduPilotBridge, SensedBody]:
    body = SensedBody(World.load("open"), BodySettings(**settings), RATE_HZ)  # type: ignore[arg-type]
    return ArduPilotBridge(body), body


def exchange(bridge: ArduPilotBridge, peer: JsonPeer, *pwm_us: int, sender: object = HERE) -> bool:
    answer = bridge.receive(peer.servos(*pwm_us), sender)
    return answer is not None and peer.take(answer)


def test_each_packet_is_one_step_and_the_time_is_that_of_the_physics() -> None:
    bridge, body = make()
    peer = JsonPeer()
    for count in range(1, 41):
        assert exchange(bridge, peer)
        assert peer.state["timestamp"][0] == pytest.approx(count * STEP_S, abs=1e-6)
    assert peer.frame == bridge.steps == 40
    assert body.now_s == pytest.approx(40 * STEP_S)
    assert peer.now_s == pytest.approx(body.now_s, abs=1e-6)


def test_at_rest_it_feels_its_weight_and_stands_at_home() -> None:
    bridge, _ = make()
    peer = JsonPeer()
    for _ in range(200):
        exchange(bridge, peer)
    assert peer.state["accel_body"] == pytest.approx((0.0, 0.0, -9.81), abs=0.4)
    assert peer.state["position"] == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert peer.state["velocity"] == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert peer.state["rng_1"][0] == pytest.approx(0.10, abs=0.08)


def test_a_packet_that_comes_again_gets_the_last_answer_and_time_stands() -> None:
    bridge, body = make()
    peer = JsonPeer()
    first = bridge.receive(peer.servos(), HERE)
    assert bridge.receive(peer.servos(), HERE) == first
    assert bridge.repeats == 1
    assert body.body.steps == 1


def test_a_count_that_leaves_some_out_is_one_step() -> None:
    bridge, body = make()
    peer = JsonPeer()
    exchange(bridge, peer)
    peer.frame += 5
    assert exchange(bridge, peer)
    assert bridge.skips == 5
    assert body.body.steps == 2


@pytest.mark.parametrize("sender", [HERE, THERE])
def test_a_firmware_that_starts_anew_finds_the_vehicle_at_home_at_time_0(sender: object) -> None:
    bridge, _ = make()
    peer = JsonPeer()
    for _ in range(2 * RATE_HZ):
        exchange(bridge, peer, *[1800] * 4)
    assert peer.state["position"][2] < -2.0
    again = JsonPeer()
    assert exchange(bridge, again, sender=sender)
    assert bridge.restarts == 1
    assert again.state["timestamp"][0] == pytest.approx(STEP_S, abs=1e-6)
    assert again.state["position"][2] == pytest.approx(0.0, abs=0.01)
    assert again.jumps == 0
    assert exchange(bridge, again, sender=sender)


def test_a_second_firmware_on_the_same_port_is_not_answered() -> None:
    bridge, body = make()
    peer, other = JsonPeer(), JsonPeer()
    exchange(bridge, peer)
    other.frame = 900
    assert bridge.receive(other.servos(), THERE) is None
    assert bridge.receive(b"what?", HERE) is None
    assert bridge.refused == 2
    assert body.body.steps == 1


@pytest.mark.parametrize("channels", [16, 32])
def test_motors_are_numbered_as_those_of_a_quadrotor_in_x_form(channels: int) -> None:
    def rates(*pwm_us: int) -> tuple[float, ...]:
        bridge, _ = make()
        peer = JsonPeer(channels)
        for _ in range(RATE_HZ):
            exchange(bridge, peer, *[1700] * 4)
        for _ in range(RATE_HZ // 10):
            exchange(bridge, peer, *pwm_us)
        return peer.state["gyro"]

    more, less = 1740, 1660
    assert rates(more, less, less, more)[0] < -0.3  # 1 and 4 are on the right: it rolls to the left
    assert rates(more, less, more, less)[1] > 0.3  # 1 and 3 are in front: the nose rises
    assert rates(more, more, less, less)[2] > 0.05  # 1 and 2 turn counter-clockwise: it turns clockwise


def test_a_height_sensor_without_an_echo_says_so_by_a_range_out_of_range() -> None:
    bridge, body = make()
    peer = JsonPeer()
    body.sensors.fail("height", "lost")
    for _ in range(100):
        exchange(bridge, peer)
    assert peer.state["rng_1"] == (NO_ECHO_M,)


def test_faults_of_the_inertial_unit_reach_the_firmware() -> None:
    bridge, body = make()
    peer = JsonPeer()
    body.sensors.fail("imu", "biased", 3.0)
    for _ in range(10):
        exchange(bridge, peer)
    assert peer.state["accel_body"][0] == pytest.approx(3.0, abs=0.5)


def test_the_world_is_under_the_vehicle() -> None:
    bridge, body = make()
    assert body.world.name == "open"
    hold = SensedBody(World.load("hold"), BodySettings(), RATE_HZ)
    peer = JsonPeer()
    bridge = ArduPilotBridge(hold)
    for _ in range(100):
        exchange(bridge, peer)
    assert peer.state["position"][2] == pytest.approx(0.0, abs=0.01)
    assert not hold.truth().is_on_ground or hold.truth().height_above_ground_m == pytest.approx(0.0, abs=0.01)


def test_a_peer_that_controls_its_height_flies_on_the_answers_alone() -> None:
    bridge, _ = make()
    peer = JsonPeer()
    exchange(bridge, peer)
    for _ in range(5 * RATE_HZ):
        error_m, climb_m_s = -peer.state["position"][2] - 2.0, -peer.state["velocity"][2]
        pulse = round(HOVER_US - 150.0 * error_m - 120.0 * climb_m_s)
        assert exchange(bridge, peer, *[max(1000, min(2000, pulse))] * 4)
    assert -peer.state["position"][2] == pytest.approx(2.0, abs=0.25)


def test_the_same_pulses_give_the_same_answers() -> None:
    def run() -> list[bytes]:
        bridge, _ = make(seed=5)
        peer = JsonPeer()
        answers = []
        for count in range(400):
            answer = bridge.receive(peer.servos(*[1500 + count % 7] * 4), HERE)
            assert answer is not None
            peer.take(answer)
            answers.append(answer)
        return answers

    assert run() == run()
