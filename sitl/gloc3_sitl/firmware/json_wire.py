"""The two packets of ArduPilot's JSON interface: servo outputs in, as bytes, and the state of the physics out, as text."""

import struct
from math import isfinite
from typing import Final, NamedTuple

from gloc3.errors import Misuse
from gloc3.messages.frames import Quaternion, Vector3

MAGIC_16: Final = 18458
"""Begins a packet of 16 channels."""
MAGIC_32: Final = 29569
"""Begins a packet of 32 channels."""

_HEADER: Final = struct.Struct("<HHI")
_CHANNELS: Final = {MAGIC_16: struct.Struct("<16H"), MAGIC_32: struct.Struct("<32H")}


class Servos(NamedTuple):
    """Outputs that the firmware wants."""

    rate_hz: int
    """Steps a second that it would like."""
    frame: int
    """Counts the states that it has accepted since it started."""
    pwm_us: tuple[int, ...]
    """Length of the pulses of outputs 1 to 16, or 32; 0 where there is none."""


class JsonState(NamedTuple):
    """State of the vehicle after a step."""

    t_s: float
    """Time of the physics, from 0."""
    rate_frd_rad_s: Vector3
    specific_force_frd_m_s2: Vector3
    position_ned_m: Vector3
    """From the home."""
    ned_from_frd: Quaternion
    velocity_ned_m_s: Vector3
    range_m: float | None = None
    """Reading of the downward range finder; None before the first one."""


def read_servos(data: bytes) -> Servos | None:
    """Reads a servo packet; None if it is none."""
    if len(data) < _HEADER.size:
        return None
    magic, rate_hz, frame = _HEADER.unpack_from(data)
    channels = _CHANNELS.get(magic)
    if channels is None or len(data) != _HEADER.size + channels.size:
        return None
    return Servos(rate_hz, frame, channels.unpack_from(data, _HEADER.size))


def state_text(state: JsonState) -> bytes:
    """State as one line, with a line feed before and after it as the firmware's scanner requires.

    There is no space after a colon, and no key is part of an earlier key.

    Raises:
        Misuse: a value is not a number, which would end the firmware.
    """
    t_s, (p, q, r), (fx, fy, fz), (n, e, d), (w, x, y, z), (vn, ve, vd), range_m = state
    if not isfinite(t_s + p + q + r + fx + fy + fz + n + e + d + w + x + y + z + vn + ve + vd + (range_m or 0.0)):
        raise Misuse(f"the physics state contains a value that is not finite: {state}")
    text = (
        f'\n{{"timestamp":{t_s:.6f},'
        f'"imu":{{"gyro":[{p:.7f},{q:.7f},{r:.7f}],"accel_body":[{fx:.6f},{fy:.6f},{fz:.6f}]}},'
        f'"position":[{n:.6f},{e:.6f},{d:.6f}],'
        f'"quaternion":[{w:.8f},{x:.8f},{y:.8f},{z:.8f}],'
        f'"velocity":[{vn:.6f},{ve:.6f},{vd:.6f}]'
    )
    if range_m is not None:
        text += f',"rng_1":{range_m:.4f}'
    return (text + "}\n").encode("ascii")
