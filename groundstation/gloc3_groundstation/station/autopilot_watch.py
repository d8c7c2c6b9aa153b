"""One autopilot as received on one link: mode, arming, battery, position, and address conflicts."""

from collections import deque
from math import degrees, isfinite
from typing import Final, NamedTuple

import msgspec

from gloc3.mavlink import codec
from gloc3.mavlink.flight_modes import mode_name
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.services.heartbeat import ARMED
from gloc3.mavlink.services.statustext import StatusText, StatusTextReceiver
from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.messages.motion import MotionSummary, SiteSummary, Whole3
from gloc3.messages.summaries import VehicleSummary
from gloc3.messages.vehicle import VTOL_FORMS, VtolForm, mode_in_words
from gloc3_groundstation.station.fleet import SMOOTHING
from gloc3_groundstation.station.readings import MESSAGES as READINGS
from gloc3_groundstation.station.readings import WANTED_HZ, FlightClock, ReadingsWatch
from gloc3_groundstation.station.snapshots import LinkStatistics

BEATS_WITHIN_S: Final = 4.5
"""Silence after which the heartbeat counts as lost, s, regardless of other messages."""
PLACE_WITHIN_S: Final = 5.0
"""A place or an attitude that is older is not known any more."""
SAME_BOOT_S: Final = 2.0
"""Times of start that differ by more are of two vehicles, or of two lives of one."""
DOUBLED_WITHIN_S: Final = 10.0
HOME_MOVED_M: Final = 0.5
"""Change of home's altitude from which heights count from its new place, m; less is noise."""
RESTART_CLEAR_S: Final = 3.0
"""Time of steady time since boot, after a jump, that confirms a restart, s."""
DOUBLED_JUMPS: Final = 4
"""So many jumps of the time since boot, to and fro, are no restarts."""
_LANDED: Final = {1: "on_ground", 2: "in_air", 3: "taking_off", 4: "landing"}
"""MAV_LANDED_STATE."""
_HEADING_UNKNOWN: Final = 65_535
RECEIVED_MESSAGES: Final = ("GLOBAL_POSITION_INT", "ATTITUDE", "SYS_STATUS")
"""Those that tell where an autopilot is and how it moves."""
WANTED: Final = frozenset(
    codec.shape(name).id for name in (*RECEIVED_MESSAGES, "EXTENDED_SYS_STATE", "VFR_HUD", "SYSTEM_TIME", "GPS_RAW_INT")
)
"""Messages about the vehicle's state, besides its heartbeat."""
_IDS: Final = WANTED | {codec.shape(name).id for name in ("HEARTBEAT", "STATUSTEXT", *READINGS)}
_VOLTAGE_UNKNOWN: Final = 65_535
RTK_FIXES: Final = (5, 6)
"""GPS_FIX_TYPE of RTK: float and fixed."""
REPEATED_S: Final = 30.0
"""An autopilot repeats what keeps it from arming; the same text counts again after this time, s."""
MOST_TEXTS: Final = 20
"""Texts that are kept until the vehicle has a name."""
STATE_HZ: Final = 1.0
"""Rate at which messages about the state are requested, Hz."""


class PlaceWatch:
    """Position and motion of an autopilot without a companion, as platforms report them.

    Its frame begins where it was placed first, at the height of its present home.
    """

    def __init__(self) -> None:
        self.site: SiteSummary | None = None
        """Origin of the frame; None until there is a geographic position."""
        self.motion: MotionSummary | None = None
        """Last reported motion; None until there is a position."""
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
        home = GeoPoint(latitude_deg, longitude_deg, altitude_m - message.relative_alt / 1e3)
        x, y, height = self._frame_above(home).from_geo(latitude_deg, longitude_deg, altitude_m)
        attitude = self._attitude_cdeg if now_s - self._attitude_s < PLACE_WITHIN_S else None
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

    def _frame_above(self, home: GeoPoint) -> LocalFrame:
        """The frame of the positions; `home` gives the altitude of home, and the place where a new frame begins."""
        frame = self._frame
        if frame is None or abs(frame.origin.altitude_m - home.altitude_m) > HOME_MOVED_M:
            origin = home if frame is None else frame.origin._replace(altitude_m=home.altitude_m)
            frame = self._frame = LocalFrame(origin)
            self.site = SiteSummary(frame="", x_axis_bearing_deg=0.0, origin_geo=(origin[0], origin[1], origin[2]))
        return frame


class _Jump(NamedTuple):
    """A change of the time at which an autopilot says that it has booted."""

    at_s: float
    is_up: bool
    """It has booted later."""
    is_new: bool
    """Its time since boot has gone back, or it was silent before: no link that is late does that."""


class AutopilotWatch:
    """Follows one autopilot by its frames."""

    def __init__(self, now_s: float) -> None:
        self.first_s: Final = now_s
        self.received_s = now_s
        """When anything came from it."""
        self.beat_s = now_s
        """When its last heartbeat came."""
        self.boot_at_s: float | None = None
        """Time of its boot, on the station's clock; None until it has sent its time."""
        self.autopilot = 0
        self.vehicle_type = 0
        self.is_armed = False
        self.link = LinkStatistics()
        self._mode = 0
        self.place_s = 0.0
        """When it sent its last position."""
        self._speed_m_s = 0.0
        self._sequence: int | None = None
        self._time_s = now_s
        """When its time since boot came last."""
        self._jumps: deque[_Jump] = deque(maxlen=DOUBLED_JUMPS)
        self._restarted_s: float | None = None
        """The restart from which its state counts."""
        self._receiver = StatusTextReceiver(Address(0, 0))
        self._texts: deque[StatusText] = deque(maxlen=MOST_TEXTS)
        self._reported_s: dict[str, float] = {}
        """When each of the last texts was told."""
        self._begin_life()

    def _begin_life(self) -> None:
        """Clears what is known of its state: it is new, has restarted, or is another one with the same address."""
        self.place = PlaceWatch()
        """Where it is, and how it moves."""
        self.readings = ReadingsWatch()
        self.flight = FlightClock()
        self._battery_percent = -1
        self._landed = ""
        self._form: VtolForm | None = None
        self._place: MavlinkMessage | None = None
        self.fix_type = 0
        """GPS_FIX_TYPE of its first receiver; 0 before it has sent any."""
        self.has_used_rtk = False
        self._received: set[int] = set()

    def receive(self, frame: Frame, now_s: float) -> None:
        """Takes in a frame that the autopilot has sent."""
        self._count(frame.sequence)
        self.received_s = now_s
        if frame.message_id not in _IDS:
            return
        self._received.add(frame.message_id)
        message = frame.decode()
        if message is None:
            return
        self.place.receive(message, now_s)
        self.readings.receive(message, self.autopilot, now_s)
        match message.name:
            case "HEARTBEAT":
                self.beat_s = now_s
                self.autopilot, self.vehicle_type = message.autopilot, message.type
                self.is_armed, self._mode = bool(message.base_mode & ARMED), message.custom_mode
                self.flight.update(is_flying=self.is_armed and self._landed != _LANDED[1], now_s=now_s)
            case "STATUSTEXT":
                self._receiver.receive(message, frame.sender, now_s)
            case "SYS_STATUS":
                self._battery_percent = message.battery_remaining if 0 <= message.battery_remaining <= 100 else -1
            case "GPS_RAW_INT":
                self.fix_type = message.fix_type
                self.has_used_rtk |= message.fix_type in RTK_FIXES
            case "EXTENDED_SYS_STATE":
                self._landed = _LANDED.get(message.landed_state, "")
                self._form = VTOL_FORMS.get(message.vtol_state)
            case "VFR_HUD":
                self._speed_m_s = message.groundspeed
            case "GLOBAL_POSITION_INT":
                self._place, self.place_s = message, now_s
                self._booted(now_s - message.time_boot_ms / 1000.0, now_s)
            case "SYSTEM_TIME":
                self._booted(now_s - message.time_boot_ms / 1000.0, now_s)

    def new_texts(self, now_s: float) -> list[StatusText]:
        """What it has said since the last call, without repeats."""
        self._receiver.tick(now_s)
        self._texts.extend(self._receiver.events())
        self._reported_s = {text: at_s for text, at_s in self._reported_s.items() if now_s - at_s < REPEATED_S}
        found = []
        while self._texts:
            text = self._texts.popleft()
            if text.text not in self._reported_s:
                self._reported_s[text.text] = now_s
                found.append(text)
        return found

    def missing(self, *, has_companion: bool) -> dict[int, float]:
        """Those of the wanted messages that have not come, with the rates to request, Hz.

        Args:
            has_companion: a companion reports the vehicle's state: only readings are wanted.
        """
        state = {} if has_companion else dict.fromkeys(sorted(WANTED - self._received), STATE_HZ)
        readings = {codec.shape(name).id: WANTED_HZ[name] for name in self.readings.missing(self.autopilot)}
        return readings | state

    def is_doubled(self, now_s: float) -> bool:
        """Whether two vehicles use this address: its time since boot jumps back and forth."""
        jumps = self._jumps
        return (
            len(jumps) == DOUBLED_JUMPS
            and now_s - jumps[0].at_s <= DOUBLED_WITHIN_S
            and len({jump.is_up for jump in jumps}) > 1
        )

    def restarted_s(self, now_s: float) -> float | None:
        """Time of its last restart; None without one, and until it is clear that it is one vehicle, not two.

        A vehicle that comes after a silence, and has booted at another time, is another one: that counts, too.
        """
        if not self._jumps:
            return None
        last, before_s = self._jumps[-1], self._jumps[-2].at_s if len(self._jumps) > 1 else float("-inf")
        is_clear = now_s - last.at_s >= RESTART_CLEAR_S and last.at_s - before_s >= RESTART_CLEAR_S
        return last.at_s if last.is_new and is_clear else None

    def is_same_life(self, other: "AutopilotWatch") -> bool:
        """Whether both have received the same vehicle: it booted at the same time."""
        if self.boot_at_s is None or other.boot_at_s is None:
            return False
        return self.autopilot == other.autopilot and abs(self.boot_at_s - other.boot_at_s) <= SAME_BOOT_S

    def reported_s(self, now_s: float) -> float:
        """Time for which its state is valid: its last message, or its last heartbeat if heartbeats are lost."""
        return self.received_s if now_s - self.beat_s < BEATS_WITHIN_S else self.beat_s

    def summary(self, now_s: float) -> VehicleSummary:
        """The vehicle as it is known."""
        place = self._place if now_s - self.place_s < PLACE_WITHIN_S else None
        is_placed = place is not None and (place.lat, place.lon) != (0, 0)
        geo = (place.lat / 1e7, place.lon / 1e7, place.alt / 1e3) if place is not None and is_placed else None
        known = self.place.position_m() if is_placed else None
        x, y = known[:2] if known is not None else (0.0, 0.0)
        heading = place.hdg if place is not None else _HEADING_UNKNOWN
        return VehicleSummary(
            t_s=0.0,
            mode=mode_in_words(mode_name(self.autopilot, self.vehicle_type, self._mode), self._form),
            is_armed=self.is_armed,
            landed=self._landed,
            battery_percent=self._battery_percent,
            position_m=(x, y, 0.0 if place is None else place.relative_alt / 1e3),
            speed_m_s=round(self._speed_m_s, 2),
            heading_deg=heading // 100 if heading != _HEADING_UNKNOWN else -1,
            is_pose_valid=geo is not None,
            has_pilot_control=False,
            is_autopilot_connected=True,
            geo=geo,
        )

    def _count(self, sequence: int) -> None:
        gap = 0 if self._sequence is None else (sequence - self._sequence - 1) & 0xFF
        self._sequence = sequence
        if gap > 128:  # an earlier one that was overtaken on its way
            gap = 0
        link = self.link
        loss = (1.0 - (1.0 - link.loss) * (1.0 - SMOOTHING) ** gap) * (1.0 - SMOOTHING)
        self.link = msgspec.structs.replace(link, received=link.received + 1, lost=link.lost + gap, loss=loss)

    def _booted(self, at_s: float, now_s: float) -> None:
        before, self.boot_at_s = self.boot_at_s, at_s
        time_s, self._time_s = self._time_s, now_s
        if before is not None and abs(at_s - before) > SAME_BOOT_S:
            is_back = now_s - at_s < time_s - before
            self._jumps.append(_Jump(now_s, at_s > before, is_back or now_s - time_s >= BEATS_WITHIN_S))
        restarted_s = self.restarted_s(now_s)
        if restarted_s is not None and restarted_s != self._restarted_s:
            self._restarted_s = restarted_s
            self._begin_life()
