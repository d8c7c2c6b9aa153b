"""PX4 bridge: one step for each HIL_SENSOR, and the next after PX4's HIL_ACTUATOR_CONTROLS."""

from collections.abc import Sequence
from typing import Final

from gloc3.mavlink import codec
from gloc3.mavlink.codec import Encoder, Parser
from gloc3.mavlink.message import MavlinkMessage
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL
from gloc3_sitl.firmware import hil_messages as hil
from gloc3_sitl.firmware.body import SensedBody
from gloc3_sitl.sensors.readings import (
    BarometerReading,
    FixReading,
    ImuReading,
    MagnetometerReading,
    RangeReading,
    Reading,
)

RATE_HZ: Final = 250
"""Steps of the physics and HIL_SENSOR messages per second, which PX4's own simulators have, too."""

_SYSTEM, _COMPONENT = 1, 200
"""MAVLink address of the simulator on the link."""
_HEARTBEAT_STEPS: Final = RATE_HZ
_MOTORS: Final = 4
_STANDING_STILL: Final = (0.0,) * _MOTORS
_STILL: Final = ImuReading(t_s=0.0, specific_force_frd_m_s2=(0.0, 0.0, 0.0), rate_frd_rad_s=(0.0, 0.0, 0.0))
"""Placeholder in fields that are not marked as new."""
_LOCK_STEP_FLAG: Final = 1
_HIL_STATE: Final = 115


class Px4Bridge:
    """Steps a vehicle for PX4.

    Until the first HIL_ACTUATOR_CONTROLS time runs freely, since PX4 needs it to boot. From then on a step follows only
    the answer to the last one: a message with a later time than the previous one (PX4's time is that of HIL_SENSOR).
    A PX4 that reports that it is not built for lock-step is not waited for.

    Args:
        body: the vehicle; `RATE_HZ` steps a second.
        utc_offset_s: UTC at time 0, in seconds since 1970.
    """

    def __init__(self, body: SensedBody, utc_offset_s: float) -> None:
        self.steps = 0
        """Steps since PX4 has connected."""
        self.answers = 0
        """HIL_ACTUATOR_CONTROLS since then."""
        self.repeats = 0
        """Messages without progress in time; they answer no step."""
        self.is_armed = False
        """What the last of them says."""
        self._body: Final = body
        self._utc_offset_s: Final = utc_offset_s
        self.connected()

    def connected(self) -> None:
        """Handles a connection of PX4 and restarts the vehicle."""
        if self.steps:
            self._body.restart()
        self.steps = self.answers = self.repeats = 0
        self.is_armed = False
        self._answered_us = -1
        self._parser = Parser()
        self._encoder = Encoder(_SYSTEM, _COMPONENT)
        self._throttles: Sequence[float] = _STANDING_STILL
        self._is_in_step = self._is_waiting = False
        self._imu: ImuReading | None = None
        self._magnetometer: MagnetometerReading | None = None
        self._barometer: BarometerReading | None = None
        self._truth_every_s: float | None = None
        self._truth_due_s = 0.0

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""
        return self._body.now_s

    @property
    def is_due(self) -> bool:
        """Whether there may be a step now, as far as PX4 is concerned."""
        return not self._is_waiting

    @property
    def is_in_step(self) -> bool:
        """Whether PX4 has started to answer."""
        return self._is_in_step

    def receive(self, data: bytes) -> None:
        """Takes a piece of the stream from PX4."""
        for frame in self._parser.receive(data):
            message = codec.decode(frame)
            if message is not None:
                self._handle(message)

    def _handle(self, message: MavlinkMessage) -> None:
        match message.name:
            case "HIL_ACTUATOR_CONTROLS":
                self.answers += 1
                is_in_step = bool(message.flags & _LOCK_STEP_FLAG)
                if is_in_step and message.time_usec <= self._answered_us:
                    self.repeats += 1
                    return
                self._answered_us = message.time_usec
                self.is_armed = bool(message.mode & codec.enums.MAV_MODE_FLAG_SAFETY_ARMED)
                self._throttles = message.controls[:_MOTORS]
                self._is_in_step = is_in_step
                self._is_waiting = False
            case "COMMAND_LONG" if message.command == SET_MESSAGE_INTERVAL and round(message.param1) == _HIL_STATE:
                every_us = message.param2
                self._truth_every_s = every_us * 1e-6 if every_us > 0.0 else None

    def step(self) -> bytes:
        """Advances by one step; returns the messages for PX4.

        HIL_SENSOR comes last because it advances PX4's time; all other new data belong before it.
        """
        body = self._body
        self.steps += 1
        messages: list[MavlinkMessage] = []
        updated = self._sort(body.step(self._throttles), messages)
        if (self.steps - 1) % _HEARTBEAT_STEPS == 0:
            messages += self._signs_of_life()
        if self._truth_every_s is not None and body.now_s >= self._truth_due_s - 1e-6:
            self._truth_due_s = max(self._truth_due_s + self._truth_every_s, body.now_s)
            messages.append(hil.hil_state(body.truth()))
        imu = self._imu or _STILL
        messages.append(hil.hil_sensor(body.now_s, imu, self._magnetometer, self._barometer, updated))
        self._is_waiting = self._is_in_step and bool(updated & hil.GYRO)  # PX4 controls when there is a turn rate
        return b"".join(map(self._encoder.encode, messages))

    def _sort(self, readings: Sequence[Reading], messages: list[MavlinkMessage]) -> int:
        """Keeps readings or converts them to messages; returns the new fields of HIL_SENSOR as bits."""
        updated = 0
        for reading in readings:
            match reading:
                case ImuReading():
                    self._imu = reading
                    updated |= hil.ACCELEROMETER | hil.GYRO
                case MagnetometerReading():
                    self._magnetometer = reading
                    updated |= hil.MAGNETOMETER
                case BarometerReading():
                    self._barometer = reading
                    updated |= hil.BAROMETER
                case FixReading() if self.steps > 1:  # PX4 has no time before the first HIL_SENSOR
                    messages.append(hil.hil_gps(reading, self._utc_offset_s))
                case RangeReading() if self.steps > 1:
                    messages.append(hil.distance_sensor(reading))
        return updated

    def _signs_of_life(self) -> list[MavlinkMessage]:
        now_s = self._body.now_s
        return [
            codec.message(
                "HEARTBEAT",
                type=codec.enums.MAV_TYPE_GENERIC,
                autopilot=codec.enums.MAV_AUTOPILOT_INVALID,
                system_status=codec.enums.MAV_STATE_ACTIVE,
                mavlink_version=3,
            ),
            codec.message(
                "SYSTEM_TIME",
                time_unix_usec=round((now_s + self._utc_offset_s) * 1e6),
                time_boot_ms=round(now_s * 1e3),
            ),
        ]
