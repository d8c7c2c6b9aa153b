"""The whole autopilot without I/O: readings in, outputs to motors out, 200 times a second."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final

from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.autopilot.arming import Authorization
from gloc3_sitl.autopilot.commander import Commander
from gloc3_sitl.autopilot.control.control import ControlLoops, Outputs
from gloc3_sitl.autopilot.control.motor_test import MotorTest
from gloc3_sitl.autopilot.craft import Craft, Report
from gloc3_sitl.autopilot.estimator.estimator import Estimator
from gloc3_sitl.autopilot.estimator.sources import AidingSource, Fix
from gloc3_sitl.autopilot.failsafe import FailsafeMonitor
from gloc3_sitl.autopilot.logs.flight_log import FlightLogger
from gloc3_sitl.autopilot.logs.records import LogHeader, LogRecord
from gloc3_sitl.autopilot.mavlink.calibration import CalibrationRun
from gloc3_sitl.autopilot.modes import StyleTables
from gloc3_sitl.autopilot.parameters import ParameterKind, ParameterStore
from gloc3_sitl.autopilot.periods import OUTER_STEPS, STEP_S
from gloc3_sitl.autopilot.pilot import Pilot
from gloc3_sitl.autopilot.plans import StoredPlans
from gloc3_sitl.autopilot.sources import ardupilot_sources, px4_sources
from gloc3_sitl.autopilot.surroundings import Nowhere, SimulatedPayload, Surroundings
from gloc3_sitl.autopilot.tuning import Tuning
from gloc3_sitl.autopilot.vehicle_class import MULTIROTOR, AutopilotClass
from gloc3_sitl.sensors.readings import (
    AirspeedReading,
    BarometerReading,
    BatteryReading,
    FixReading,
    ImuReading,
    LeakReading,
    MagnetometerReading,
    RangeReading,
    Reading,
)

_ESCS_AT_START: Final = 3.0
"""ESC_CALIBRATION."""


class Autopilot:
    """Estimator, decisions and control loops of one vehicle in one of the styles.

    Args:
        style: PX4's or ArduPilot's.
        report: called with each status text.
        vehicle: the controlled vehicle.
        declination_rad: magnetic declination at home (a real autopilot has a table).
        surroundings: the simulation around it.
        before: the instance before a reboot, whose memory card is kept.
    """

    accepts_odometry = True
    """Whether odometry from outside still arrives."""
    source_set = 1
    """ArduPilot's set of sources in use."""
    utc_offset_s = 0.0
    """Seconds since 1970 at boot; 0 while unknown."""
    battery: BatteryReading | None = None
    range: RangeReading | None = None
    barometer: BarometerReading | None = None
    magnetometer: MagnetometerReading | None = None
    imu: ImuReading | None = None
    _imu_s = -1.0
    _count = 0

    def __init__(
        self,
        style: StyleTables,
        report: Report,
        *,
        vehicle: AutopilotClass = MULTIROTOR,
        declination_rad: float = 0.0,
        surroundings: Surroundings | None = None,
        before: "Autopilot | None" = None,
    ) -> None:
        self.style: Final = style
        self.surroundings: Final = surroundings or Nowhere()
        self.vehicle: Final = vehicle
        self.tuning: Final = Tuning()
        self.parameters: Final = ParameterStore(style.parameters, self.tuning, style.derive)
        self.estimator: Final = Estimator(declination_rad=declination_rad, floats=vehicle.floats)
        self.pilot: Final[Pilot] = Pilot() if before is None else before.pilot
        self.plans: Final[StoredPlans] = StoredPlans() if before is None else before.plans
        self.craft: Final = Craft(self.estimator, self.tuning, self.pilot, self.plans, report)
        self.craft.first_item = 1 if style.mission_keeps_home else 0
        if before is not None:
            self._continue(before)
        self.control: Final[ControlLoops] = vehicle.control(self.craft)
        self._stopped: Final = self.control.stopped
        request = self.parameters.__getitem__ if "COM_ARM_AUTH_REQ" in self.parameters else None
        self.commander: Final = Commander(self.craft, style, Authorization(self.craft, request))
        self.calibration: Final = CalibrationRun(self.craft, lambda: self.commander.battery_share > 0.0)
        self.failsafes: Final = FailsafeMonitor(self.commander)
        self.payload: Final = SimulatedPayload()
        """What its commands have done to grippers, relays and winches."""
        self.servo_us: Final[dict[int, int]] = {}
        """Pulse lengths set from outside, by output number from 1."""
        self.parameters.on_change.append(self._parameter_changed)
        self.choose_sources()
        self.others: dict[type, Any] = {}
        """The newest reading of each of the sensors that only some vehicles have, by its type."""
        self.motor_test: Final = MotorTest()
        self.outputs: Outputs = self._stopped
        """Of the last period, as the vehicle's body takes them."""
        self.imu_recent: Final[deque[ImuReading]] = deque(maxlen=OUTER_STEPS)
        """Those of the outer period that ends now, oldest first."""
        self.logger: Final[FlightLogger] = FlightLogger(
            self, style.make_log, () if before is None else before.logger.logs
        )
        self.on_outer: list[Callable[[float], None]] = [self.logger.tick]
        """Called with the time after each outer period."""
        self._use: Final = self._receivers()

    def _continue(self, before: "Autopilot") -> None:
        """Restores the memory card after a reboot."""
        self.parameters.load(before.parameters)
        if "ESC_CALIBRATION" in self.parameters and self.parameters["ESC_CALIBRATION"] == _ESCS_AT_START:
            self.parameters.set("ESC_CALIBRATION", 0.0)
            self.craft.send_text(Severity.INFO, "ESC calibration: Auto calibration")
        self.craft.mission.on_upload(self.plans.mission_count, len(self.plans.mission), self.craft.first_item)

    def _receivers(self) -> dict[type, Callable[[Any], None]]:
        """What becomes of each kind of reading, but for the IMU's."""
        return {
            FixReading: self._use_fix,
            BarometerReading: self._use_barometer,
            MagnetometerReading: self._use_magnetometer,
            RangeReading: self._use_range,
            BatteryReading: self._use_battery,
            LeakReading: self._use_leak,
            AirspeedReading: self._use_airspeed,
        }

    @property
    def utc_us(self) -> int:
        """Microseconds since 1970; 0 where that is not known."""
        return int((self.utc_offset_s + self.craft.now_s) * 1e6) if self.utc_offset_s else 0

    @property
    def is_armed(self) -> bool:
        """Whether the motors turn."""
        return self.craft.is_armed

    def log_header(self, now_s: float) -> LogHeader:
        """What a log begins with."""
        parameters = {name: self.parameters[name] for name in self.parameters}
        whole = frozenset(row.name for row in self.parameters.rows.values() if row.kind is not ParameterKind.REAL32)
        vehicle = self.vehicle
        return LogHeader(
            boot_s=now_s,
            parameters=parameters,
            whole=whole,
            version=self.style.version,
            mav_type=vehicle.mav_type,
            output_numbers=vehicle.output_numbers,
            neutral_us=vehicle.neutral_us,
            span_us=vehicle.span_us,
        )

    def log_record(self, now_s: float, texts: Sequence[str]) -> LogRecord:
        """The next record of a log, with the status texts since the previous one."""
        inertial, mode = self.estimator.inertial, self.commander.mode
        return LogRecord(
            boot_s=now_s,
            mode=mode.name,
            custom_mode=mode.custom_mode,
            position_ned_m=inertial.position_ned_m,
            velocity_ned_m_s=inertial.velocity_ned_m_s,
            ned_from_frd=inertial.ned_from_frd,
            outputs=tuple(self.outputs),
            is_armed=self.is_armed,
            is_landed=self.craft.is_landed,
            failsafe=self.failsafes.cause,
            battery=self.commander.battery_share,
            texts=texts,
        )

    def choose_sources(self) -> None:
        """Sets the estimator's sources from the parameters."""
        request = self.parameters.__getitem__
        is_px4 = "EKF2_EN" in self.parameters
        self.estimator.sources = px4_sources(request) if is_px4 else ardupilot_sources(request, self.source_set)
        floats_at_m = self.tuning.floats_at_m
        if floats_at_m == floats_at_m:
            self.estimator.sources |= AidingSource.DEPTH
            self.estimator.boot_down_m = floats_at_m

    def _parameter_changed(self, name: str, value: float) -> None:
        del value
        if name.startswith(("EKF2_", "EK3_SRC")):
            self.choose_sources()

    # -- the inner loops --------------------------------------------------------------------------------------------

    def step(self, readings: Sequence[Reading], now_s: float) -> Outputs:
        """Handles sensor readings and returns the outputs for the next 5 ms."""
        self.craft.now_s = now_s
        estimator = self.estimator
        for reading in readings:
            if type(reading) is ImuReading:
                t_s = reading.t_s
                dt_s = t_s - self._imu_s
                self._imu_s = t_s
                self.imu = reading
                self.imu_recent.append(reading)
                estimator.imu(
                    reading.specific_force_frd_m_s2,
                    reading.rate_frd_rad_s,
                    t_s,
                    dt_s if 0.0 < dt_s < 0.02 else STEP_S,
                )
            else:
                self._use.get(type(reading), self._use_other)(reading)
        self._count += 1
        if self._count >= OUTER_STEPS:
            self._count = 0
            self._outer(now_s)
        is_armed = self.craft.is_armed
        self.outputs = outputs = self.control.outputs() if is_armed else self.motor_test.outputs(self._stopped, now_s)
        return outputs

    # -- the outer loops --------------------------------------------------------------------------------------------

    def _outer(self, now_s: float) -> None:
        """50 times a second: estimate, failsafes, mode, position."""
        craft, estimator = self.craft, self.estimator
        estimator.is_landed = craft.touchdown.is_landed
        estimator.tick(now_s)
        self.failsafes.tick()
        setpoint = self.commander.tick()
        craft.last_setpoint = setpoint
        self.control.follow(setpoint)
        self.calibration.tick(now_s)
        for listener in self.on_outer:
            listener(now_s)
        self.imu_recent.clear()

    # -- readings ---------------------------------------------------------------------------------------------------

    def _use_fix(self, reading: FixReading) -> None:
        self.estimator.use_fix(
            Fix(
                t_s=reading.t_s,
                place=GeoPoint(reading.latitude_deg, reading.longitude_deg, reading.altitude_m),
                velocity_ned_m_s=reading.velocity_ned_m_s,
                horizontal_accuracy_m=reading.horizontal_accuracy_m,
                vertical_accuracy_m=reading.vertical_accuracy_m,
                speed_accuracy_m_s=reading.speed_accuracy_m_s,
                fix_type=int(reading.kind),
                satellites=reading.satellites,
            ),
            self.craft.now_s,
        )

    def _use_barometer(self, reading: BarometerReading) -> None:
        self.barometer = reading
        self.estimator.use_barometer(reading.altitude_m, self.craft.now_s)

    def _use_magnetometer(self, reading: MagnetometerReading) -> None:
        self.magnetometer = reading
        self.estimator.use_magnetometer(reading.field_frd_tesla, self.craft.now_s)

    def _use_range(self, reading: RangeReading) -> None:
        self.range = reading
        self.craft.range_mount_m = reading.mount_height_m
        self.estimator.use_range(reading.distance_m if reading.is_valid else None, self.craft.now_s)

    def _use_leak(self, reading: LeakReading) -> None:
        self.craft.is_leaking = reading.is_wet

    def _use_airspeed(self, reading: AirspeedReading) -> None:
        self.craft.airspeed_m_s = reading.airspeed_m_s

    def _use_other(self, reading: Reading) -> None:
        self.others[type(reading)] = reading

    def _use_battery(self, reading: BatteryReading) -> None:
        self.battery = reading
        self.commander.battery_share, self.commander.battery_v = reading.remaining, reading.voltage_v
