"""Readings of an autopilot in words: satellites, estimator, vibration, radio, battery, flight time, distance home.

Each is what the last message said, with the time when it came; what was never received is missing.
"""

from collections.abc import Callable, Iterator, Mapping
from math import hypot, isfinite
from typing import Final

import msgspec

from gloc3.mavlink import codec
from gloc3.mavlink.flight_modes import PX4
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.frames import GeoPoint, TangentPlane

STALE_S: Final = 10.0
"""Age from which a reading counts as stale, s: several periods of its message."""
VIBRATION_HIGH_M_S2, VIBRATION_TOO_HIGH_M_S2 = 30.0, 60.0
"""ArduPilot's bounds."""
RATIO_HIGH, RATIO_TOO_HIGH = 0.5, 1.0
"""Of an estimator's variances and test ratios; from 1 a measurement is rejected."""
SIK: Final = Address(51, 68)
"""Sender of RADIO_STATUS of radios with SiK firmware, which count in steps of 1/1.9 dB from -127 dBm."""
_FIX: Final = {
    0: "no GPS",
    1: "no fix",
    2: "2D fix",
    3: "3D fix",
    4: "DGPS",
    5: "RTK float",
    6: "RTK fixed",
    7: "static",
}
"""GPS_FIX_TYPE."""
_UNKNOWN_16, _UNKNOWN_8 = 65_535, 255


class Reading(msgspec.Struct, frozen=True):
    """One reading."""

    text: str
    received_s: float
    """On the station's clock."""
    level: int = 0
    """0 normal, 1 a warning, 2 bad."""

    def is_stale(self, now_s: float) -> bool:
        """Whether it is too old to count as current."""
        return now_s - self.received_s >= STALE_S


def gps(message: MavlinkMessage) -> tuple[str, int]:
    """`RTK fixed 22 sat HDOP 0.5`."""
    fix = _FIX.get(message.fix_type, f"fix {message.fix_type}")
    satellites = f" {message.satellites_visible} sat" if message.satellites_visible != _UNKNOWN_8 else ""
    hdop = f" HDOP {message.eph / 100.0:.1f}" if message.eph != _UNKNOWN_16 else ""
    return f"{fix}{satellites}{hdop}", 0 if message.fix_type >= 3 else 2 if message.fix_type < 2 else 1


def estimator(message: MavlinkMessage) -> tuple[str, int] | None:
    """`hgt 0.10 pos 0.05 vel 0.03 mag 0.02`, the worst first: PX4's test ratios, ArduPilot's variances; from 1 it rejects."""
    names = ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio")
    if message.name == "EKF_STATUS_REPORT":
        names = ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance")
    found = [
        (word, value)
        for word, name in zip(("vel", "pos", "hgt", "mag"), names, strict=True)
        if isfinite(value := getattr(message, name))
    ]
    if not found:
        return None
    found.sort(key=lambda one: -one[1])
    worst = found[0][1]
    level = 2 if worst >= RATIO_TOO_HIGH else 1 if worst >= RATIO_HIGH else 0
    return " ".join(f"{word} {value:.2f}" for word, value in found), level


def vibration(message: MavlinkMessage, *, is_px4: bool) -> tuple[str, int]:
    """`4 5 9 m/s²`, of PX4 `accel 0.8 m/s²`, and how often an accelerometer was at its limit."""
    axes = (message.vibration_z,) if is_px4 else (message.vibration_x, message.vibration_y, message.vibration_z)
    clipped = message.clipping_0 + message.clipping_1 + message.clipping_2
    text = f"accel {axes[0]:.1f} m/s²" if is_px4 else f"{' '.join(f'{axis:.0f}' for axis in axes)} m/s²"
    worst = max(axes)
    level = 2 if worst >= VIBRATION_TOO_HIGH_M_S2 else 1 if worst >= VIBRATION_HIGH_M_S2 or clipped else 0
    return text + (f", clipped {clipped}" if clipped else ""), level


def rc(message: MavlinkMessage, *, is_px4: bool) -> tuple[str, int] | None:
    """`82 %`, or that it is received where its strength is not known; None without a transmitter."""
    if not message.chancount:
        return None
    if message.rssi == _UNKNOWN_8:
        return "received", 0
    percent = min(100, message.rssi) if is_px4 else round(100.0 * message.rssi / 254.0)
    return f"RSSI {percent} %", 2 if percent == 0 else 1 if percent < 30 else 0


def radio(message: MavlinkMessage, sender: Address) -> tuple[str, int] | None:
    """`-62 dBm here, -58 dBm there`, or in the radio's own units."""
    parts = [
        f"{round(value / 1.9 - 127.0)} dBm {where}" if sender == SIK else f"RSSI {value} {where}"
        for value, where in ((message.rssi, "here"), (message.remrssi, "there"))
        if value != _UNKNOWN_8
    ]
    return (", ".join(parts), 0) if parts else None


def power(message: MavlinkMessage) -> tuple[str, int] | None:
    """`15.8 V 12.1 A`: of each what is known; of BATTERY_STATUS or SYS_STATUS."""
    cells = [message.voltage_battery] if message.name == "SYS_STATUS" else [*message.voltages, *message.voltages_ext]
    volts = sum(cell for cell in cells if cell != _UNKNOWN_16) / 1e3
    parts = [f"{volts:.1f} V"] if volts else []
    if message.current_battery >= 0:
        parts.append(f"{message.current_battery / 100.0:.1f} A")
    return (" ".join(parts), 0) if parts else None


def charge(message: MavlinkMessage) -> tuple[str, int] | None:
    """`830 mAh used`; None where it is not counted."""
    return (f"{message.current_consumed} mAh used", 0) if message.current_consumed >= 0 else None


_WORDS: Final[Mapping[str, tuple[str, Callable[[MavlinkMessage, bool], tuple[str, int] | None]]]] = {
    "GPS_RAW_INT": ("gps", lambda message, _: gps(message)),
    "ESTIMATOR_STATUS": ("estimator", lambda message, _: estimator(message)),
    "EKF_STATUS_REPORT": ("estimator", lambda message, _: estimator(message)),
    "VIBRATION": ("vibration", lambda message, is_px4: vibration(message, is_px4=is_px4)),
    "RC_CHANNELS": ("rc", lambda message, is_px4: rc(message, is_px4=is_px4)),
    "BATTERY_STATUS": ("charge", lambda message, _: charge(message)),
}
MESSAGES: Final = (*_WORDS, "HOME_POSITION")
"""Messages from which readings are made; SYS_STATUS and GLOBAL_POSITION_INT are followed besides."""
WANTED_HZ: Final[Mapping[str, float]] = {
    "GPS_RAW_INT": 0.5,
    "ESTIMATOR_STATUS": 0.2,
    "EKF_STATUS_REPORT": 0.2,
    "VIBRATION": 0.2,
    "RC_CHANNELS": 0.5,
    "BATTERY_STATUS": 0.5,
    "HOME_POSITION": 0.2,
}
"""Rates at which the station requests those that do not come, Hz: together some 130 byte/s."""
RADIO_STATUS: Final = codec.shape("RADIO_STATUS").id


class FlightClock:
    """Time in the air: from take-off, or arming where the autopilot does not say that it flies, to landing."""

    def __init__(self) -> None:
        self._since_s: float | None = None
        self._is_partial = False
        """It was in the air when it was first received."""
        self._seconds: float | None = None
        self._is_known = False

    def update(self, *, is_flying: bool, now_s: float) -> None:
        """Takes in whether it flies now."""
        if is_flying:
            if self._since_s is None:
                self._since_s, self._is_partial = now_s, not self._is_known
            self._seconds = now_s - self._since_s
        else:
            self._since_s = None
        self._is_known = True

    def words(self, duration: Callable[[float], str]) -> str:
        """`3 min 05 s`; `over` that where its start was not received, and `last` of a flight that has ended."""
        if self._seconds is None:
            return ""
        over = "over " if self._is_partial else ""
        return f"{over}{duration(self._seconds)}" + ("" if self._since_s is not None else " (last)")


class ReadingsWatch:
    """The last readings of one autopilot."""

    def __init__(self) -> None:
        self._found: dict[str, Reading] = {}
        self._received: set[str] = set()
        self.home_geo: tuple[float, float, float] | None = None
        """Home: latitude and longitude in degrees, altitude above the sea in m; None until it was received."""
        self._battery_s = float("-inf")
        """When the first battery was reported last."""

    @property
    def all(self) -> Mapping[str, Reading]:
        """By name: `gps`, `estimator`, `vibration`, `rc`, `power`, `charge`, `home`; what was never received is missing."""
        return {**self._found}

    def missing(self, autopilot: int) -> Iterator[str]:
        """Messages that have not come, of those that this make of autopilot sends."""
        foreign = "EKF_STATUS_REPORT" if autopilot == PX4 else "ESTIMATOR_STATUS"
        return (name for name in MESSAGES if name not in self._received and name != foreign)

    def receive(self, message: MavlinkMessage, autopilot: int, now_s: float) -> None:
        """Handles a message of the autopilot."""
        self._received.add(message.name)
        if message.name in _WORDS:
            name, words = _WORDS[message.name]
            if message.name == "BATTERY_STATUS":
                if message.id_ != 0:  # of several batteries, the first
                    return
                self._put("power", power(message), now_s)
                self._battery_s = now_s
            self._put(name, words(message, autopilot == PX4), now_s)
        elif message.name == "SYS_STATUS" and now_s - self._battery_s >= STALE_S:
            self._put("power", power(message), now_s)
        elif message.name == "HOME_POSITION":
            self.home_geo = message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3
        elif (
            message.name == "GLOBAL_POSITION_INT" and self.home_geo is not None and (message.lat, message.lon) != (0, 0)
        ):
            self._put("home", (f"{_distance_m(self.home_geo, message):.0f} m", 0), now_s)

    def _put(self, name: str, said: tuple[str, int] | None, now_s: float) -> None:
        if said is None:
            self._found.pop(name, None)
        else:
            self._found[name] = Reading(said[0], now_s, said[1])


def _distance_m(home: tuple[float, float, float], place: MavlinkMessage) -> float:
    """Horizontal distance, on the plane about home."""
    north_m, east_m, _ = TangentPlane(GeoPoint(*home)).ned_from_geo(place.lat / 1e7, place.lon / 1e7, home[2])
    return hypot(north_m, east_m)
