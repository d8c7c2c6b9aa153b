"""What a simulated Doppler velocity log says on its line, as the real ones do; no I/O.

Water Linked, "DVL A50/A125 protocols", report *velocity* of format json_v3.1; Teledyne RD Instruments, "Workhorse Commands and
Output Data Format", PD6: velocities of the ship over the bottom in mm/s, and the distance to it.
"""

from collections.abc import Callable, Mapping
from math import cos
from typing import Final

import msgspec

from gloc3.messages.perception import BottomVelocity
from gloc3_sitl.sensors.dvl import BEAM_RAD, RATE_HZ

UNLOCKED_FOM: Final = 2.0
"""Figure of merit that an A50 tells without bottom lock, m/s."""

Encode = Callable[[BottomVelocity, float], bytes]
"""The lines for a velocity, and its time in seconds since the device was switched on."""


def a50_line(bottom: BottomVelocity, t_s: float) -> bytes:
    """One JSON object; stamps are microseconds since the device was switched on, as without a time server."""
    vx, vy, vz = bottom.velocity_frd_m_s
    fom = bottom.std_m_s if bottom.is_valid else UNLOCKED_FOM
    stamp_us, variance = round(t_s * 1e6), fom * fom
    reach_m = bottom.altitude_m / cos(BEAM_RAD)
    beams = [
        {"id": number, "velocity": 0.0, "distance": reach_m if bottom.is_valid else -1.0, "beam_valid": bottom.is_valid}
        for number in range(4)
    ]
    said = {
        "time": 1e3 / RATE_HZ,
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "fom": fom,
        "covariance": [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, variance]],
        "altitude": bottom.altitude_m if bottom.is_valid else -1.0,
        "transducers": beams,
        "velocity_valid": bottom.is_valid,
        "status": 0,
        "format": "json_v3.1",
        "type": "velocity",
        "time_of_validity": stamp_us,
        "time_of_transmission": stamp_us,
    }
    return msgspec.json.encode(said) + b"\r\n"


def pd6_lines(bottom: BottomVelocity, t_s: float) -> bytes:
    """Two lines of text; velocities to starboard, forward and from keel to mast; the ways since the begin stay 0."""
    del t_s
    if not bottom.is_valid:
        return b":BS,-32768,-32768,-32768,V\r\n:BD,+00000,+00000,+00000,0000.00,000.00\r\n"
    ahead, right, down = (round(1e3 * part) for part in bottom.velocity_frd_m_s)
    velocity = f":BS,{right:+06d},{ahead:+06d},{-down:+06d},A"
    return f"{velocity}\r\n:BD,+00000,+00000,+00000,{bottom.altitude_m:07.2f},000.00\r\n".encode()


WIRES: Final[Mapping[str, Encode]] = {"a50": a50_line, "pd6": pd6_lines}
"""By the scheme of the source that reads it."""
