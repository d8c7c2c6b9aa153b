"""Telemetry of outputs, sticks, air data and ground truth."""

from math import hypot, nan
from typing import TYPE_CHECKING, Final

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import MavlinkMessage
from gloc3.messages.frames import rotate_back
from gloc3_sitl.autopilot.behaviours.orbit import Orbit
from gloc3_sitl.autopilot.mavlink.units import boot_ms, microseconds, milli_g, short
from gloc3_sitl.sensors.readings import WheelReading

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.autopilot import Autopilot

_OUTPUTS: Final = 16
_ACTUATORS: Final = 32
_UNKNOWN: Final = 65535
_BODY_FRD, _LOCAL_NED = 12, 1
_AUTOPILOT_ESTIMATOR: Final = 8
_CHANNELS: Final = 18
_WHEELS: Final = 16


def servo_output(autopilot: "Autopilot") -> MavlinkMessage:
    """SERVO_OUTPUT_RAW: motors and control surfaces, and outputs set from outside."""
    pulses = dict(autopilot.servo_us)
    vehicle = autopilot.vehicle
    for number, output in zip(vehicle.output_numbers, autopilot.outputs, strict=True):
        pulses[number] = round(vehicle.neutral_us + vehicle.span_us * output)
    fields = {f"servo{number}_raw": pulses.get(number, 0) for number in range(1, _OUTPUTS + 1)}
    return message("SERVO_OUTPUT_RAW", time_usec=microseconds(autopilot) & 0xFFFFFFFF, port=0, **fields)


def actuator_output(autopilot: "Autopilot") -> MavlinkMessage:
    """ACTUATOR_OUTPUT_STATUS: the outputs to motors and rudders."""
    values = autopilot.outputs
    return message(
        "ACTUATOR_OUTPUT_STATUS",
        time_usec=microseconds(autopilot),
        active=(1 << len(values)) - 1,
        actuator=(*values, *(0.0,) * (_ACTUATORS - len(values))),
    )


def wheel_distance(autopilot: "Autopilot") -> MavlinkMessage | None:
    """WHEEL_DISTANCE: left and right; None without encoders."""
    reading = autopilot.others.get(WheelReading)
    if reading is None:
        return None
    distances = (*reading.distances_m, *(0.0,) * (_WHEELS - len(reading.distances_m)))
    return message(
        "WHEEL_DISTANCE", time_usec=microseconds(autopilot), count=len(reading.distances_m), distance=distances
    )


def rc_channels(autopilot: "Autopilot") -> MavlinkMessage | None:
    """RC_CHANNELS: roll, pitch, throttle, yaw; None until a transmitter was heard."""
    pilot = autopilot.pilot
    if pilot.last_seen_s < 0.0:
        return None
    sticks = (pilot.roll, pilot.pitch, 2.0 * pilot.throttle - 1.0, pilot.yaw)
    pulses = (*(round(1500 + 500 * stick) for stick in sticks), *(_UNKNOWN,) * (_CHANNELS - len(sticks)))
    return message(
        "RC_CHANNELS",
        time_boot_ms=boot_ms(autopilot),
        chancount=len(sticks),
        rssi=254 if autopilot.commander.has_pilot else 0,
        **{f"chan{number}_raw": pulse for number, pulse in enumerate(pulses, start=1)},
    )


def scaled_pressure(autopilot: "Autopilot") -> MavlinkMessage | None:
    """SCALED_PRESSURE; the temperature is that of the standard atmosphere."""
    barometer = autopilot.barometer
    if barometer is None:
        return None
    return message(
        "SCALED_PRESSURE",
        time_boot_ms=int(barometer.t_s * 1e3),
        press_abs=barometer.pressure_pa / 100.0,
        press_diff=0.0,
        temperature=short(100.0 * (15.0 - 0.0065 * barometer.altitude_m)),
    )


def raw_imu(autopilot: "Autopilot") -> MavlinkMessage | None:
    """RAW_IMU: as SCALED_IMU, with microseconds, which is what ArduPilot sends."""
    imu, magnetometer = autopilot.imu, autopilot.magnetometer
    if imu is None:
        return None
    field = (0.0, 0.0, 0.0) if magnetometer is None else magnetometer.field_frd_tesla
    fx, fy, fz = (milli_g(value) for value in imu.specific_force_frd_m_s2)
    p, q, r = (short(value * 1e3) for value in imu.rate_frd_rad_s)
    mx, my, mz = (short(value * 1e7) for value in field)
    values = {"xacc": fx, "yacc": fy, "zacc": fz, "xgyro": p, "ygyro": q, "zgyro": r}
    return message("RAW_IMU", time_usec=int(imu.t_s * 1e6), **values, xmag=mx, ymag=my, zmag=mz)


def odometry_out(autopilot: "Autopilot") -> MavlinkMessage | None:
    """ODOMETRY: the estimate in the local NED frame, with velocity and rates in the body's; None without a position."""
    estimator = autopilot.estimator
    if not estimator.is_position_good(autopilot.craft.now_s):
        return None
    inertial = estimator.inertial
    n, e, d = inertial.position_ned_m
    vx, vy, vz = rotate_back(inertial.ned_from_frd, inertial.velocity_ned_m_s)
    p, q, r = inertial.rate_frd_rad_s
    pose, speed = [nan] * 21, [nan] * 21
    pose[0] = pose[6] = estimator.horizontal_deviation_m**2
    pose[11] = estimator.vertical_deviation_m**2
    return message(
        "ODOMETRY",
        time_usec=microseconds(autopilot),
        frame_id=_LOCAL_NED,
        child_frame_id=_BODY_FRD,
        x=n,
        y=e,
        z=d,
        q=inertial.ned_from_frd,
        vx=vx,
        vy=vy,
        vz=vz,
        rollspeed=p,
        pitchspeed=q,
        yawspeed=r,
        pose_covariance=tuple(pose),
        velocity_covariance=tuple(speed),
        reset_counter=estimator.reset_count & 0xFF,
        estimator_type=_AUTOPILOT_ESTIMATOR,
    )


def ground_truth(autopilot: "Autopilot") -> MavlinkMessage | None:
    """HIL_STATE_QUATERNION: the vehicle's true state, which only a simulation knows."""
    try:
        truth = autopilot.surroundings.truth()
    except LookupError:
        return None
    vn, ve, vd = (short(value * 100.0) for value in truth.velocity_ned_m_s)
    fx, fy, fz = (milli_g(value) for value in truth.specific_force_frd_m_s2)
    p, q, r = truth.rate_frd_rad_s
    airspeed = hypot(*(own - air for own, air in zip(truth.velocity_ned_m_s, truth.wind_ned_m_s, strict=True)))
    return message(
        "HIL_STATE_QUATERNION",
        time_usec=microseconds(autopilot),
        attitude_quaternion=truth.attitude_wxyz,
        rollspeed=p,
        pitchspeed=q,
        yawspeed=r,
        lat=round(truth.latitude_deg * 1e7),
        lon=round(truth.longitude_deg * 1e7),
        alt=round(truth.altitude_m * 1e3),
        vx=vn,
        vy=ve,
        vz=vd,
        ind_airspeed=round(airspeed * 100.0),
        true_airspeed=round(airspeed * 100.0),
        xacc=fx,
        yacc=fy,
        zacc=fz,
    )


def orbit_status(autopilot: "Autopilot") -> MavlinkMessage | None:
    """ORBIT_EXECUTION_STATUS, in an orbit."""
    activity, origin = autopilot.commander.activity, autopilot.estimator.origin
    if not isinstance(activity, Orbit) or origin is None:
        return None
    circle = activity.circle
    centre = origin.geo_from_ned(circle.centre_ned_m)
    return message(
        "ORBIT_EXECUTION_STATUS",
        time_usec=microseconds(autopilot),
        radius=circle.radius_m if circle.speed_m_s >= 0.0 else -circle.radius_m,
        frame=5,
        x=round(centre.latitude_deg * 1e7),
        y=round(centre.longitude_deg * 1e7),
        z=centre.altitude_m,
    )


def flight_information(autopilot: "Autopilot") -> MavlinkMessage:
    """FLIGHT_INFORMATION: when it was armed last, by the clock where that is known."""
    commander = autopilot.commander
    since_us = max(0, int((autopilot.utc_offset_s + commander.armed_s) * 1e6)) if commander.armed_s > 0.0 else 0
    return message(
        "FLIGHT_INFORMATION",
        time_boot_ms=boot_ms(autopilot),
        arming_time_utc=since_us if autopilot.craft.is_armed else 0,
        takeoff_time_utc=since_us if commander.has_flown and autopilot.craft.is_armed else 0,
        flight_uuid=autopilot.logger.count,
    )
