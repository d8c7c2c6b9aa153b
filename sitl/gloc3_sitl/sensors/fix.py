"""The satellite receiver: RTK-grade fixes, or by a switch plain GPS, which corrections of a base make RTK-grade."""

from math import cos, pi, radians, sin, sqrt
from typing import Final

import msgspec

from gloc3.messages.frames import WGS84_A_M, WGS84_F, GeoPoint, Vector3
from gloc3.rtcm3 import RtcmParser, is_observation
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.sensors.noise import Wander
from gloc3_sitl.sensors.readings import FixKind, FixReading
from gloc3_sitl.sensors.sensor import SimulatedSensor


class Receiver(msgspec.Struct, frozen=True, kw_only=True):
    """The errors of a kind of receiver; all are standard deviations, horizontal ones of each of north and east."""

    kind: FixKind
    """What it reports."""
    noise_horizontal_m: float
    """White position noise."""
    noise_vertical_m: float
    """White altitude noise."""
    wander_horizontal_m: float
    """Position error that changes slowly."""
    wander_vertical_m: float
    """Altitude error that changes slowly."""
    wander_time_constant_s: float
    """Correlation time of the slow errors, s."""
    speed_horizontal_m_s: float
    """White velocity noise."""
    speed_vertical_m_s: float
    """White noise of the vertical velocity."""
    latency_s: float
    """Time from validity to delivery."""
    satellites: int
    """Satellites used."""
    is_rover: bool = False
    """Whether corrections of a base make it as good as `RTK`."""


RTK: Final = Receiver(
    kind=FixKind.RTK_FIXED,
    noise_horizontal_m=0.008,
    noise_vertical_m=0.012,
    wander_horizontal_m=0.006,
    wander_vertical_m=0.009,
    wander_time_constant_s=30.0,
    speed_horizontal_m_s=0.03,
    speed_vertical_m_s=0.05,
    latency_s=0.1,
    satellites=24,
)
"""A fixed carrier-phase solution: 1 cm horizontally, 1.5 cm vertically, 0.05 m/s (data sheet figures of the ZED-F9P class)."""

PLAIN_GPS: Final = Receiver(
    kind=FixKind.THREE_D,
    noise_horizontal_m=0.1,
    noise_vertical_m=0.2,
    wander_horizontal_m=1.2,
    wander_vertical_m=2.2,
    wander_time_constant_s=100.0,
    speed_horizontal_m_s=0.05,
    speed_vertical_m_s=0.1,
    latency_s=0.1,
    satellites=12,
    is_rover=True,
)
"""A code solution: 2.5 m of error in every second fix at most, 0.05 m/s (data sheet figures of the NEO-M8N class)."""

ACOUSTIC: Final = Receiver(
    kind=FixKind.THREE_D,
    noise_horizontal_m=0.15,
    noise_vertical_m=0.15,
    wander_horizontal_m=0.25,
    wander_vertical_m=0.25,
    wander_time_constant_s=60.0,
    speed_horizontal_m_s=0.05,
    speed_vertical_m_s=0.05,
    latency_s=0.2,
    satellites=12,
)
"""Acoustic positions that the autopilot is given in place of a receiver's: 0.3 m within 30 m of the antennas (data sheet
figure of the Water Linked Underwater GPS G2: 1 % of the range)."""


CORRECTED_S: Final = 10.0
"""Age of the last observations of the base up to which they correct, s."""


class FixSensor(SimulatedSensor[FixReading]):
    """Position with white and slowly changing errors, velocity with white noise, after a latency."""

    name = "fix"
    fault_unit = "m north, east and down"
    bias_size = 5.0
    noise_size = 3.0

    def __init__(self, seed: int, home: GeoPoint, receiver: Receiver = RTK, rate_hz: float = 10.0) -> None:
        super().__init__(seed, rate_hz)
        self.receiver: Final = receiver
        self._corrections = RtcmParser()
        self._has_base = False
        self._corrected_until_s = float("-inf")
        self.latency_s = receiver.latency_s
        constants = (self._draw, receiver.wander_horizontal_m, receiver.wander_time_constant_s, 1.0 / rate_hz)
        vertical = (self._draw, receiver.wander_vertical_m, receiver.wander_time_constant_s, 1.0 / rate_hz)
        self._wander = (Wander(*constants), Wander(*constants), Wander(*vertical))
        latitude, e2 = radians(home.latitude_deg), WGS84_F * (2.0 - WGS84_F)
        root = sqrt(1.0 - e2 * sin(latitude) ** 2)
        self._deg_per_north_m = 180.0 / pi * root**3 / (WGS84_A_M * (1.0 - e2))
        self._deg_per_east_m = 180.0 / pi * root / (WGS84_A_M * max(cos(latitude), 1e-6))

    def correct(self, corrections: bytes, now_s: float) -> None:
        """Takes RTCM 3: with the position of the base and fresh observations a rover's fixes are RTK-grade."""
        for frame in self._corrections.receive(corrections):
            self._has_base |= frame.base_ecef_m() is not None
            if is_observation(frame.message_type) and self._has_base and self.receiver.is_rover:
                self._corrected_until_s = now_s + CORRECTED_S

    def measure(self, motion: TrueMotion, t_s: float) -> FixReading:
        """Where the vehicle is, with all errors."""
        truth, draw = motion.truth(), self._draw
        receiver = RTK if t_s < self._corrected_until_s else self.receiver
        horizontal_m, vertical_m = receiver.noise_horizontal_m, receiver.noise_vertical_m
        speed_m_s = receiver.speed_horizontal_m_s
        north, east, down = self._wander
        left_horizontal = receiver.wander_horizontal_m / self.receiver.wander_horizontal_m
        left_vertical = receiver.wander_vertical_m / self.receiver.wander_vertical_m
        north_m = left_horizontal * north.step() + horizontal_m * draw()
        east_m = left_horizontal * east.step() + horizontal_m * draw()
        up_m = vertical_m * draw() - left_vertical * down.step()
        vn, ve, vd = truth.velocity_ned_m_s
        return FixReading(
            t_s=t_s,
            kind=receiver.kind,
            latitude_deg=truth.latitude_deg + north_m * self._deg_per_north_m,
            longitude_deg=truth.longitude_deg + east_m * self._deg_per_east_m,
            altitude_m=truth.altitude_m + up_m,
            velocity_ned_m_s=(
                vn + speed_m_s * draw(),
                ve + speed_m_s * draw(),
                vd + receiver.speed_vertical_m_s * draw(),
            ),
            horizontal_accuracy_m=sqrt(horizontal_m**2 + receiver.wander_horizontal_m**2),
            vertical_accuracy_m=sqrt(vertical_m**2 + receiver.wander_vertical_m**2),
            speed_accuracy_m_s=receiver.speed_vertical_m_s,
            satellites=receiver.satellites,
        )

    def shift(self, reading: FixReading, offset: Vector3) -> FixReading:
        """Move the position; velocity and claimed accuracy stay."""
        return msgspec.structs.replace(
            reading,
            latitude_deg=reading.latitude_deg + offset[0] * self._deg_per_north_m,
            longitude_deg=reading.longitude_deg + offset[1] * self._deg_per_east_m,
            altitude_m=reading.altitude_m - offset[2],
        )

    def without_signal(self, reading: FixReading) -> FixReading:
        """No satellites."""
        return FixReading(
            t_s=reading.t_s,
            kind=FixKind.NONE,
            latitude_deg=0.0,
            longitude_deg=0.0,
            altitude_m=0.0,
            velocity_ned_m_s=(0.0, 0.0, 0.0),
            horizontal_accuracy_m=1e4,
            vertical_accuracy_m=1e4,
            speed_accuracy_m_s=1e2,
            satellites=0,
        )


ANTENNA_M: Final = 0.25
"""Height of the antenna over the body's origin, on its mast."""
REACQUIRE_S: Final = 8.0
"""Time from surfacing to the first fix, s: re-acquisition of a warm receiver (1 s hot, 29 s cold on the NEO-M8N
class) with a wet antenna washed over by waves."""


class SurfaceFix(FixSensor):
    """No satellites while the antenna is under water, and for `REACQUIRE_S` after."""

    def __init__(self, seed: int, home: GeoPoint, receiver: Receiver = PLAIN_GPS, rate_hz: float = 5.0) -> None:
        super().__init__(seed, home, receiver, rate_hz)
        self._surface_m = home.altitude_m
        self._since_s = -REACQUIRE_S

    def measure(self, motion: TrueMotion, t_s: float) -> FixReading:
        """The measured position; without a fix where the receiver sees no satellites."""
        reading = super().measure(motion, t_s)
        if motion.truth().altitude_m + ANTENNA_M < self._surface_m:
            self._since_s = t_s
        return reading if t_s - self._since_s >= REACQUIRE_S else self.without_signal(reading)
