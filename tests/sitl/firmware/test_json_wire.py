import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.sitl.firmware.json_peer import JsonPeer

from gloc3.errors import Misuse
from gloc3_sitl.firmware.json_wire import JsonState, Servos, read_servos, state_text

FAR = st.floats(-5e3, 5e3)
NEAR = st.floats(-200.0, 200.0)
UNIT = st.floats(-1.0, 1.0)


@pytest.mark.parametrize(("channels", "magic"), [(16, 18458), (32, 29569)])
def test_a_servo_packet_has_16_or_32_channels(channels: int, magic: int) -> None:
    pulses = tuple(range(1000, 1000 + channels))
    packet = struct.pack(f"<HHI{channels}H", magic, 800, 77, *pulses)
    assert read_servos(packet) == Servos(800, 77, pulses)


@given(st.binary(max_size=80))
def test_what_is_no_servo_packet_is_none(data: bytes) -> None:
    known = len(data) in (40, 72) and data[:2] in (struct.pack("<H", 18458), struct.pack("<H", 29569))
    assert known or read_servos(data) is None


@pytest.mark.parametrize(("magic", "length"), [(18458, 39), (18458, 41), (18458, 72), (29569, 40), (18459, 40)])
def test_a_servo_packet_of_another_length_or_magic_is_none(magic: int, length: int) -> None:
    assert read_servos(struct.pack("<H", magic).ljust(length, b"\x05")) is None


@given(
    st.floats(0.0, 1e5),
    st.tuples(NEAR, NEAR, NEAR),
    st.tuples(NEAR, NEAR, NEAR),
    st.tuples(FAR, FAR, FAR),
    st.tuples(UNIT, UNIT, UNIT, UNIT),
    st.tuples(NEAR, NEAR, NEAR),
    st.none() | st.floats(0.0, 1000.0),
)
def test_the_firmwares_scanner_reads_what_is_written(
    t_s: float,
    rate: tuple[float, float, float],
    force: tuple[float, float, float],
    position: tuple[float, float, float],
    attitude: tuple[float, float, float, float],
    velocity: tuple[float, float, float],
    range_m: float | None,
) -> None:
    peer = JsonPeer()
    assert peer.take(state_text(JsonState(t_s, rate, force, position, attitude, velocity, range_m)))
    read = peer.state
    assert read["timestamp"][0] == pytest.approx(t_s, abs=1e-6)
    assert read["gyro"] == pytest.approx(rate, abs=1e-6)
    assert read["accel_body"] == pytest.approx(force, abs=1e-5)
    assert read["position"] == pytest.approx(position, abs=1e-5)
    assert read["quaternion"] == pytest.approx(attitude, abs=1e-7)
    assert read["velocity"] == pytest.approx(velocity, abs=1e-5)
    assert ("rng_1" in read) == (range_m is not None)


def test_what_is_no_number_never_leaves() -> None:
    zero = (0.0, 0.0, 0.0)
    with pytest.raises(Misuse, match="not finite"):
        state_text(JsonState(1.0, zero, zero, (0.0, float("nan"), 0.0), (1.0, 0.0, 0.0, 0.0), zero))
