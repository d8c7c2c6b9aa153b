"""Logs of autopilots for tests: ULog, which pyulog writes anew, and DataFlash, in the forms that their projects document."""

import struct
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pyulog import ULog

Floats = NDArray[np.float64]
NAMES: Final = ("x", "y", "z", "vx", "vy", "vz")


def write_ulog(file: Path, boot_s: Floats, position_ned_m: Floats, velocity_ned_m_s: Floats) -> None:
    """A log of `vehicle_local_position` and `battery_status`, read and written by pyulog."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), kind[0]) + body

    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", round(boot_s[0] * 1e6))
    data += message(b"B", bytes(40))
    data += message(
        b"F", b"vehicle_local_position:uint64_t timestamp;" + b"".join(b"float %b;" % n.encode() for n in NAMES)
    )
    data += message(b"F", b"battery_status:uint64_t timestamp;float voltage_v;")
    data += message(b"A", struct.pack("<BH", 0, 0) + b"vehicle_local_position")
    data += message(b"A", struct.pack("<BH", 0, 1) + b"battery_status")
    for t_s, position, velocity in zip(boot_s, position_ned_m, velocity_ned_m_s, strict=True):
        data += message(b"D", struct.pack("<HQ6f", 0, round(t_s * 1e6), *position, *velocity))
        data += message(b"D", struct.pack("<HQf", 1, round(t_s * 1e6), 12.0 - 0.01 * t_s))
    draft = file.with_suffix(".draft")
    draft.write_bytes(data)
    ULog(str(draft)).write_ulog(str(file))
    draft.unlink()


def write_dataflash(file: Path, boot_s: Floats, position_ned_m: Floats, velocity_ned_m_s: Floats) -> None:
    """A log of `XKF1` of two cores, of which the second is wrong, and of `BAT`."""

    def described(identifier: int, length: int, name: bytes, form: bytes, columns: bytes) -> bytes:
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", identifier, length, name, form, columns)

    data = described(0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    data += described(10, 3 + 33, b"XKF1", b"QBffffff", b"TimeUS,C,PN,PE,PD,VN,VE,VD")
    data += described(11, 3 + 13, b"BAT", b"QBf", b"TimeUS,Inst,Volt")
    for t_s, position, velocity in zip(boot_s, position_ned_m, velocity_ned_m_s, strict=True):
        now_us = round(t_s * 1e6)
        data += b"\xa3\x95\x0a" + struct.pack("<QB6f", now_us, 0, *position, *velocity)
        data += b"\xa3\x95\x0a" + struct.pack("<QB6f", now_us, 1, *(0.0,) * 6)
        data += b"\xa3\x95\x0b" + struct.pack("<QBf", now_us, 0, 12.0 - 0.01 * t_s)
    file.write_bytes(data)
