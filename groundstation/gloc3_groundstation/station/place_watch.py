"""Position and motion of an autopilot without a companion, in the platforms' message format."""

from math import degrees, isfinite
from typing import Final

from gloc3.mavlink.message import MavlinkMessage
from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.messages.motion import MotionSummary, SiteSummary, Whole3

RECEIVED_MESSAGES: Final = ("GLOBAL_POSITION_INT", "ATTITUDE", "SYS_STATUS")
WITHIN_S: Final = 5.0
"""A place or an attitude that is older is not known any more."""
_VOLTAGE_UNKNOWN: Final = 65_535


class PlaceWatch:
    """Takes in an autopilot's messages; its frame begins where it was placed first, at the height of its home."""

    def __init__(self) -> None:
        self.site: SiteSummary | None = None
        """Where the frame lies; None until there is a place on Earth."""
        self.motion: MotionSummary | None = None
        """How it moved when it told that last; None until there is a place."""
        self._frame: LocalFrame | None = None
        self._attitude_cdeg: Whole3 | None = None
        self._attitude_s = 0.0
        self._battery_cv = 0
        self._battery_ca = 0

    def receive(self, message: MavlinkMessage, now_s: float) -> None:
        """Takes in a message, if it is one of `RECEIVED_MESSAGES`."""
        match message.name:
            case "ATTITUDE":
                angles = message.roll, message.pitch, message.yaw
                if all(map(isfinite, angles)):
                    roll, pitch, yaw = (round(100.0 * degrees(angle)) for angle in angles)
                    self._attitude_cdeg, self._attitude_s = (roll, pitch, yaw % 36000), now_s
            case "SYS_STATUS":
                voltage = message.voltage_battery
                self._battery_cv = round(voltage / 10.0) if voltage != _VOLTAGE_UNKNOWN else 0
                self._battery_ca = max(0, message.current_battery)
            case "GLOBAL_POSITION_INT":
                self._place(message, now_s)

    def position_m(self) -> tuple[float, float, float] | None:
        """X (north), y (west) and height in the frame; None until there is a place."""
        if self.motion is None:
            return None
        x, y, height = self.motion.position_cm
        return x / 100.0, y / 100.0, height / 100.0

    def _place(self, message: MavlinkMessage, now_s: float) -> None:
        if (message.lat, message.lon) == (0, 0):
            return
        latitude_deg, longitude_deg, altitude_m = message.lat / 1e7, message.lon / 1e7, message.alt / 1e3
        if self._frame is None:
            origin = GeoPoint(latitude_deg, longitude_deg, altitude_m - message.relative_alt / 1e3)
            self._frame = LocalFrame(origin)
            self.site = SiteSummary(frame="", x_axis_bearing_deg=0.0, origin_geo=(origin[0], origin[1], origin[2]))
        x, y, height = self._frame.from_geo(latitude_deg, longitude_deg, altitude_m)
        attitude = self._attitude_cdeg if now_s - self._attitude_s < WITHIN_S else None
        heading = message.hdg if message.hdg < 36000 else 0
        self.motion = MotionSummary(
            t_s=message.time_boot_ms / 1e3,
            attitude_cdeg=attitude or (0, 0, heading),
            position_cm=(round(100.0 * x), round(100.0 * y), round(100.0 * height)),
            velocity_cm_s=(message.vx, -message.vy, -message.vz),
            is_pose_valid=True,
            battery_cv=self._battery_cv,
            battery_ca=self._battery_ca,
        )
