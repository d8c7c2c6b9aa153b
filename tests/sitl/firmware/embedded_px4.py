"""The embedded autopilot in PX4's style behind PX4's simulator interface: it has nothing but what came over that.

What a real one makes of the messages it makes of them, too: a fix counts as `EKF2_GPS_DELAY` old, its speed as known to
0.25 m/s, the magnetic field is looked up where it is, and the battery is its own, which stays full.
"""

from math import radians
from typing import Final

from tests.sitl.firmware.px4_peer import BARO, GYRO, MAG, Px4Peer

from gloc3.mavlink.message import MavlinkMessage
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.mavlink.front import Front
from gloc3_sitl.autopilot.mavlink.links import LinkKind, Send
from gloc3_sitl.autopilot.styles.px4 import PX4
from gloc3_sitl.sensors.magnetic_field import declination_deg
from gloc3_sitl.sensors.range_finder import HeightSensor
from gloc3_sitl.sensors.readings import (
    BarometerReading,
    BatteryReading,
    FixKind,
    FixReading,
    ImuReading,
    MagnetometerReading,
    RangeReading,
    Reading,
)

GPS_DELAY_S: Final = 0.11
BATTERY_EVERY_US: Final = 200_000


class EmbeddedPx4:
    """Controls the motors of a `Px4Peer`, and speaks MAVLink for it.

    Args:
        send: takes each frame that goes out on its MAVLink line.
    """

    def __init__(self, send: Send) -> None:
        self.texts: list[str] = []
        self.autopilot: Final = Autopilot(PX4, self._report)
        self._front = Front(self.autopilot)
        self.receive: Final = self._front.attach(send, LinkKind.COMPANION)
        self._fix: MavlinkMessage | None = None
        self._range: MavlinkMessage | None = None

    def __call__(self, peer: Px4Peer) -> list[float]:
        """One step of its control loops."""
        throttles = self.autopilot.step(self._readings(peer), peer.now_us * 1e-6)
        peer.is_armed = self.autopilot.craft.is_armed
        return list(throttles)

    def _report(self, severity: Severity, text: str) -> None:
        self.texts.append(text)
        self._front.send_text(severity, text)

    def _readings(self, peer: Px4Peer) -> list[Reading]:
        now_s, sensor = peer.now_us * 1e-6, peer.sensor
        assert sensor is not None
        readings: list[Reading] = []
        if peer.fix is not self._fix and peer.fix is not None:
            self._fix = peer.fix
            fix = fix_reading(peer.fix, now_s - GPS_DELAY_S)
            if fix.kind is not FixKind.NONE:
                place = GeoPoint(fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
                self.autopilot.estimator.declination_rad = radians(declination_deg(place))
            readings.append(fix)
        if peer.range is not self._range and peer.range is not None:
            self._range = peer.range
            readings.append(range_reading(peer.range))
        if sensor.fields_updated & GYRO:
            force, rate = (sensor.xacc, sensor.yacc, sensor.zacc), (sensor.xgyro, sensor.ygyro, sensor.zgyro)
            readings.append(ImuReading(t_s=now_s, specific_force_frd_m_s2=force, rate_frd_rad_s=rate))
        if sensor.fields_updated & MAG:
            field = (sensor.xmag * 1e-4, sensor.ymag * 1e-4, sensor.zmag * 1e-4)
            readings.append(MagnetometerReading(t_s=now_s, field_frd_tesla=field))
        if sensor.fields_updated & BARO:
            pressure_pa, altitude_m = sensor.abs_pressure * 100.0, sensor.pressure_alt
            readings.append(BarometerReading(t_s=now_s, pressure_pa=pressure_pa, altitude_m=altitude_m))
        if peer.now_us % BATTERY_EVERY_US == 0:
            readings.append(BatteryReading(t_s=now_s, voltage_v=16.2, current_a=5.0, consumed_ah=0.0, remaining=1.0))
        return readings


def fix_reading(fix: MavlinkMessage, t_s: float) -> FixReading:
    """HIL_GPS, of this time."""
    return FixReading(
        t_s=t_s,
        kind=FixKind(fix.fix_type),
        latitude_deg=fix.lat * 1e-7,
        longitude_deg=fix.lon * 1e-7,
        altitude_m=fix.alt * 1e-3,
        velocity_ned_m_s=(fix.vn * 1e-2, fix.ve * 1e-2, fix.vd * 1e-2),
        horizontal_accuracy_m=fix.eph * 1e-2,
        vertical_accuracy_m=fix.epv * 1e-2,
        speed_accuracy_m_s=0.25,
        satellites=fix.satellites_visible,
    )


def range_reading(reported: MavlinkMessage) -> RangeReading:
    """DISTANCE_SENSOR; it is known where the sensor sits."""
    return RangeReading(
        t_s=reported.time_boot_ms * 1e-3,
        distance_m=reported.current_distance * 1e-2,
        is_valid=reported.signal_quality != 1,
        min_m=reported.min_distance * 1e-2,
        max_m=reported.max_distance * 1e-2,
        mount_height_m=HeightSensor.mount_height_m,
    )
