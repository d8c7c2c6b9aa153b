"""The whole autopilot without I/O: readings in, throttles out, 200 times a second."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final

from gloc3.frames import GRAVITY_M_S2, GeoPoint, Quaternion
from gloc3_sitl.autopilot.airframe import PELICAN, Airframe
from gloc3_sitl.autopilot.authorization import Authorization
from gloc3_sitl.autopilot.calibration import Calibration
from gloc3_sitl.autopilot.commander import Commander
from gloc3_sitl.autopilot.control.attitude import AttitudeController, attitude_for
from gloc3_sitl.autopilot.control.mixer import IDLE, Mixer, Throttles
from gloc3_sitl.autopilot.control.position import PositionController
from gloc3_sitl.autopilot.control.rates import RateController
from gloc3_sitl.autopilot.control.setpoint import LANDED, AttitudeSetpoint, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft, Say
from gloc3_sitl.autopilot.estimator.estimator import Estimator
from gloc3_sitl.autopilot.estimator.sources import Fix
from gloc3_sitl.autopilot.failsafe import Failsafes
from gloc3_sitl.autopilot.flight_log import FlightLogger
from gloc3_sitl.autopilot.modes import Style
from gloc3_sitl.autopilot.parameters import ParameterStore
from gloc3_sitl.autopilot.pilot import Pilot
from gloc3_sitl.autopilot.plans import Plans
from gloc3_sitl.autopilot.sources import ardupilot_sources, px4_sources
from gloc3_sitl.autopilot.surroundings import Nowhere, Surroundings
from gloc3_sitl.autopilot.tuning import Tuning
from gloc3_sitl.sensors.readings import (
    BarometerReading,
    BatteryReading,
    FixReading,
    ImuReading,
    MagnetometerReading,
    RangeReading,
    Reading,
)

STEP_S: Final = 0.005
"""Period of the inner loops."""
_OUTER: Final = 4
"""Inner periods in one of the outer loops: 20 ms."""
_IDLE_THRUST: Final = 0.03
"""Collective thrust of motors that idle."""
_THRUST_RISE_PER_S: Final = 1.2
"""How fast the collective may grow after standing on the ground."""


class Autopilot:
    """Estimator, decisions and control loops of one vehicle in one of the styles.

    Args:
        style: PX4's or ArduPilot's.
        say: told each sentence for the ground.
        airframe: what it flies.
        declination_rad: of the magnetic field at home, which a real one has in a table.
        surroundings: the simulation that it is in.
        before: itself before a reboot; what stands on its memory card outlives that.
    """

    def __init__(
        self,
        style: Style,
        say: Say,
        *,
        airframe: Airframe = PELICAN,
        declination_rad: float = 0.0,
        surroundings: Surroundings | None = None,
        before: "Autopilot | None" = None,
    ) -> None:
        self.style: Final = style
        self.surroundings: Final = surroundings or Nowhere()
        self.airframe: Final = airframe
        self.tuning: Final = Tuning()
        self.parameters: Final = ParameterStore(style.parameters, self.tuning, style.derive)
        if before is not None:
            self.parameters.take_over(before.parameters)
        self.estimator: Final = Estimator(declination_rad=declination_rad)
        self.pilot: Final[Pilot] = Pilot() if before is None else before.pilot
        self.plans: Final[Plans] = Plans() if before is None else before.plans
        self.craft: Final = Craft(self.estimator, self.tuning, self.pilot, self.plans, say)
        self.craft.first_item = 1 if style.mission_keeps_home else 0
        if before is not None:
            first = self.craft.first_item
            self.craft.mission.on_upload(self.plans.mission_count, len(self.plans.mission) > first, first)
        self.commander: Final = Commander(
            self.craft,
            style,
            Authorization(self.craft, self.parameters.__getitem__ if "COM_ARM_AUTH_REQ" in self.parameters else None),
        )
        self.calibration: Final = Calibration(self.craft)
        self.failsafes: Final = Failsafes(self.commander)
        self.takes_odometry = True
        """Whether odometry from outside still arrives."""
        self.servo_us: Final[dict[int, int]] = {}
        """Pulse lengths of the outputs that somebody has set, by number from 1."""
        self.source_set = 1
        """ArduPilot's set of sources in use."""
        self.parameters.on_change.append(self._parameter_changed)
        self.choose_sources()
        self.battery: BatteryReading | None = None
        self.range: RangeReading | None = None
        self.barometer: BarometerReading | None = None
        self.magnetometer: MagnetometerReading | None = None
        self.imu: ImuReading | None = None
        self.throttles: Throttles = IDLE
        self.thrust = 0.0
        """Collective thrust asked for, as a fraction of full."""
        self.on_outer: list[Callable[[float], None]] = []
        self.imu_recent: Final[deque[ImuReading]] = deque(maxlen=_OUTER)
        """Those of the outer period that ends now, oldest first."""
        """Called with the time after each outer period."""
        self.logger: Final[FlightLogger] = FlightLogger(self, () if before is None else before.logger.logs)
        self._mixer = Mixer(airframe.thrust_curve)
        self._rates = RateController(airframe, STEP_S)
        self._attitude = AttitudeController(airframe.attitude_p)
        self._position = PositionController(self.tuning.gains)
        self._wanted_attitude = self.estimator.inertial.ned_from_frd
        self._wanted_rate = (0.0, 0.0, 0.0)
        self._yaw_rate = 0.0
        self._flies_rates = False
        self._is_idle = True
        self._ceiling = 0.0
        self._hold_yaw_rad = 0.0
        self._imu_s = -1.0
        self._count = 0
        self.utc_offset_s = 0.0
        """Seconds since 1970 at boot, where somebody has told; 0 otherwise."""
        self._take: dict[type, Callable[[Any], None]] = {
            FixReading: self._take_fix,
            BarometerReading: self._take_barometer,
            MagnetometerReading: self._take_magnetometer,
            RangeReading: self._take_range,
            BatteryReading: self._take_battery,
        }

    @property
    def utc_us(self) -> int:
        """Microseconds since 1970; 0 where that is not known."""
        return int((self.utc_offset_s + self.craft.now_s) * 1e6) if self.utc_offset_s else 0

    def choose_sources(self) -> None:
        """Has the estimator use what the parameters say."""
        ask = self.parameters.__getitem__
        is_px4 = "EKF2_EN" in self.parameters
        self.estimator.sources = px4_sources(ask) if is_px4 else ardupilot_sources(ask, self.source_set)

    def _parameter_changed(self, name: str, value: float) -> None:
        del value
        if name.startswith(("EKF2_", "EK3_SRC")):
            self.choose_sources()

    @property
    def wanted_attitude(self) -> Quaternion:
        """What the attitude loop is asked for, `ned_from_frd`."""
        return self._wanted_attitude

    # -- the inner loops --------------------------------------------------------------------------------------------

    def step(self, readings: Sequence[Reading], now_s: float) -> Throttles:
        """Takes in what the sensors say, and gives the throttles for the next 5 ms."""
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
                self._take[type(reading)](reading)
        self._count += 1
        if self._count >= _OUTER:
            self._count = 0
            self._outer(now_s)
        if not self.craft.is_armed:
            self.throttles = IDLE
            return IDLE
        mixer = self._mixer
        inertial = estimator.inertial
        if self._is_idle:
            self._rates.reset()
            self.throttles = mixer.mix(_IDLE_THRUST, 0.0, 0.0, 0.0)
            return self.throttles
        if self._flies_rates:
            wanted = self._wanted_rate
        else:
            wanted = self._attitude.update(inertial.ned_from_frd, self._wanted_attitude, self._yaw_rate)
        roll, pitch, yaw = self._rates.update(wanted, inertial.rate_frd_rad_s, mixer.is_saturated)
        self.throttles = mixer.mix(self.thrust, roll, pitch, yaw)
        return self.throttles

    # -- the outer loops --------------------------------------------------------------------------------------------

    def _outer(self, now_s: float) -> None:
        """50 times a second: estimate, failsafes, mode, position."""
        craft, estimator = self.craft, self.estimator
        estimator.is_landed = craft.touchdown.is_landed
        estimator.tick(now_s)
        self.failsafes.tick()
        setpoint = self.commander.tick()
        craft.last_setpoint = setpoint
        self._detect_touchdown(setpoint, now_s)
        self._follow(setpoint)
        self.calibration.tick(now_s)
        for listener in self.on_outer:
            listener(now_s)

    def _follow(self, setpoint: Setpoint) -> None:
        """Turns a setpoint into an attitude (or rates) and a thrust."""
        tuning = self.tuning
        self._attitude.gain = (tuning.attitude_p_roll, tuning.attitude_p_pitch, tuning.attitude_p_yaw)
        inertial = self.estimator.inertial
        if setpoint is LANDED:
            self._is_idle = True
            self._ceiling = _IDLE_THRUST
            self.thrust = _IDLE_THRUST if self.craft.is_armed else 0.0
            self._position.reset()
            self._wanted_attitude = inertial.ned_from_frd
            self._hold_yaw_rad = self.estimator.yaw_rad
            return
        self._is_idle = False
        if self._ceiling < 1.0:
            self._ceiling += _THRUST_RISE_PER_S * STEP_S * _OUTER
        if isinstance(setpoint, AttitudeSetpoint):
            self.thrust = min(setpoint.thrust, self._ceiling)
            self._flies_rates = setpoint.ned_from_frd is None
            if setpoint.ned_from_frd is None:
                self._wanted_rate = setpoint.rate_frd_rad_s
            else:
                self._wanted_attitude = setpoint.ned_from_frd
                self._yaw_rate = setpoint.rate_frd_rad_s[2]
            self._hold_yaw_rad = self.estimator.yaw_rad
            return
        self._flies_rates = False
        self._follow_motion(setpoint)

    def _follow_motion(self, setpoint: MotionSetpoint) -> None:
        inertial, tuning = self.estimator.inertial, self.tuning
        if setpoint.yaw_rad == setpoint.yaw_rad:
            self._hold_yaw_rad = setpoint.yaw_rad
        elif setpoint.yaw_rate_rad_s:
            self._hold_yaw_rad += setpoint.yaw_rate_rad_s * STEP_S * _OUTER
        self._yaw_rate = setpoint.yaw_rate_rad_s
        force = self._position.update(
            setpoint,
            inertial.position_ned_m,
            inertial.velocity_ned_m_s,
            inertial.acceleration_ned_m_s2,
            tuning.hover_thrust,
            STEP_S * _OUTER,
        )
        self._wanted_attitude = attitude_for(force, self._hold_yaw_rad)
        # Only the part of the force along the body's own axis can be given before the vehicle has turned.
        w, x, y, z = inertial.ned_from_frd
        along = (
            force[0] * 2.0 * (x * z + w * y)
            + force[1] * 2.0 * (y * z - w * x)
            + force[2] * (1.0 - 2.0 * (x * x + y * y))
        )
        thrust = -along / GRAVITY_M_S2 * tuning.hover_thrust
        thrust = max(thrust, tuning.gains.thrust_min)
        self.thrust = min(thrust, self._ceiling)

    def _detect_touchdown(self, setpoint: Setpoint, now_s: float) -> None:
        craft, inertial = self.craft, self.estimator.inertial
        if isinstance(setpoint, AttitudeSetpoint):
            wants_up = setpoint.thrust > self.tuning.hover_thrust
            wants_down = setpoint.thrust < 0.5 * self.tuning.hover_thrust
        else:
            wanted_down, wanted_speed = setpoint.position_ned_m[2], setpoint.velocity_ned_m_s[2]
            off = wanted_down - inertial.position_ned_m[2] if wanted_down == wanted_down else 0.0
            speed = wanted_speed if wanted_speed == wanted_speed else 0.0
            wants_up = off < -0.05 or speed < -0.05
            wants_down = setpoint is LANDED or off > 0.05 or speed > 0.1
        is_range_fresh = now_s - self.estimator.range_t_s < 0.3
        mount = self.range.mount_height_m if self.range is not None else 0.0
        craft.touchdown.update(
            now_s,
            is_armed=craft.is_armed,
            wants_down=wants_down,
            wants_up=wants_up,
            thrust_share=self.thrust / self.tuning.hover_thrust,
            speed_down_m_s=inertial.velocity_ned_m_s[2],
            height_m=self.estimator.height_above_ground_m - mount if is_range_fresh else float("nan"),
        )

    # -- readings ---------------------------------------------------------------------------------------------------

    def _take_fix(self, reading: FixReading) -> None:
        self.estimator.take_fix(
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

    def _take_barometer(self, reading: BarometerReading) -> None:
        self.barometer = reading
        self.estimator.take_barometer(reading.altitude_m, self.craft.now_s)

    def _take_magnetometer(self, reading: MagnetometerReading) -> None:
        self.magnetometer = reading
        self.estimator.take_magnetometer(reading.field_frd_tesla, self.craft.now_s)

    def _take_range(self, reading: RangeReading) -> None:
        self.range = reading
        self.estimator.take_range(reading.distance_m if reading.is_valid else None, self.craft.now_s)

    def _take_battery(self, reading: BatteryReading) -> None:
        self.battery = reading
        self.commander.battery_share = reading.remaining
