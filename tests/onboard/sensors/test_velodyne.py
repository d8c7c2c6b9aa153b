"""A VLP-16: its packets, turns over a real socket, the sampler, and obstacles from a turn."""

import math
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.onboard.messages import pose
from tests.onboard.stage import Stage

from gloc3.errors import Gloc3Error
from gloc3.messages.perception import PointCloud
from gloc3.messages.vehicle import HeightAboveGround, ObstacleScan
from gloc3_onboard.algorithms.scan_matching.scan_points import cloud_fault
from gloc3_onboard.components.processors.cloud_obstacles import CloudObstacleProcessor, CloudObstacleSettings
from gloc3_onboard.components.samplers.lidar import LidarSampler, LidarSettings
from gloc3_onboard.sensors.devices import StampedCloud
from gloc3_onboard.sensors.lidar_sources.velodyne import BLOCKS, TurnAssembler, packet_of
from gloc3_onboard.sensors.registry import SourceHost, make_sources

Floats = NDArray[np.float64]
BLOCK = bytes.fromhex(
    "ffee6628000002ff020300000310034b000002ac0239000003bc0238000001bd0245be0200c80257a90223c50232c3021dd9024a"
    "0000020f03070000020e0346000004ac023d000003c40241000002ba0238000003c6023eb50226d60239c60218d30232"
)
"""The first block of a packet that a scanner sent (github.com/einride/vlp16-go, testdata/packet.bin; MIT)."""
WITHIN_S = 15.0


def packet(
    first_deg: float, values: bytes, stamp_us: int = 0, kind: bytes = b"\x37\x22", step_deg: float = 0.4
) -> bytes:
    """A packet whose blocks all have the same values."""
    azimuths = (round(100.0 * ((first_deg + step_deg * number) % 360.0)) % 36_000 for number in range(BLOCKS))
    blocks = b"".join(b"\xff\xee" + azimuth.to_bytes(2, "little") + values for azimuth in azimuths)
    return blocks + stamp_us.to_bytes(4, "little") + kind


def room(first_deg: float, stamp_us: int) -> bytes:
    """A packet inside a round room with walls 4 m away on the level, 1 m away on the right (60 to 120 degrees)."""
    away_m = 1.0 if 60.0 <= first_deg % 360.0 <= 115.0 else 4.0
    beams = [elevation for low in range(-15, 0, 2) for elevation in (low, low + 16)]
    units = [round(away_m / math.cos(math.radians(elevation)) / 0.002) for elevation in beams]
    values = b"".join(unit.to_bytes(2, "little") + b"\x09" for unit in units)
    return packet(first_deg, 2 * values, stamp_us)


def turns(count: int) -> Iterator[bytes]:
    """Packets of some turns, 75 in each."""
    for number in range(75 * count):
        yield room(4.8 * number, 1327 * number)


def points(cloud: PointCloud) -> Floats:
    return np.frombuffer(cloud.data, "<f4").reshape(-1, 3).astype(float)


def test_a_scanners_packet_has_the_points_that_another_decoder_finds() -> None:
    """The numbers are of velodyne-decoder 3.0, which reads the same bytes; x forward, y left, z up."""
    assembler = TurnAssembler(0.5, 100.0)
    found = [assembler.add(packet_of(packet(first_deg, BLOCK[4:]))) for first_deg in (300.0, 103.42, 0.0)]
    assert found[:2] == [None, None], "the turn that was under way is not whole"
    assert found[2] is not None
    flu = found[2].points * (1.0, -1.0, -1.0)
    assert len(flu) == 252
    expected = [[-0.3562, -1.4918, 0.026], [-0.3642, -1.5229, 0.0799], [-0.3172, -1.3254, 0.1156]]
    assert flu[:3] == pytest.approx(np.array(expected), abs=2e-4)
    assert flu[-1] == pytest.approx((-0.4351, -1.3272, 0.363), abs=2e-4)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "a datagram of 0 bytes"),
        (packet(0.0, BLOCK[4:], kind=b"\x37\x28"), "product 0x28 in mode 0x37 is no VLP-16"),
        (packet(0.0, BLOCK[4:], kind=b"\x36\x22"), "product 0x22 in mode 0x36 is no VLP-16"),
        (b"\xdd" + packet(0.0, BLOCK[4:])[1:], "damaged"),
        (b"\xff\xee\xff\xff" + packet(0.0, BLOCK[4:])[4:], "damaged"),
    ],
)
def test_what_is_no_packet_is_refused_with_the_reason(data: bytes, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        packet_of(data)


def test_two_returns_of_one_direction_are_both_points() -> None:
    single = packet_of(packet(10.0, BLOCK[4:]))
    raw = packet(10.0, BLOCK[4:], kind=b"\x39\x22")
    pairs = b"".join(raw[100 * (number // 2) : 100 * (number // 2) + 100] for number in range(BLOCKS))
    dual = packet_of(pairs + raw[-6:])
    assert dual.azimuths_rad[1] == pytest.approx(dual.azimuths_rad[0])
    assert dual.azimuths_rad[::2] == pytest.approx(single.azimuths_rad[:6])


def made(url: str) -> Any:
    class Loop:
        def time(self) -> float:
            return time.monotonic()

    return make_sources({"lidar": url}, SourceHost(Loop(), Path(), lambda _: None))["lidar"]  # type: ignore[arg-type]


def received(device: Any, port: int, datagrams: Iterator[bytes]) -> StampedCloud:
    """The cloud of the last turn of some datagrams."""
    device.open()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for datagram in datagrams:
                sender.sendto(datagram, ("127.0.0.1", port))
                time.sleep(1e-4)
        end_s = time.monotonic() + WITHIN_S
        while device.cloud() is None:
            assert time.monotonic() < end_s
            time.sleep(0.01)
        found: StampedCloud = device.cloud()
        return found
    finally:
        device.close()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as each:
        each.bind(("127.0.0.1", 0))
        return int(each.getsockname()[1])


@pytest.mark.sockets
def test_turns_over_udp_are_clouds_on_the_body_and_obstacles_for_the_limiter() -> None:
    port = free_port()
    device = made(f"velodyne://127.0.0.1:{port}?forward_m=0.1&down_m=-0.2&yaw_deg=90&max_m=20")
    stamped = received(device, port, (data for turn in turns(3) for data in (turn, b"damaged")))
    cloud = stamped.cloud
    assert (cloud.sensor, cloud.origin_frd_m, cloud.range_max_m) == ("lidar", (0.1, 0.0, -0.2), 20.0)
    seen = points(cloud) - cloud.origin_frd_m
    assert len(seen) == pytest.approx(75 * 12 * 32, rel=0.05)
    ages_s = np.frombuffer(cloud.ages_s, "<f4")
    assert len(ages_s) == len(seen)
    turned = np.degrees(np.arctan2(seen[:, 1], seen[:, 0])) - 90.0  # since the turn began on the vehicle's right
    assert ages_s == pytest.approx(75 * 1327e-6 * (1.0 - (turned + 1e-4) % 360.0 / 360.0), abs=3e-3)
    level_m = np.hypot(seen[:, 0], seen[:, 1])
    bearings = np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))
    is_behind = np.abs(np.abs(bearings) - 180.0) < 25.0  # the scanner's right is the vehicle's back
    assert level_m[is_behind] == pytest.approx(1.0, abs=0.002)
    assert level_m[np.abs(bearings) < 140.0] == pytest.approx(4.0, abs=0.005)

    stage = Stage(CloudObstacleProcessor(), CloudObstacleSettings())
    stage.step(pose=pose(height=2.0), height=HeightAboveGround(height_m=2.0, is_valid=True), cloud=cloud)
    found = stage.last(ObstacleScan)
    assert found.is_valid, found.reason
    assert found.closest_m == pytest.approx(0.9, abs=0.15)


def test_a_clock_that_is_set_in_a_turn_tells_no_ages() -> None:
    assembler = TurnAssembler(0.5, 100.0)
    found = []
    for number in range(160):
        read = packet_of(room(4.8 * number, 1327 * number))
        found.append(assembler.add(read._replace(stamp_us=read.stamp_us + (9_000_000 if number > 100 else 0))))
    (turn,) = filter(None, found)
    assert len(turn.points) > 75 * 12 * 30
    assert len(turn.ages_s) == 0


@pytest.mark.parametrize(
    ("ages_s", "why"),
    [
        (bytes(4), "4 bytes are not an age of 4 bytes for each of 2 points"),
        (np.array([0.1, np.nan], "<f4").tobytes(), "an age of a point is not from 0 to 1 s"),
        (np.array([-0.1, 0.1], "<f4").tobytes(), "an age of a point is not from 0 to 1 s"),
    ],
)
def test_ages_that_cannot_be_are_refused(ages_s: bytes, why: str) -> None:
    cloud = PointCloud(sensor="lidar", data=bytes(24), ages_s=ages_s)
    assert cloud_fault(cloud) == why
    assert not cloud_fault(PointCloud(sensor="lidar", data=bytes(24), ages_s=bytes(8)))


@pytest.mark.sockets
def test_a_scanner_that_does_not_turn_can_be_closed() -> None:
    port = free_port()
    device = made(f"velodyne://127.0.0.1:{port}")
    device.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        device.close()
        end_s = time.monotonic() + WITHIN_S
        while device.is_reading:
            sender.sendto(room(90.0, 0), ("127.0.0.1", port))
            time.sleep(0.01)
            assert time.monotonic() < end_s


@pytest.mark.sockets
def test_another_sender_is_named() -> None:
    port = free_port()
    device = made(f"velodyne://127.0.0.1:{port}")
    with device.connect() as stream, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for _ in range(60):
            sender.sendto(bytes(500), ("127.0.0.1", port))
        with pytest.raises(Gloc3Error, match="lidar: a datagram of 500 bytes is no packet of 1206"):
            list(stream)


def test_the_sampler_reports_each_turn_once_and_says_when_none_comes() -> None:
    class Device:
        stamped: StampedCloud | None = None

        def open(self) -> None: ...
        def close(self) -> None: ...
        def on_new_data(self, _ready: Any) -> Any:
            return lambda: None

        def cloud(self) -> StampedCloud | None:
            return self.stamped

    device = Device()
    stage = Stage(LidarSampler(device), LidarSettings(silent_s=0.5))
    device.stamped = StampedCloud(stage.now_s, PointCloud(sensor="lidar", data=bytes(24)))
    stage.step()
    assert stage.last(PointCloud).is_valid
    count = len(stage.all(PointCloud))
    stage.step()
    assert len(stage.all(PointCloud)) == count
    device.stamped = StampedCloud(stage.now_s, PointCloud(sensor="lidar", data=bytes(13)))
    stage.step()
    assert stage.last(PointCloud).reason == "13 bytes are not points of 12 bytes"
