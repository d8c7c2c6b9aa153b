"""The conversation with a gimbal: found as a device that nobody manages, or behind the autopilot's gimbal manager."""

from math import degrees, isnan, nan, radians
from typing import Any

import pytest

from gloc3.mavlink.codec import MavlinkMessage, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3.messages.frames import from_euler, to_euler
from gloc3_onboard.payload.gimbal_link import GimbalLink
from gloc3_onboard.payload.pointing import GimbalTarget

OWN, AUTOPILOT, DEVICE = Address(1, 191), Address(1, 1), Address(1, 154)
ACCEPTED, DENIED = 0, 2
LIMITS = {
    "pitch_min": radians(-90.0),
    "pitch_max": radians(30.0),
    "yaw_min": -float("inf"),
    "yaw_max": float("inf"),
}


class Bench:
    """The link with a client, and an autopilot and a gimbal that are played here."""

    def __init__(self) -> None:
        self.client = MavCommandClient(OWN)
        self.gimbal = GimbalLink(OWN, self.client, lambda call: call(), lambda: None)
        self.gimbal.autopilot = AUTOPILOT
        self.gimbal.open()
        self.now_s = 0.0

    def step(self, duration_s: float = 0.1) -> list[MavlinkMessage]:
        self.now_s += duration_s
        self.gimbal.tick(self.now_s)
        self.client.tick(self.now_s)
        return [*self.client.outgoing(), *self.gimbal.outgoing()]

    def hear(self, sender: Address, name: str, **fields: Any) -> None:
        self.gimbal.receive(message(name, **fields), sender, self.now_s)

    def answer(self, command: int, result: int) -> None:
        ack = message("COMMAND_ACK", command=command, result=result, target_system=1, target_component=191)
        self.client.receive(ack, AUTOPILOT, self.now_s)

    def find(self) -> list[MavlinkMessage]:
        """A gimbal on the network of an autopilot that manages none."""
        self.hear(DEVICE, "HEARTBEAT", type=26)
        asked = self.step()
        self.answer(512, DENIED)
        self.hear(DEVICE, "GIMBAL_DEVICE_INFORMATION", cap_flags=2046, **LIMITS)
        return asked

    def sent(self, target: GimbalTarget) -> list[MavlinkMessage]:
        self.gimbal.point(target)
        return self.step()


def attitude(bench: Bench, sender: Address, flags: int, yaw_deg: float, device: int = 0) -> None:
    q = from_euler(0.0, radians(-30.0), radians(yaw_deg))
    bench.hear(sender, "GIMBAL_DEVICE_ATTITUDE_STATUS", q=q, flags=flags, gimbal_device_id=device)


def test_a_gimbal_that_nobody_manages_is_asked_and_sent_targets() -> None:
    bench = Bench()
    asked = bench.find()
    wanted = {(one.target_component, one.command, one.param1) for one in asked if one.name == "COMMAND_LONG"}
    assert wanted == {(154, 512, 283.0), (154, 511, 285.0), (1, 512, 280.0)}
    about = bench.gimbal.properties()
    assert about is not None
    assert (about.device, about.manager) == (154, 0)
    assert [round(degrees(limit)) for limit in (*about.pitch_limits_rad, *about.yaw_limits_rad)] == [-90, 30, -180, 180]
    (follow,) = bench.sent(GimbalTarget(radians(-20.0), radians(40.0)))
    assert (follow.name, follow.target_component, follow.flags) == ("GIMBAL_DEVICE_SET_ATTITUDE", 154, 4 | 8 | 32)
    assert [degrees(angle) for angle in to_euler(tuple(follow.q))] == pytest.approx([0.0, -20.0, 40.0])
    (north,) = bench.sent(GimbalTarget(0.0, 1.0, is_from_north=True))
    assert north.flags == 4 | 8 | 16 | 64
    (rate,) = bench.sent(GimbalTarget(0.1, -0.2, is_rate=True))
    assert all(map(isnan, rate.q))
    assert (rate.angular_velocity_y, rate.angular_velocity_z) == (0.1, -0.2)
    (neutral,) = bench.sent(GimbalTarget(is_neutral=True))
    assert neutral.flags & 2


@pytest.mark.parametrize(
    ("flags", "is_from_north"), [(4 | 8, False), (32, False), (16, True), (64, True), (16 | 32, False)]
)
def test_the_flags_say_what_the_yaw_is_measured_from(flags: int, is_from_north: bool) -> None:
    bench = Bench()
    bench.find()
    attitude(bench, DEVICE, flags, 50.0)
    found = bench.gimbal.attitude()
    assert found is not None
    assert found.is_from_north is is_from_north
    assert (degrees(found.pitch_rad), degrees(found.yaw_rad)) == pytest.approx((-30.0, 50.0))


def test_nothing_is_sent_without_a_driver_and_a_message_without_numbers_is_ignored() -> None:
    bench = Bench()
    closed = GimbalLink(OWN, bench.client, lambda call: call(), lambda: None)
    closed.autopilot = AUTOPILOT
    closed.receive(message("HEARTBEAT", type=26), DEVICE, 0.0)
    closed.tick(10.0)
    assert (closed.outgoing(), bench.client.outgoing()) == ([], [])
    bench.find()
    bench.hear(DEVICE, "GIMBAL_DEVICE_ATTITUDE_STATUS", q=(nan,) * 4, flags=0)
    assert bench.gimbal.attitude() is None


def test_a_gimbal_of_the_autopilots_manager_is_commanded_through_it_and_its_owner_is_known() -> None:
    bench = Bench()
    bench.hear(DEVICE, "HEARTBEAT", type=26)
    bench.step()
    bench.hear(DEVICE, "GIMBAL_DEVICE_INFORMATION", cap_flags=2046, **LIMITS)
    assert bench.gimbal.properties() is None, "the autopilot has not said yet whether it manages it"
    bench.answer(512, ACCEPTED)
    bench.hear(AUTOPILOT, "GIMBAL_MANAGER_INFORMATION", gimbal_device_id=154, cap_flags=2046, **LIMITS)
    about = bench.gimbal.properties()
    assert about is not None
    assert (about.device, about.manager) == (154, 1)
    bench.hear(AUTOPILOT, "GIMBAL_MANAGER_STATUS", gimbal_device_id=154)
    bench.step()
    configure, target = bench.sent(GimbalTarget(radians(-20.0), 0.0))
    assert (configure.command, configure.param1, configure.param2, configure.param7) == (1001, 1.0, 191.0, 154.0)
    assert (target.name, target.target_component, target.gimbal_device_id) == ("GIMBAL_MANAGER_SET_ATTITUDE", 1, 154)
    bench.answer(1001, ACCEPTED)
    own = {"primary_control_sysid": 1, "primary_control_compid": 191}
    bench.hear(AUTOPILOT, "GIMBAL_MANAGER_STATUS", gimbal_device_id=154, **own)
    bench.step(3.0)
    assert [one.name for one in bench.sent(GimbalTarget())] == ["GIMBAL_MANAGER_SET_ATTITUDE"]
    assert bench.gimbal.other_owner() == ""
    theirs = {"primary_control_sysid": 255, "primary_control_compid": 190}
    bench.hear(AUTOPILOT, "GIMBAL_MANAGER_STATUS", gimbal_device_id=154, **theirs)
    assert bench.gimbal.other_owner() == "255/190"
    attitude(bench, DEVICE, 32, 10.0)
    assert bench.gimbal.attitude() is not None


def test_a_servo_gimbal_without_a_component_has_the_number_of_its_manager() -> None:
    bench = Bench()
    bench.step()
    bench.hear(AUTOPILOT, "GIMBAL_MANAGER_INFORMATION", gimbal_device_id=1, cap_flags=0, **LIMITS)
    attitude(bench, AUTOPILOT, 32, 10.0, device=1)
    assert bench.gimbal.attitude() is not None
    (target,) = [one for one in bench.sent(GimbalTarget()) if one.name == "GIMBAL_MANAGER_SET_ATTITUDE"]
    assert target.gimbal_device_id == 1


def test_an_autopilot_that_shows_itself_as_manager_later_gets_the_gimbal() -> None:
    bench = Bench()
    bench.find()
    assert bench.gimbal.properties() is not None
    bench.hear(AUTOPILOT, "GIMBAL_MANAGER_STATUS", gimbal_device_id=154)
    assert bench.gimbal.properties() is None
    asked = [one.param1 for one in bench.step(2.1) if one.target_component == 1]
    assert asked == [280.0]
    bench.hear(AUTOPILOT, "GIMBAL_MANAGER_INFORMATION", gimbal_device_id=154, cap_flags=2046, **LIMITS)
    found = bench.gimbal.properties()
    assert found is not None
    assert found.manager == 1
