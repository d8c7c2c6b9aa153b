"""Telemetry: converts an autopilot's MAVLink messages into our state, pose and height."""

import math
from collections import deque
from collections.abc import Sequence
from typing import ClassVar, Final

import msgspec

from gloc3.mavlink.codec import MavlinkMessage
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.heartbeat import ARMED
from gloc3.mavlink.services.timesync import TimeSync
from gloc3.messages.frames import Vector3, normalize, yaw_of
from gloc3.messages.vehicle import VTOL_FORMS, AutopilotPose, AutopilotState, HeightAboveGround, LandedState
from gloc3_onboard.autopilot.health_words import HEIGHT, UNHEALTHY, estimator_problems, unhealthy
from gloc3_onboard.autopilot.style import AutopilotStyle
from gloc3_onboard.sensors.devices import Stamped, StampedHeight

CRITICAL: Final = 5
PREARM_BIT: Final = 1 << 28
TRANSMITTER_BIT: Final = 1 << 16
DOWNWARD: Final = 25
"""MAV_SENSOR_ROTATION_PITCH_270."""
NOT_REPORTED_MV: Final = 0xFFFF
MOST_REASONS: Final = 8
REPEATED_S: Final = 45.0
"""Time after which an unrepeated reason expires, s; ArduPilot repeats its own every 30 s."""
NO_POSITION_S: Final = 0.3
"""Attitudes that come so long after the last position show that the estimator has none."""
WARNING: Final = 4
"""MAV_SEVERITY of texts that may be the reason of a refusal; smaller is worse."""
RESTARTED_MS: Final = 500
"""Backward step above which the autopilot's clock counts as restarted, ms; reordered messages differ by less."""
PREARM_WORDS: Final = ("prearm", "preflight", "arming denied", "arm:", "config error")
"""How a status text begins that says why the autopilot would not arm, in lower case."""

_LANDED: Final = {
    1: LandedState.ON_GROUND,
    2: LandedState.IN_AIR,
    3: LandedState.TAKING_OFF,
    4: LandedState.LANDING,
}

GAINED_S: Final = 2.5
"""A clock that gains more than this on ours is too fast, s; simulations catch up delays of up to 2 s."""
RATED_S: Final = 10.0
"""Time after which the measurement of a clock's rate begins again, s."""
BREACH_S: Final = 1.0
"""A mode that begins within this of a breach of the autopilot's fence, before or after, is its answer, s: ArduPilot changes
its mode, sends HEARTBEAT and FENCE_STATUS, and does not report a critical state, as it does in other failsafes."""


class BootClock:
    """Maps the autopilot's time since boot to ours: the smallest difference seen is that of the fastest message."""

    DRIFT: ClassVar[float] = 1e-4

    def __init__(self) -> None:
        self.restarts = 0
        """Number of restarts of the autopilot's clock."""
        self._offset_s = math.inf
        self._last_s = 0.0
        self._last_boot_ms = 0.0
        self._earlier_ms: float | None = None
        """A stamp from long before the newest, if no other has come since."""
        self.rate = 1.0
        """Its seconds in one of ours, where it gains on ours; else 1."""
        self._rated: tuple[float, float] | None = None
        """Time and offset at the begin of the measurement of the rate."""

    def t_s(self, boot_ms: float, now_s: float) -> float:
        """Our time of an autopilot's time stamp; never later than now.

        A clock that has restarted goes on from an earlier time; an earlier stamp by itself is that of a sensor that has
        stopped, which some firmware repeats.
        """
        if boot_ms + RESTARTED_MS < self._last_boot_ms:
            if self._earlier_ms is None or boot_ms <= self._earlier_ms:
                self._earlier_ms = boot_ms
                return boot_ms * 1e-3 + self._offset_s
            self.restarts += 1
            self._offset_s, self._rated = math.inf, None
            self._last_boot_ms = boot_ms
        self._earlier_ms = None
        self._last_boot_ms = max(self._last_boot_ms, boot_ms)
        drift_s = self.DRIFT * (now_s - self._last_s)
        self._offset_s = min(self._offset_s + drift_s, now_s - boot_ms * 1e-3)
        self._last_s = now_s
        self._measure(now_s)
        return boot_ms * 1e-3 + self._offset_s

    def _measure(self, now_s: float) -> None:
        """The least difference only becomes less if its clock is faster than ours; no delay of messages makes it so."""
        begin_s, offset_s = self._rated or (now_s, self._offset_s)
        gained_s, duration_s = offset_s - self._offset_s, now_s - begin_s
        if gained_s > GAINED_S and duration_s > 0.0:
            self.rate = 1.0 + gained_s / duration_s
        elif duration_s >= RATED_S:
            self.rate = 1.0
        self._rated = (now_s, self._offset_s) if duration_s >= RATED_S else (begin_s, offset_s)

    def t_s_of(self, boot_s: float) -> float | None:
        """Our time of a moment in the autopilot's time; None while unknown."""
        return boot_s + self._offset_s if math.isfinite(self._offset_s) else None

    def correct(self, least_offset_s: float) -> None:
        """Applies a lower bound of the clock offset from round trips, after a pause of the autopilot."""
        if math.isfinite(self._offset_s):
            self._offset_s = max(self._offset_s, least_offset_s)

    def restart(self) -> None:
        """Restarts with the next stamp."""
        self.restarts += 1
        self._offset_s, self._last_boot_ms, self._rated = math.inf, 0.0, None

    def boot_s(self, now_s: float) -> float | None:
        """The autopilot's time of one of ours; None while unknown."""
        return now_s - self._offset_s if math.isfinite(self._offset_s) else None

    def boot_ms(self, now_s: float) -> int:
        """The autopilot's own time now."""
        return max(0, int((now_s - self._offset_s) * 1e3)) if math.isfinite(self._offset_s) else 0


class Telemetry:
    """Keeps the latest of everything; each message replaces immutable values."""

    HANDLES: ClassVar = (
        "HEARTBEAT",
        "SYS_STATUS",
        "ATTITUDE_QUATERNION",
        "LOCAL_POSITION_NED",
        "GLOBAL_POSITION_INT",
        "GPS_GLOBAL_ORIGIN",
        "DISTANCE_SENSOR",
        "EXTENDED_SYS_STATE",
        "HOME_POSITION",
        "FENCE_STATUS",
        "EKF_STATUS_REPORT",
        "ESTIMATOR_STATUS",
    )

    def __init__(self) -> None:
        self.state = AutopilotState(is_connected=False)
        self.pose: Stamped | None = None
        self.attitude: Stamped | None = None
        """Of an estimator without a position."""
        self.height: StampedHeight | None = None
        self.altitude_m: float | None = None
        """Above mean sea level; None before it is known."""
        self.custom_mode = 0
        """Of the last heartbeat."""
        self._style: AutopilotStyle | None = None
        self._clock = BootClock()
        self._origin: tuple[float, float, float] | None = None
        self._attitude = (1.0, 0.0, 0.0, 0.0)
        self._rate = (0.0, 0.0, 0.0)
        self._has_attitude = False
        self._position_s = -math.inf
        """When the last position came."""
        self._mode_s = -math.inf
        """When the mode changed."""
        self._breaches = 0
        self._breached_s = -math.inf
        """When the autopilot reported a new breach of its fence."""
        self._answers_fence = False
        """Whether the mode is the autopilot's answer to a breach."""
        self._warnings: deque[tuple[float, str]] = deque(maxlen=8)
        self._reasons: dict[str, float] = {}
        """Reasons against arming, and when each was last reported."""
        self._is_unhealthy: list[str] = []
        self._estimator: list[str] = []
        self._has_height = True

    @property
    def restarts(self) -> int:
        """Times that the autopilot has restarted."""
        return self._clock.restarts

    @property
    def clock_rate(self) -> float:
        """Its seconds in one of ours, where its clock is much too fast; else 1."""
        return self._clock.rate

    @property
    def has_origin(self) -> bool:
        """Whether the autopilot has reported the origin of its local frame."""
        return self._origin is not None

    def adopt(self, style: AutopilotStyle) -> None:
        """Uses this style's mode numbers from now on."""
        self._style = style

    def connected(self, is_connected: bool) -> None:
        """Sets whether the autopilot is connected."""
        self._set(is_connected=is_connected)

    def boot_ms(self, now_s: float) -> int:
        """The autopilot's own time now."""
        return self._clock.boot_ms(now_s)

    def boot_s(self, now_s: float) -> float | None:
        """The autopilot's time of one of ours; None while unknown."""
        return self._clock.boot_s(now_s)

    def correct_clock(self, least_offset_s: float) -> None:
        """Our clock minus the autopilot's is no less than this."""
        self._clock.correct(least_offset_s)

    def restarted(self) -> None:
        """Discards the state after a restart of the autopilot that was detected elsewhere."""
        self._clock.restart()
        self._reset()

    @property
    def yaw_rad(self) -> float | None:
        """The heading, clockwise from north; None before the first attitude."""
        return yaw_of(self._attitude) if self._has_attitude else None

    def t_s(self, boot_ms: float, now_s: float) -> float:
        """Our time of one of the autopilot's stamps that has just come; never later than now."""
        restarts = self._clock.restarts
        t_s = self._clock.t_s(boot_ms, now_s)
        if self._clock.restarts != restarts:
            self._reset()
        return t_s

    def t_s_of_boot(self, boot_s: float) -> float | None:
        """Our time of a moment in the autopilot's time; None while unknown."""
        return self._clock.t_s_of(boot_s)

    def receive(self, message: MavlinkMessage, now_s: float) -> None:
        """Takes a message of the autopilot in."""
        restarts = self._clock.restarts
        self._handle(message, now_s)
        if self._clock.restarts != restarts:
            self._reset()

    def _reset(self) -> None:
        """Discards the state after a restart: the estimator may have another origin."""
        self.pose = self.attitude = self.height = self.altitude_m = self._origin = None
        self._has_attitude, self._has_height = False, True
        self._reasons.clear()
        self._set(reasons=[], has_home=False, landed=LandedState.UNKNOWN)

    def _handle(self, message: MavlinkMessage, now_s: float) -> None:
        match message.name:
            case "LOCAL_POSITION_NED":
                self._local_position(message, now_s)
            case "ATTITUDE_QUATERNION":
                self._attitude = normalize((message.q1, message.q2, message.q3, message.q4))
                self._rate = (message.rollspeed, message.pitchspeed, message.yawspeed)
                self._has_attitude = True
                if self._is_without_position(now_s):
                    attitude = self._estimate((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
                    self.attitude = Stamped(self._clock.t_s(message.time_boot_ms, now_s), attitude)
            case "DISTANCE_SENSOR":
                self._distance(message, now_s)
            case "HEARTBEAT":
                self._heartbeat(message, now_s)
            case "FENCE_STATUS":
                self._fence(message, now_s)
            case "EXTENDED_SYS_STATE":
                if self._style is None or self._style.class_properties.reports_landed:
                    self._set(landed=_LANDED.get(message.landed_state, LandedState.UNKNOWN))
                self._set(form=VTOL_FORMS.get(message.vtol_state))
            case "SYS_STATUS":
                self._system(message, now_s)
            case "EKF_STATUS_REPORT" | "ESTIMATOR_STATUS":
                self._estimator, self._has_height = estimator_problems(message), bool(message.flags & HEIGHT)
                self._set(doubts=[*self._is_unhealthy, *self._estimator])
            case "HOME_POSITION":
                self._set(has_home=True)
            case "GLOBAL_POSITION_INT":
                self.altitude_m = message.alt * 1e-3
            case "GPS_GLOBAL_ORIGIN":
                self._origin = (message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)

    def _set(self, **fields: object) -> None:
        if any(getattr(self.state, name) != value for name, value in fields.items()):
            self.state = msgspec.structs.replace(self.state, **fields)

    def _heartbeat(self, message: MavlinkMessage, now_s: float) -> None:
        if self._style is None:
            return
        if message.custom_mode != self.custom_mode:
            self._mode_s, self._answers_fence = now_s, now_s - self._breached_s < BREACH_S
        self.custom_mode = message.custom_mode
        self._set(
            style=self._style.style,
            is_armed=bool(message.base_mode & ARMED),
            mode=self._style.flight_mode(message.custom_mode),
            mode_name=self._style.mode_name(message.custom_mode),
            is_failsafe=message.system_status >= CRITICAL or self._answers_fence,
            vehicle=self._style.class_properties.vehicle,
        )
        if not self._style.class_properties.reports_landed:
            self._set(landed=LandedState.IN_AIR if self.state.is_armed else LandedState.ON_GROUND)

    def _fence(self, message: MavlinkMessage, now_s: float) -> None:
        if message.breach_status and message.breach_count != self._breaches:
            self._breached_s = now_s
            if now_s - self._mode_s < BREACH_S:
                self._answers_fence = True
                self._set(is_failsafe=True)
        self._breaches = message.breach_count

    def _system(self, message: MavlinkMessage, now_s: float) -> None:
        is_armable = bool(message.onboard_control_sensors_health & PREARM_BIT)
        bad = unhealthy(
            message.onboard_control_sensors_present,
            message.onboard_control_sensors_enabled,
            message.onboard_control_sensors_health,
        )
        self._is_unhealthy = [UNHEALTHY + ", ".join(bad)] if bad else []
        self._reasons = {} if is_armable else {text: s for text, s in self._reasons.items() if now_s - s < REPEATED_S}
        self._set(
            battery_v=message.voltage_battery * 1e-3 if message.voltage_battery != NOT_REPORTED_MV else 0.0,
            battery_a=message.current_battery * 1e-2 if message.current_battery >= 0 else 0.0,
            battery_remaining=message.battery_remaining * 1e-2 if message.battery_remaining >= 0 else -1.0,
            is_armable=is_armable,
            has_transmitter=bool(
                message.onboard_control_sensors_present & message.onboard_control_sensors_health & TRANSMITTER_BIT
            ),
            reasons=list(self._reasons),
            doubts=[*self._is_unhealthy, *self._estimator],
        )

    def texts_since(self, t_s: float) -> list[str]:
        """Status texts of severity warning or worse since a time."""
        return [text for reported_s, text in self._warnings if reported_s >= t_s]

    def receive_text(self, severity: int, text: str, now_s: float) -> None:
        """Handles a status text of the autopilot."""
        if severity <= WARNING:
            self._warnings.append((now_s, text))
        if text.lower().startswith(PREARM_WORDS):
            self._reasons[text] = now_s
            while len(self._reasons) > MOST_REASONS:
                del self._reasons[next(iter(self._reasons))]
            self._set(reasons=list(self._reasons))

    def receive_reasons(self, reasons: Sequence[str], now_s: float) -> None:
        """Handles a complete report of reasons against arming."""
        self._reasons = dict.fromkeys(reasons[:MOST_REASONS], now_s)
        self._set(reasons=list(self._reasons))

    def _is_without_position(self, now_s: float) -> bool:
        """Whether the estimator has lost its position; on the ground it may not have found one yet."""
        has_had_one = self.state.is_armed or math.isfinite(self._position_s)
        return has_had_one and now_s - self._position_s > NO_POSITION_S

    def _local_position(self, message: MavlinkMessage, now_s: float) -> None:
        self._position_s = now_s
        if not self._has_attitude:
            return
        pose = self._estimate((message.x, message.y, message.z), (message.vx, message.vy, message.vz))
        self.pose = Stamped(self._clock.t_s(message.time_boot_ms, now_s), pose)

    def _estimate(self, position_ned_m: Vector3, velocity_ned_m_s: Vector3) -> AutopilotPose:
        return AutopilotPose(
            position_ned_m=position_ned_m,
            velocity_ned_m_s=velocity_ned_m_s,
            ned_from_frd=self._attitude,
            rate_frd_rad_s=self._rate,
            origin_geo=self._origin,
            has_height=self._has_height,
        )

    def _distance(self, message: MavlinkMessage, now_s: float) -> None:
        if message.orientation != DOWNWARD:
            return
        distance_m = message.current_distance * 1e-2
        is_valid = message.min_distance <= message.current_distance <= message.max_distance
        height = HeightAboveGround(
            height_m=distance_m, is_valid=is_valid, reason="" if is_valid else "no echo in range"
        )
        self.height = StampedHeight(self._clock.t_s(message.time_boot_ms, now_s), height)


CLOCKS_AGREE_S: Final = 0.25
"""Largest difference of the clock by round trips from the message stamps, s; beyond it, another clock is answering."""


class ClockOffset:
    """Detects a restart by the clock alone, and a clock that has stopped.

    Args:
        own: our MAVLink address.
        telemetry: telemetry with the clock by stamps.
    """

    def __init__(self, own: Address, telemetry: Telemetry) -> None:
        self.service: Final = TimeSync(own, send_s=telemetry.boot_s)
        """Driven by its owner."""
        self._telemetry = telemetry
        self._restarts = 0

    def poll(self, now_s: float) -> None:
        """Passes the result of the round trips to the telemetry."""
        service = self.service
        if (
            service.restarts != self._restarts
        ):  # an autopilot that sends nothing unasked shows a restart by its clock alone
            self._restarts = service.restarts
            self._telemetry.restarted()
        for sample in service.events():  # it answered after it was asked: a bound that no delay on the way can break
            self._telemetry.correct_clock(-sample.offset_s - 0.5 * sample.round_trip_s)

    def boot_s(self, t_s: float) -> float:
        """The autopilot's time of ours: by round trips if consistent with its stamps; 0 while unknown."""
        stamped_s = self._telemetry.boot_s(t_s)
        if stamped_s is None:
            return 0.0
        exact_s = self.service.to_peer_s(t_s) if self.service.is_converged else None
        return exact_s if exact_s is not None and abs(exact_s - stamped_s) < CLOCKS_AGREE_S else stamped_s
