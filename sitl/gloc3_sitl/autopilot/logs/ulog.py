"""ULog, PX4's log format (docs.px4.io, ULog File Format), with the topics and fields of PX4 that have a counterpart here."""

import struct
from collections.abc import Iterator, Mapping
from typing import Final

from gloc3.messages.frames import to_euler
from gloc3_sitl.autopilot.logs.records import LogHeader, LogRecord
from gloc3_sitl.autopilot.modes import NAVIGATION_STATES

MAGIC: Final = b"ULog\x01\x12\x35\x01"
OUTPUTS: Final = 16
_OTHER: Final = 4
_ARMED, _DISARMED = 2, 1
_NOTICE: Final = ord("0") + 5
"""Level of a logged text, as syslog counts."""
_TOPICS: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "vehicle_local_position": (
        ("uint64_t", "timestamp"),
        *(("float", name) for name in ("x", "y", "z", "vx", "vy", "vz", "heading")),
        *(("bool", name) for name in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")),
    ),
    "vehicle_attitude": (("uint64_t", "timestamp"), ("float[4]", "q")),
    "vehicle_status": (
        ("uint64_t", "timestamp"),
        *(("uint8_t", name) for name in ("arming_state", "nav_state")),
        ("bool", "failsafe"),
    ),
    "vehicle_land_detected": (("uint64_t", "timestamp"), ("bool", "landed")),
    "battery_status": (("uint64_t", "timestamp"), ("float", "remaining")),
    "actuator_outputs": (("uint64_t", "timestamp"), ("uint32_t", "noutputs"), (f"float[{OUTPUTS}]", "output")),
}
_PACKED: Final = {"uint64_t": "Q", "uint32_t": "I", "float": "f", "uint8_t": "B", "bool": "?"}


def _layout(fields: tuple[tuple[str, str], ...]) -> struct.Struct:
    kinds = (kind.rstrip("]").partition("[") for kind, _ in fields)
    return struct.Struct("<" + "".join(f"{count}{_PACKED[kind]}" for kind, _, count in kinds))


_LAYOUTS: Final = {topic: _layout(fields) for topic, fields in _TOPICS.items()}


class UlogFormat:
    """Writes the messages one after the other; fields stand in an order that needs no padding."""

    suffix = ".ulg"

    def __init__(self) -> None:
        self._header: LogHeader | None = None

    def begin(self, header: LogHeader) -> bytes:
        """The file's header, what each topic consists of, and the parameters."""
        self._header = header
        return b"".join(self._begin(header))

    def _begin(self, header: LogHeader) -> Iterator[bytes]:
        yield MAGIC + struct.pack("<Q", _us(header.boot_s))
        yield _message(b"B", bytes(40))
        yield _info("char", "sys_name", b"PX4")
        yield _info("char", "ver_hw", b"GLOC3_SITL")
        major, minor, patch = header.version
        yield _info("uint32_t", "ver_sw_release", struct.pack("<I", major << 24 | minor << 16 | patch << 8 | 0xFF))
        for topic, fields in _TOPICS.items():
            described = "".join(f"{kind} {name};" for kind, name in fields)
            yield _message(b"F", f"{topic}:{described}".encode())
        for name, value in sorted(header.parameters.items()):
            if name in header.whole:
                yield _info("int32_t", name, struct.pack("<i", round(value)), b"P")
            else:
                yield _info("float", name, struct.pack("<f", value), b"P")
        for number, topic in enumerate(_TOPICS):
            yield _message(b"A", struct.pack("<BH", 0, number) + topic.encode())

    def add(self, record: LogRecord) -> bytes:
        """A sample of each topic, and the texts."""
        now_us = _us(record.boot_s)
        _, _, heading = to_euler(record.ned_from_frd)
        pulses = [0] * OUTPUTS if self._header is None else self._header.pulses_us(record.outputs, OUTPUTS)
        samples: tuple[tuple[float, ...], ...] = (
            (*record.position_ned_m, *record.velocity_ned_m_s, heading, True, True, True, True),
            record.ned_from_frd,
            (
                _ARMED if record.is_armed else _DISARMED,
                NAVIGATION_STATES.get(record.mode, _OTHER),
                bool(record.failsafe),
            ),
            (record.is_landed,),
            (record.battery,),
            (sum(pulse > 0 for pulse in pulses), *pulses),
        )
        layouts = zip(_LAYOUTS.values(), samples, strict=True)
        found = [
            _message(b"D", struct.pack("<H", number) + layout.pack(now_us, *sample))
            for number, (layout, sample) in enumerate(layouts)
        ]
        found += [_message(b"L", struct.pack("<BQ", _NOTICE, now_us) + text.encode()) for text in record.texts]
        return b"".join(found)


def _us(boot_s: float) -> int:
    return round(boot_s * 1e6)


def _message(kind: bytes, body: bytes) -> bytes:
    return struct.pack("<H", len(body)) + kind + body


def _info(kind: str, name: str, value: bytes, message: bytes = b"I") -> bytes:
    key = (f"char[{len(value)}] {name}" if kind == "char" else f"{kind} {name}").encode()
    return _message(message, bytes([len(key)]) + key + value)
