"""Sensors wired to an autopilot and received over MAVLink: inertial unit, ranges, scans, wheels, satellites.

MAVLink, common: HIGHRES_IMU, SCALED_IMU, RAW_IMU, DISTANCE_SENSOR, OBSTACLE_DISTANCE, WHEEL_DISTANCE, GPS_RAW_INT.
Messages are requested once they are used.
"""

import math
import struct
from collections import deque
from collections.abc import Callable, Sequence
from typing import ClassVar, Final, Protocol

from gloc3.mavlink.codec import MavlinkMessage
from gloc3.messages.frames import GRAVITY_M_S2, Vector3
from gloc3.messages.perception import ImuSample, LaserScan, SatelliteFix, WheelDistances
from gloc3.messages.vehicle import Style
from gloc3_onboard.autopilot.style import DISTANCE_SENSOR, MessageStream
from gloc3_onboard.autopilot.telemetry import BootClock
from gloc3_onboard.sensors.devices import Bell, StampedFix, StampedImu, StampedScan, StampedWheels

UNKNOWN_CM: Final = 0xFFFF
NORTH_ALIGNED: Final = (0, 1)
"""MAV_FRAME_GLOBAL, which an absent field means too, and MAV_FRAME_LOCAL_NED."""
LEVEL: Final = 8
"""MAV_SENSOR_ROTATION_NONE, YAW_45 ... YAW_315: number of directions."""
FAR_S: Final = 1.0
"""Time after which an unrepeated reading expires, s."""
_NOTHING: Final = math.inf
_NO_READING: Final = 0.0


def scan_of_obstacles(message: MavlinkMessage, yaw_rad: float | None) -> LaserScan:
    """OBSTACLE_DISTANCE as a scan ahead of the body; invalid if its directions are unknown.

    Args:
        message: the message.
        yaw_rad: the heading, clockwise from north; for messages whose angles count from north.
    """
    step_deg = message.increment_f or float(message.increment)
    offset_deg = message.angle_offset
    reason = ""
    if not math.isfinite(step_deg) or step_deg == 0.0 or not math.isfinite(offset_deg):
        reason, step_deg, offset_deg = "the scanner does not report its beam directions", 1.0, 0.0
    if message.frame in NORTH_ALIGNED:
        if yaw_rad is None:
            reason = reason or "its directions are relative to north, and the heading is unknown"
        else:
            offset_deg -= math.degrees(yaw_rad)
    count = min(len(message.distances), max(1, round(360.0 / abs(step_deg))))
    max_m = message.max_distance * 1e-2
    ranges = [_range_m(distance_cm, message.max_distance, max_m) for distance_cm in message.distances[:count]]
    return _scan("obstacles", offset_deg, step_deg, ranges, (message.min_distance * 1e-2, max_m), reason)


def _range_m(distance_cm: int, max_cm: int, max_m: float) -> float:
    if distance_cm == UNKNOWN_CM:
        return _NO_READING
    return _NOTHING if distance_cm >= max_cm else min(distance_cm * 1e-2, max_m)


def _scan(
    name: str,
    offset_deg: float,
    step_deg: float,
    ranges_m: Sequence[float],
    limits_m: tuple[float, float],
    reason: str = "",
) -> LaserScan:
    last_deg = offset_deg + (len(ranges_m) - 1) * step_deg
    is_clockwise = step_deg > 0.0
    ordered = [*reversed(ranges_m)] if is_clockwise else [*ranges_m]
    return LaserScan(
        scanner=name,
        angle_min_rad=math.radians(-last_deg if is_clockwise else -offset_deg),
        angle_step_rad=math.radians(abs(step_deg)),
        range_min_m=limits_m[0],
        range_max_m=limits_m[1],
        ranges_m=struct.pack(f"<{len(ordered)}f", *ordered),
        is_valid=not reason,
        reason=reason,
    )


class RangeRing:
    """Combines horizontal range finders, at most one in each eighth of a turn, into a scan of eight beams."""

    def __init__(self) -> None:
        self._received: dict[int, tuple[float, MavlinkMessage]] = {}

    def receive(self, message: MavlinkMessage, now_s: float) -> LaserScan | None:
        """Handles a DISTANCE_SENSOR; returns the scan with it, or None if it is not horizontal."""
        if message.orientation >= LEVEL:
            return None
        self._received[message.orientation] = (now_s, message)
        alive = {
            direction: received
            for direction, (received_s, received) in self._received.items()
            if now_s - received_s < FAR_S
        }
        max_cm = max(received.max_distance for received in alive.values())
        ranges = [
            _range_m(alive[direction].current_distance, alive[direction].max_distance, max_cm * 1e-2)
            if direction in alive
            else _NO_READING
            for direction in range(LEVEL)
        ]
        least_m = min(received.min_distance for received in alive.values()) * 1e-2
        return _scan("ranges", 0.0, 360.0 / LEVEL, ranges, (least_m, max_cm * 1e-2))


HIGHRES_IMU, SCALED_IMU, OBSTACLE_DISTANCE, GPS_RAW_INT, WHEEL_DISTANCE = 105, 26, 330, 24, 9000
IMU_OF: Final = {Style.PX4: HIGHRES_IMU, Style.ARDUPILOT: SCALED_IMU}
IMU_HZ: Final = 100.0
SCAN_HZ: Final = 10.0
FIX_HZ: Final = 5.0
WHEELS_HZ: Final = 10.0
THREE_D: Final = 3
"""GPS_FIX_TYPE from which there is a place."""
UNSAID: Final = 0xFFFF
"""Speed and course in GPS_RAW_INT of a receiver that does not report them."""
USUAL_STD_M: Final = 2.5
"""Taken where the receiver does not claim an accuracy."""
USUAL_HEIGHT_STD_M: Final = 5.0
"""The same for the altitude."""
KEPT: Final = 256
"""Number of buffered samples of the inertial unit."""
MILLI_G: Final = 1e-3 * GRAVITY_M_S2
UTC_US: Final = 10**15
"""A stamp above this is of UTC, not since boot."""


class AutopilotTime(Protocol):
    """Provides the autopilot's time and heading."""

    @property
    def yaw_rad(self) -> float | None:
        """Its heading, clockwise from north; None while it is not known."""

    def t_s(self, boot_ms: float, now_s: float) -> float:
        """Our time of one of its stamps."""


class AutopilotSensors:
    """Keeps the latest of each sensor; each message replaces immutable values.

    Args:
        changed: called when other messages are wanted than before.
    """

    HANDLES: ClassVar = (
        "HIGHRES_IMU",
        "SCALED_IMU",
        "RAW_IMU",
        "OBSTACLE_DISTANCE",
        "DISTANCE_SENSOR",
        "WHEEL_DISTANCE",
        "GPS_RAW_INT",
    )

    def __init__(self, changed: Callable[[], None] = lambda: None) -> None:
        self.obstacles: StampedScan | None = None
        """By OBSTACLE_DISTANCE."""
        self.ranges: StampedScan | None = None
        """Scan of the horizontal range finders, from DISTANCE_SENSOR."""
        self.satellites: StampedFix | None = None
        """By GPS_RAW_INT."""
        self.wheels: StampedWheels | None = None
        """By WHEEL_DISTANCE."""
        self.imu_bell, self.obstacles_bell, self.ranges_bell = Bell(), Bell(), Bell()
        self.fix_bell, self.wheels_bell = Bell(), Bell()
        self._changed = changed
        self._samples: deque[StampedImu] = deque(maxlen=KEPT)
        self._imu_kind, self._imu_s = "", -math.inf
        self._utc = BootClock()
        self._ring = RangeRing()
        self._rates_hz: dict[str, float] = {}

    # --- what is wanted ---

    def want(self, what: str, rate_hz: float) -> None:
        """Requests the messages of *imu*, *obstacles*, *ranges*, *wheels* or *satellites*; from any thread."""
        if self._rates_hz.get(what) != rate_hz:
            self._rates_hz = {**self._rates_hz, what: rate_hz}
            self._changed()

    def streams(self, style: Style) -> list[MessageStream]:
        """The messages that are wanted of an autopilot of this family."""
        ids = {"imu": IMU_OF[style], "obstacles": OBSTACLE_DISTANCE, "ranges": DISTANCE_SENSOR}
        ids |= {"satellites": GPS_RAW_INT, "wheels": WHEEL_DISTANCE}
        return [MessageStream(ids[what], rate_hz) for what, rate_hz in sorted(self._rates_hz.items())]

    def samples(self, after_s: float) -> Sequence[StampedImu]:
        """What the inertial unit felt after a time."""
        found: list[StampedImu] = []
        for stamped in reversed(self._samples.copy()):
            if stamped.t_s <= after_s:
                break
            found.append(stamped)
        return found[::-1]

    # --- what comes ---

    def receive(self, message: MavlinkMessage, now_s: float, time: AutopilotTime) -> None:
        """Takes a message in."""
        match message.name:
            case "HIGHRES_IMU" | "SCALED_IMU" | "RAW_IMU":
                self._imu(message, now_s, time)
            case "OBSTACLE_DISTANCE":
                t_s = self._t_s(message.time_usec, now_s, time)
                self.obstacles = StampedScan(t_s, scan_of_obstacles(message, time.yaw_rad))
                self.obstacles_bell.ring()
            case "DISTANCE_SENSOR":
                scan = self._ring.receive(message, now_s)
                if scan is not None:
                    self.ranges = StampedScan(time.t_s(message.time_boot_ms, now_s), scan)
                    self.ranges_bell.ring()
            case "WHEEL_DISTANCE":
                t_s, count = self._t_s(message.time_usec, now_s, time), min(message.count, len(message.distance))
                self.wheels = StampedWheels(t_s, WheelDistances(distances_m=tuple(message.distance[:count])))
                self.wheels_bell.ring()
            case "GPS_RAW_INT":
                self.satellites = StampedFix(self._t_s(message.time_usec, now_s, time), satellite_fix(message))
                self.fix_bell.ring()

    def _t_s(self, time_us: int, now_s: float, time: AutopilotTime) -> float:
        if time_us == 0:
            return now_s
        if time_us > UTC_US:
            return self._utc.t_s((time_us - UTC_US) * 1e-3, now_s)
        return time.t_s(time_us * 1e-3, now_s)

    def _imu(self, message: MavlinkMessage, now_s: float, time: AutopilotTime) -> None:
        """Of several messages about inertial units only the first kind that comes is taken, and its first unit."""
        if message.name != self._imu_kind and now_s - self._imu_s < FAR_S:
            return
        if getattr(message, "id_", 0):
            return
        self._imu_kind, self._imu_s = message.name, now_s
        if message.name == "SCALED_IMU":
            t_s = time.t_s(message.time_boot_ms, now_s)
        else:
            t_s = self._t_s(message.time_usec, now_s, time)
        force: Vector3 = (message.xacc, message.yacc, message.zacc)
        rate: Vector3 = (message.xgyro, message.ygyro, message.zgyro)
        if message.name != "HIGHRES_IMU":  # in thousandths of g and of radians per second
            force = (force[0] * MILLI_G, force[1] * MILLI_G, force[2] * MILLI_G)
            rate = (rate[0] * 1e-3, rate[1] * 1e-3, rate[2] * 1e-3)
        sample = ImuSample(rate_frd_rad_s=rate, specific_force_frd_m_s2=force)
        self._samples.append(StampedImu(t_s, sample))
        self.imu_bell.ring()


def satellite_fix(message: MavlinkMessage) -> SatelliteFix:
    """The fix of a GPS_RAW_INT; its accuracy is the receiver's if reported, else a typical one."""
    claimed_m, claimed_height_m = message.h_acc * 1e-3, message.v_acc * 1e-3
    is_valid = message.fix_type >= THREE_D
    return SatelliteFix(
        place_geo=(message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3),
        std_m=claimed_m if claimed_m > 0.0 else USUAL_STD_M,
        height_std_m=claimed_height_m if claimed_height_m > 0.0 else USUAL_HEIGHT_STD_M,
        satellites=message.satellites_visible,
        is_valid=is_valid,
        reason="" if is_valid else "no satellites",
        speed_m_s=message.vel * 1e-2 if message.vel != UNSAID else 0.0,
        course_deg=message.cog * 1e-2 if message.cog != UNSAID else 0.0,
    )
