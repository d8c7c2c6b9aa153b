"""Estimators of others: what they send by UDP, MAVLink and Zenoh, what is damaged, and what the odometry makes of it."""

import json
import socket
import threading
from collections.abc import Callable, Sequence
from math import cos, nan, pi, radians, sin
from time import monotonic
from typing import Any

import numpy as np
import pytest
import zenoh

from gloc3.component.deployment import ComponentRow
from gloc3.component.test_bench import Bench
from gloc3.errors import Gloc3Error, Refused
from gloc3.mavlink import codec
from gloc3.messages.frames import from_yaw, rotate, to_euler, yaw_of
from gloc3.messages.perception import EstimatorPose, Odometry
from gloc3_onboard.components.processors.external_odometry import ExternalOdometryProcessor
from gloc3_onboard.components.samplers.estimator import EstimatorSampler
from gloc3_onboard.sensors.devices import Bell, StampedEstimatorPose
from gloc3_onboard.sensors.registry import SourceHost, make_sources, parse_source
from gloc3_onboard.sensors.sources.estimator import EstimatorSource
from gloc3_onboard.sensors.sources.estimator_wire import JsonDecoder, OdometryDecoder
from gloc3_sitl.demo.demo import free_ports

UPPER = [float(number) for number in range(1, 22)]


def line(**changes: Any) -> bytes:
    """A line, with some fields otherwise; None leaves one out."""
    fields = {"t_s": 12.5, "position_m": [1.0, 2.0, 3.0], "attitude_wxyz": [1.0, 0.0, 0.0, 0.0], **changes}
    return json.dumps({name: value for name, value in fields.items() if value is not None}).encode()


def yawed(degrees: float) -> list[float]:
    half = degrees * pi / 360.0
    return [cos(half), 0.0, 0.0, sin(half)]


def test_axes_that_point_up_are_turned_and_those_that_point_down_are_not() -> None:
    (up,) = JsonDecoder().receive(line(attitude_wxyz=yawed(90.0), covariance=UPPER))
    assert up.stamp_s == 12.5
    assert up.pose.position_m == (1.0, -2.0, -3.0)
    assert to_euler(up.pose.world_from_body)[2] == pytest.approx(-pi / 2)  # to the left is a negative heading
    whole = np.array(up.pose.covariance).reshape(6, 6)
    assert (whole == whole.T).all()
    assert (whole[0, 1], whole[1, 2], whole[0, 3], whole[4, 5]) == (-2.0, 8.0, 4.0, 20.0)
    (down,) = JsonDecoder().receive(line(axes="frd", attitude_wxyz=yawed(90.0)))
    assert down.pose.position_m == (1.0, 2.0, 3.0)
    assert to_euler(down.pose.world_from_body)[2] == pytest.approx(pi / 2)
    assert (down.pose.covariance, down.pose.is_valid, down.pose.reset_counter) == ([], True, 0)


@pytest.mark.parametrize(
    "wrong",
    [
        b"\x00\xff\xfe",
        b"[" * 30_000,
        b"{}",
        line(position_m=[1.0, 2.0]),
        line(position_m=[1.0, 2.0, "x"]),
        line(position_m=[1.0, 2.0, 1e300]),
        line(attitude_wxyz=[0.0, 0.0, 0.0, 0.0]),
        line(attitude_wxyz=[1.0, 1.0, 0.0, 0.0]),
        line(covariance=[1.0] * 7),
        line(covariance=[1.0] * 100_000),
        line(covariance=[-1.0] + [0.0] * 35),
        line(axes="enu"),
        line(reset_counter="x"),
        line(reset_counter=2**64),
        line().replace(b"12.5", b"1e999"),
        line(t_s=1e308),
        line(t_s=-1e11),
    ],
    ids=lambda wrong: wrong.decode("latin1")[:40],
)
def test_a_damaged_line_is_counted_and_the_next_one_is_read(wrong: bytes) -> None:
    decoder = JsonDecoder()
    assert len(decoder.receive(wrong + b"\n" + line())) == 1
    assert decoder.damaged == 1


def odometry(**changes: Any) -> bytes:
    """ODOMETRY as a companion's estimator sends it."""
    fields = {
        "time_usec": 7_000_000,
        "frame_id": 21,
        "child_frame_id": 8,
        "x": 1.0,
        "y": 2.0,
        "z": 3.0,
        "q": (1.0, 0.0, 0.0, 0.0),
        **dict.fromkeys(("vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed"), 0.0),
        "pose_covariance": (nan, *[0.0] * 20),
        "velocity_covariance": (nan, *[0.0] * 20),
        "reset_counter": 3,
        "estimator_type": 2,
        "quality": 80,
    }
    return codec.Encoder(1, 197).encode(codec.message("ODOMETRY", **(fields | changes)))


def test_mavlinks_odometry_is_read_in_each_of_its_frames() -> None:
    (up,) = OdometryDecoder().receive(odometry())
    assert (up.stamp_s, up.pose.position_m) == (7.0, (1.0, -2.0, -3.0))
    assert not up.pose.covariance
    assert up.pose.quality == pytest.approx(0.8)
    assert up.pose.reset_counter == 3
    for frame in (1, 20):
        (down,) = OdometryDecoder().receive(odometry(frame_id=frame, pose_covariance=UPPER, quality=0))
        assert (down.pose.position_m, down.pose.covariance[7], down.pose.quality) == ((1.0, 2.0, 3.0), 7.0, 1.0)
    (lost,) = OdometryDecoder().receive(odometry(quality=-1))
    assert (lost.pose.is_valid, lost.pose.reason) == (False, "the estimator has lost its way")
    decoder = OdometryDecoder()
    assert (
        decoder.receive(odometry(frame_id=12)) == decoder.receive(odometry(x=nan)) == decoder.receive(b"x" * 99) == []
    )
    assert decoder.damaged == 3


def source(url: str) -> EstimatorSource:
    return EstimatorSource("estimator", parse_source("estimator", url), monotonic)


def first(device: EstimatorSource, send: Callable[[], None]) -> StampedEstimatorPose:
    """The first pose that comes while `send` is called again and again."""
    received = threading.Event()
    unwatch = device.on_new_data(received.set)
    device.open()
    try:
        for _ in range(100):
            send()
            if received.wait(0.1):
                break
        stamped = device.estimated_pose()
    finally:
        device.close()
        unwatch()
    assert stamped is not None
    return stamped


@pytest.mark.sockets
@pytest.mark.parametrize(("scheme", "sent"), [("json", line()), ("odometry", odometry())])
def test_a_pose_comes_over_udp_and_its_time_is_made_ours(scheme: str, sent: bytes) -> None:
    port = free_ports(1, socket.SOCK_DGRAM)[0]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

        def send() -> None:
            sender.sendto(sent, ("127.0.0.1", port))

        stamped = first(source(f"{scheme}://127.0.0.1:{port}?delay_s=0.02"), send)
    assert stamped.pose.position_m == (1.0, -2.0, -3.0)
    assert 0.015 < monotonic() - stamped.t_s < 20.0


def test_what_sends_something_else_is_named() -> None:
    port = free_ports(1, socket.SOCK_DGRAM)[0]
    device = source(f"json://127.0.0.1:{port}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender, device.connect() as stream:
        for _ in range(60):
            sender.sendto(b"$GPGGA", ("127.0.0.1", port))
        with pytest.raises(Gloc3Error, match=f"estimator: what comes on json://127.0.0.1:{port} is none of its poses"):
            for _ in zip(range(60), stream, strict=False):
                pass


@pytest.mark.sockets
def test_a_pose_comes_over_zenoh() -> None:
    port = free_ports(1, socket.SOCK_DGRAM)[0]
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["tcp/127.0.0.1:{port}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        device = source(f"zenoh://openvins/odometry?connect=tcp/127.0.0.1:{port}")
        stamped = first(device, lambda: session.put("openvins/odometry", line()))
    assert stamped.pose.position_m == (1.0, -2.0, -3.0)


def test_what_cannot_be_a_source_of_poses_is_refused_or_lost_with_its_reason() -> None:
    with pytest.raises(Refused, match="add \\?connect=ENDPOINT"):
        make_sources({"estimator": "zenoh://openvins/odometry"}, SourceHost(None, None, lambda _: None))  # type: ignore[arg-type]
    port = free_ports(1, socket.SOCK_DGRAM)[0]
    with pytest.raises(Gloc3Error, match=f"estimator: tcp/127.0.0.1:{port} is not reached"):
        source(f"zenoh://a/b?connect=tcp/127.0.0.1:{port}").open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", port))
        with pytest.raises(Gloc3Error, match=f"127.0.0.1:{port} cannot be listened on: Address already in use"):
            source(f"json://127.0.0.1:{port}").open()


class Device:
    """An estimator as the test sets it."""

    def __init__(self) -> None:
        self.now: StampedEstimatorPose | None = None
        self.bell = Bell()

    def open(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""

    def on_new_data(self, ready: Callable[[], None]) -> Callable[[], None]:
        return self.bell.listen(ready)

    def estimated_pose(self) -> StampedEstimatorPose | None:
        return self.now


def test_the_sampler_reports_each_pose_once_and_says_when_the_estimator_is_silent() -> None:
    with Bench() as bench:
        device = Device()
        row = ComponentRow(name="estimator", class_name="x:Y", rate_hz=30.0)
        bench.host(row, lambda: EstimatorSampler(device))
        device.now = StampedEstimatorPose(bench.loop.time(), EstimatorPose(position_m=(1.0, 2.0, 3.0), reset_counter=4))
        bench.run(0.4)
        (one,) = bench.all("estimator_pose")
        assert (one.position_m, one.is_valid) == ((1.0, 2.0, 3.0), True)
        bench.run(0.5)
        silent = bench.last("estimator_pose")
        assert (silent.is_valid, silent.reason[:7]) == (False, "no pose")


STEP_S = 0.1


def motions(poses: Sequence[EstimatorPose], **settings: Any) -> list[Odometry]:
    """What the odometry makes of poses, one every tenth of a second."""
    with Bench() as bench:
        row = ComponentRow(
            name="external_odometry", class_name="x:Y", rate_hz=1.0, trigger="estimator_pose", settings=settings
        )
        bench.host(row, ExternalOdometryProcessor)
        for pose in poses:
            bench.send("estimator_pose", pose)
            bench.run(STEP_S)
        return bench.all("odometry")


def ahead(number: int, **fields: Any) -> EstimatorPose:
    """0.2 m a step along the estimator's y axis, with the nose there."""
    return EstimatorPose(position_m=(0.0, 0.2 * number, 0.0), world_from_body=from_yaw(pi / 2), **fields)


def test_motions_are_in_the_axes_of_their_key_and_get_a_new_one_after_a_way() -> None:
    found = motions([ahead(number) for number in range(12)])
    assert [report.is_valid for report in found] == [False] + [True] * 11
    assert found[0].reason == "it begins"
    keys = sorted({report.reference_t_s for report in found[1:]})
    assert len(keys) == 2
    lengths = [report.position_m[0] for report in found[1:]]
    assert lengths == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 0.2, 0.4, 0.6, 0.8, 1.0], abs=1e-9)
    assert all(abs(part) < 1e-9 for report in found for part in report.position_m[1:])
    last = found[6]
    assert last.covariance[0] == pytest.approx(0.01**2 + 0.012**2)
    assert last.covariance[35] == pytest.approx(radians(0.2) ** 2 + radians(0.06) ** 2)


def test_where_the_estimator_is_mounted_is_taken_out() -> None:
    turning = [
        EstimatorPose(position_m=rotate(from_yaw(angle), (0.5, 0.0, 0.0)), world_from_body=from_yaw(angle + pi / 2))
        for angle in (0.0, 0.1, 0.2)
    ]
    found = motions(turning, mount_frd_m=(0.5, 0.0, 0.0), mount_euler_deg=(0.0, 0.0, 90.0))
    assert found[2].position_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert yaw_of(found[2].reference_from_frd) == pytest.approx(0.2)


def test_what_the_estimator_claims_counts_as_far_as_it_grows() -> None:
    claims = [[0.25 + 0.01 * number if at % 7 == 0 else 0.0 for at in range(36)] for number in range(3)]
    found = motions([ahead(number, covariance=claim) for number, claim in enumerate(claims)])
    assert found[2].covariance[0] == pytest.approx(0.01**2 + 0.004**2 + 0.02)


@pytest.mark.parametrize(
    ("pose", "reason"),
    [
        (ahead(3, reset_counter=1), "the estimator has restarted"),
        (ahead(30), "it has jumped by 5.60 m"),
        (EstimatorPose(is_valid=False, reason="the estimator has lost its way"), "the estimator has lost its way"),
    ],
)
def test_a_reset_a_jump_and_a_loss_are_no_motion_and_the_next_pose_is_a_new_key(
    pose: EstimatorPose, reason: str
) -> None:
    after = [pose] * 2 if pose.is_valid else [pose, ahead(3), ahead(4)]
    found = motions([ahead(1), ahead(2), *after])
    assert [report.is_valid for report in found[:3]] == [False, True, False]
    assert found[2].reason == reason
    assert found[-1].is_valid
    assert abs(found[-1].position_m[0]) < 0.3
