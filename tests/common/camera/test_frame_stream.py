"""Camera frames as a byte stream: cut anywhere, put together again; what is no stream of frames is told."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.camera.frame_stream import (
    MAGIC,
    SCAN_MAGIC,
    CameraFrame,
    FrameError,
    FrameReader,
    ScanFrame,
    encode,
    encode_scan,
)
from gloc3.errors import Misuse

FRAMES = [
    CameraFrame(1_500_000, "ground", 4, 3, bytes(range(12))),
    CameraFrame(0, "", 1, 1, MAGIC[:1]),
    CameraFrame(7, "ground", 4, 3, bytes(range(12)), bytes(range(36))),
    CameraFrame(2**60, "front_left", 2, 5, MAGIC + b"123456"),
]

SCAN = ScanFrame(2_000_000, "laser", -1.5, 0.25, 0.125, 30.0, 0.0625, bytes(range(16)))


def test_frames_and_scans_survive_being_cut_at_every_byte() -> None:
    data = encode_scan(SCAN) + b"".join(encode(frame) for frame in FRAMES)
    records = [SCAN, *FRAMES]
    for cut in range(len(data) + 1):
        reader = FrameReader()
        assert reader.receive(data[:cut]) + reader.receive(data[cut:]) == records
    reader = FrameReader()
    assert [frame for at in range(len(data)) for frame in reader.receive(data[at : at + 1])] == records


@pytest.mark.parametrize(
    "frame",
    [
        CameraFrame(0, "ground", 4, 3, b"short"),
        CameraFrame(0, "ground", 0, 3, b""),
        CameraFrame(0, "ground", 2, 1, b"ab", b"abcde"),
        CameraFrame(0, "ground", 70_000, 1, bytes(70_000)),
        CameraFrame(0, "x" * 300, 1, 1, b"1"),
        CameraFrame(-1, "ground", 1, 1, b"1"),
    ],
)
def test_what_is_no_frame_is_not_sent(frame: CameraFrame) -> None:
    with pytest.raises(Misuse):
        encode(frame)


@settings(max_examples=50)
@given(st.binary(min_size=17, max_size=200))
def test_garbage_is_refused_at_once_and_never_waited_on(data: bytes) -> None:
    if data.startswith((MAGIC, SCAN_MAGIC)):
        return
    with pytest.raises(FrameError):
        FrameReader().receive(data)


def test_a_frame_that_claims_to_be_huge_is_refused() -> None:
    header = bytearray(encode(FRAMES[0])[:17])
    header[12:16] = b"\xff\xff\xff\xff"
    with pytest.raises(FrameError):
        FrameReader().receive(bytes(header))


@pytest.mark.parametrize(
    "scan",
    [
        SCAN._replace(ranges_m=b""),
        SCAN._replace(ranges_m=b"123"),
        SCAN._replace(ranges_m=bytes(4 * 70_000)),
        SCAN._replace(boot_us=-1),
        SCAN._replace(angle_min_rad=float("nan")),
        SCAN._replace(scanner="x" * 300),
    ],
)
def test_what_is_no_scan_is_not_sent(scan: ScanFrame) -> None:
    with pytest.raises(Misuse):
        encode_scan(scan)


def test_a_scan_without_beams_or_directions_is_refused() -> None:
    good = encode_scan(SCAN)
    for at, data in ((12, b"\0\0"), (15, b"\xff\xff\xff\xff")):
        with pytest.raises(FrameError):
            FrameReader().receive(good[:at] + data + good[at + len(data) :])
