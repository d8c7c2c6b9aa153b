"""Poses beside a video: KLV sets of MISB ST 0601 in the transport stream, read by PyAV and decoded by the standard's formulas."""

import asyncio

import numpy as np
import pytest
from tests.onboard.video.test_video_streams import UTC_OFFSET_S, nearest, seen_by_opencv, serving

from gloc3.messages.vehicle import Pose
from gloc3_onboard.video.klv import local_set, signed, unsigned

av = pytest.importorskip("av")

pytestmark = [pytest.mark.sockets]


def items(data: bytes) -> dict[int, bytes]:
    """Tags and values of a local set whose items are short."""
    body, found = data[18:] if data[16] == 0x81 else data[17:], dict[int, bytes]()
    while body:
        tag, size = body[0], body[1]
        found[tag], body = body[2 : 2 + size], body[2 + size :]
    return found


def value(data: bytes, least: float, most: float) -> float:
    """A value of an item between two bounds; signed where they are opposite."""
    if least == -most:
        return int.from_bytes(data, "big", signed=True) / ((1 << 8 * len(data) - 1) - 1) * most
    return int.from_bytes(data, "big") / ((1 << 8 * len(data)) - 1) * (most - least) + least


def sets_by_pyav(url: str, count: int) -> list[bytes]:
    """KLV sets of a stream, and as many pictures."""
    found: list[bytes] = []
    pictures = 0
    with av.open(url, options={"rtsp_transport": "tcp"}, timeout=20.0) as container:
        assert {stream.type for stream in container.streams} == {"video", "data"}
        for packet in container.demux():
            if packet.stream.type == "data" and packet.size:
                found.append(bytes(packet))
            elif packet.size:
                pictures += len(packet.decode())
            if len(found) >= count and pictures >= count:
                break
    return found


async def test_the_poses_of_the_pictures_come_in_the_same_transport_stream() -> None:
    async with serving() as scene:
        sets = await asyncio.to_thread(sets_by_pyav, scene.url("ground.ts"), 10)
        frames = await asyncio.to_thread(seen_by_opencv, scene.url("ground.ts"), 5)
    assert max(nearest(frame) for frame in frames) < 6.0
    for data in sets:
        assert data[:16] == bytes.fromhex("060E2B34020B01010E01030101000000")
        words = (byte << 8 if index % 2 == 0 else byte for index, byte in enumerate(data[:-2]))
        assert int.from_bytes(data[-2:], "big") == sum(words) & 0xFFFF
        found = items(data)
        assert value(found[13], -90.0, 90.0) == pytest.approx(39.5528, abs=1e-7)
        assert value(found[14], -180.0, 180.0) == pytest.approx(2.6285, abs=1e-7)
        assert value(found[15], -900.0, 19_000.0) == pytest.approx(22.0, abs=0.2)
        assert value(found[5], 0.0, 360.0) == pytest.approx(160.0, abs=0.01)
        assert value(found[90], -90.0, 90.0) == pytest.approx(-2.0, abs=1e-6)
        assert value(found[91], -90.0, 90.0) == pytest.approx(3.0, abs=1e-6)
        assert value(found[16], 0.0, 180.0) == pytest.approx(90.0, abs=0.01)
        assert value(found[19], -180.0, 180.0) == pytest.approx(-90.0, abs=1e-3)
        assert found[11] == b"ground"
    times = [int.from_bytes(items(data)[2], "big") for data in sets]
    steps = np.diff(times) / 50_000
    assert times[0] >= UTC_OFFSET_S * 1e6
    assert (steps >= 1.0).all()
    assert steps == pytest.approx(np.round(steps)), "times of pictures"


def test_what_is_not_known_is_left_out() -> None:
    pose = Pose(position_ned_m=(0.0, 0.0, 0.0), velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=(1.0, 0.0, 0.0, 0.0))
    assert set(items(local_set(1, pose, "c", None, is_fixed=False))) == {1, 2, 5, 11, 65, 90, 91}


@pytest.mark.parametrize(
    ("made", "published"),
    [
        (signed(60.1768229669783, 90.0, 4), "5595B66D"),
        (signed(128.426759042045, 180.0, 4), "5B5360C4"),
        (unsigned(14190.7195, -900.0, 19000.0, 2), "C221"),
        (unsigned(159.974365, 0.0, 360.0, 2), "71C2"),
        (unsigned(144.571298, 0.0, 180.0, 2), "CD9C"),
        (unsigned(160.719211474396, 0.0, 360.0, 4), "724A0A20"),
        (signed(-168.792324833941, 180.0, 4), "87F84B86"),
    ],
)
def test_numbers_are_those_of_the_standards_examples(made: bytes, published: str) -> None:
    assert made.hex().upper() == published
