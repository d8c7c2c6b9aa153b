"""DataFlash, ArduPilot's log format (ardupilot.org, *Log messages*; AP_Logger's LogStructure.h), with its own names."""

import struct
from collections.abc import Iterator, Mapping
from math import degrees
from typing import Final, NamedTuple

from gloc3.messages.frames import to_euler
from gloc3_sitl.autopilot.logs.records import LogHeader, LogRecord

MAGIC: Final = b"\xa3\x95"
OUTPUTS: Final = 14
_ARMED, _DISARMED, _LANDED, _TOOK_OFF = 10, 11, 18, 28
"""Identifiers of events in `EV`."""
_PACKED: Final = {"B": "B", "H": "H", "Q": "Q", "f": "f", "n": "4s", "N": "16s", "Z": "64s", "M": "B"}


class MessageForm(NamedTuple):
    """A message: its number, the types and the names of its columns."""

    number: int
    types: str
    columns: str

    @property
    def layout(self) -> struct.Struct:
        """Its bytes without the header."""
        return struct.Struct("<" + "".join(_PACKED[kind] for kind in self.types))


FORMS: Final[Mapping[str, MessageForm]] = {
    "FMT": MessageForm(128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "PARM": MessageForm(64, "QNff", "TimeUS,Name,Value,Default"),
    "MSG": MessageForm(65, "QZ", "TimeUS,Message"),
    "MODE": MessageForm(66, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "EV": MessageForm(67, "QB", "TimeUS,Id"),
    "ATT": MessageForm(68, "Qfff", "TimeUS,Roll,Pitch,Yaw"),
    "XKF1": MessageForm(69, "QBfffffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD"),
    "BAT": MessageForm(70, "QBB", "TimeUS,Inst,RemPct"),
    "RCOU": MessageForm(71, "Q" + "H" * OUTPUTS, "TimeUS," + ",".join(f"C{n}" for n in range(1, OUTPUTS + 1))),
}
_LAYOUTS: Final = {name: form.layout for name, form in FORMS.items()}


_FIRMWARE: Final[Mapping[int, str]] = {
    1: "ArduPlane",
    2: "ArduCopter",
    10: "ArduRover",
    11: "ArduRover",
    12: "ArduSub",
    22: "ArduPlane",
}
"""By MAV_TYPE; readers look for it in the first text, for the names of modes."""


class DataflashFormat:
    """Writes messages one after the other; modes and events when they change."""

    suffix = ".BIN"

    def __init__(self) -> None:
        self._header: LogHeader | None = None
        self._mode = -1
        self._is_armed = False
        self._is_landed = True

    def begin(self, header: LogHeader) -> bytes:
        """What each message consists of, the firmware's version, and the parameters."""
        self._header = header
        return b"".join(self._begin(header))

    def _begin(self, header: LogHeader) -> Iterator[bytes]:
        for name, form in FORMS.items():
            length = _LAYOUTS[name].size + 3
            yield _message("FMT", form.number, length, name.encode(), form.types.encode(), form.columns.encode())
        now_us = _us(header.boot_s)
        version = ".".join(map(str, header.version))
        yield _message("MSG", now_us, f"{_FIRMWARE[header.mav_type]} V{version} (GLOC3 SITL)".encode())
        for name, value in sorted(header.parameters.items()):
            yield _message("PARM", now_us, name.encode(), value, value)

    def add(self, record: LogRecord) -> bytes:
        """The messages of a moment."""
        return b"".join(self._add(record))

    def _add(self, record: LogRecord) -> Iterator[bytes]:
        now_us = _us(record.boot_s)
        if record.custom_mode != self._mode:
            self._mode = record.custom_mode
            yield _message("MODE", now_us, record.custom_mode, record.custom_mode, 0)
        if record.is_armed != self._is_armed:
            self._is_armed = record.is_armed
            yield _message("EV", now_us, _ARMED if record.is_armed else _DISARMED)
        if record.is_landed != self._is_landed:
            self._is_landed = record.is_landed
            yield _message("EV", now_us, _LANDED if record.is_landed else _TOOK_OFF)
        roll, pitch, yaw = map(degrees, to_euler(record.ned_from_frd))
        yield _message("ATT", now_us, roll, pitch, yaw % 360.0)
        yield _message("XKF1", now_us, 0, roll, pitch, yaw % 360.0, *record.velocity_ned_m_s, *record.position_ned_m)
        yield _message("BAT", now_us, 0, round(100.0 * record.battery))
        if self._header is not None:
            yield _message("RCOU", now_us, *self._header.pulses_us(record.outputs, OUTPUTS))
        for text in record.texts:
            yield _message("MSG", now_us, text.encode()[:64])


def _us(boot_s: float) -> int:
    return round(boot_s * 1e6)


def _message(name: str, *values: float | bytes) -> bytes:
    return MAGIC + bytes([FORMS[name].number]) + _LAYOUTS[name].pack(*values)
