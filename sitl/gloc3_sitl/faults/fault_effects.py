"""Effects of the kinds of faults on a flight: text form, start and end of each."""

from collections.abc import Mapping
from math import cos, radians, sin
from typing import Any, Final

from gloc3.errors import Refused, nearest
from gloc3_sitl.autopilot.modes import Behaviour, StyleTables
from gloc3_sitl.faults.computer_faults import COMPUTER
from gloc3_sitl.faults.device_faults import ALL, CAMERA, DEPTH, LASER, SIZES, DeviceFault
from gloc3_sitl.faults.effect import Effect, nothing
from gloc3_sitl.faults.fault_form import Ended, FaultForm, Parsed
from gloc3_sitl.faults.link_faults import LINKS
from gloc3_sitl.faults.operator_faults import OPERATOR
from gloc3_sitl.faults.topic_faults import TOPIC_WORDS, check_topic, corrupt_topic
from gloc3_sitl.firmware.in_step import SENSORS as FLOWN_BY
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.sim_devices import NoDevice, SimDepthCamera, SimDvl, SimEstimator, SimLaser, SimLidar, SimProbe
from gloc3_sitl.flight.sim_imu import IMU, SimImu
from gloc3_sitl.flight.sim_rig import SimDevice
from gloc3_sitl.physics.wind import gusty
from gloc3_sitl.sensors.sensor import SIZED, FaultMode
from gloc3_sitl.vehicles.simulator import Simulator
from gloc3_sitl.vehicles.table import vehicle_of

SCALED: Final = ("height", "wheels")
"""Those that can be wrong by a share."""
SENSORS: Final = ("imu", "barometer", "magnetometer", "height", "fix", "battery", "wheels", "leak")
AWAY_S: Final = 2.0
"""How long a restarted onboard process is away."""


# --- air, water, battery, motors, sensors ---


def _blow(flight: Flight, given: Parsed, _: bool) -> Ended:
    before = flight.simulator.wind
    flight.simulator.wind = gusty(given.number, from_deg=270.0 if given.size is None else given.size)

    def calm_down() -> None:
        flight.simulator.wind = before

    return calm_down


def _check_water(flight: Flight, _: Parsed) -> None:
    if not hasattr(_body(flight), "current_ned_m_s"):
        raise Refused(f"the {vehicle_of(flight.platform)} is not in the water")


def _body(flight: Flight) -> Any:
    return getattr(flight.simulator, "body", None)


def _flow(flight: Flight, given: Parsed, _: bool) -> Ended:
    body, towards_rad = _body(flight), radians(0.0 if given.size is None else given.size)
    before = body.current_ned_m_s
    body.current_ned_m_s = (given.number * cos(towards_rad), given.number * sin(towards_rad), 0.0)

    def calm_down() -> None:
        body.current_ned_m_s = before

    return calm_down


def _check_motor(flight: Flight, given: Parsed) -> None:
    if not isinstance(flight.simulator, Simulator):
        raise Refused("the real firmware drives its own motors")
    count = len(flight.simulator.autopilot.control.stopped)
    if not given.target.isdecimal() or not 1 <= int(given.target) <= count:
        raise Refused(f"no motor {given.target!r}; the {vehicle_of(flight.platform)} has 1 to {count}")


def _weaken_motor(flight: Flight, given: Parsed, _: bool) -> Ended:
    assert isinstance(flight.simulator, Simulator)
    left, number = flight.simulator.motors_left, int(given.target)
    left[number] = given.number

    def end() -> None:
        left.pop(number, None)

    return end


def _drain(flight: Flight, given: Parsed, _: bool) -> Ended:
    flight.simulator.sensors.battery.remaining = given.number
    return nothing


def _corrupt_sensor(flight: Flight, given: Parsed, _: bool) -> Ended:
    sensors = flight.simulator.sensors
    sensors.fail(given.target, given.word, given.size)
    return lambda: sensors.repair(given.target)


def _check_sensor(flight: Flight, given: Parsed) -> None:
    if given.target not in SENSORS:
        raise Refused(f"no sensor {given.target!r}; {nearest(given.target, SENSORS)}")
    _check_ours(flight, given.target)
    if not flight.plan.is_firmware and given.target not in flight.simulator.sensors.names:
        raise Refused(f"the {vehicle_of(flight.platform)} has no {given.target}")
    if given.word == FaultMode.SCALED and given.target not in SCALED:
        raise Refused("only the height and the wheel encoders can be scaled")


def _check_battery(flight: Flight, _: Parsed) -> None:
    _check_ours(flight, "battery")


def _check_ours(flight: Flight, sensor: str) -> None:
    flown_by = FLOWN_BY[flight.plan.autopilot] if flight.plan.is_firmware else SENSORS
    if sensor not in flown_by:
        raise Refused(f"the real firmware simulates its own {sensor}; only {' and '.join(flown_by)} can fail here")


# --- components ---


def _check_component(flight: Flight, given: Parsed) -> None:
    names = [row.name for row in flight.platform.components]
    if given.target not in names:
        raise Refused(f"{flight.name} has no component {given.target!r}; {nearest(given.target, names)}")


def _hang(flight: Flight, given: Parsed, _: bool) -> Ended:
    return flight.fault_injector.hang(given.target)


def _slow(flight: Flight, given: Parsed, _: bool) -> Ended:
    return flight.fault_injector.slow(given.target, given.number)


def _crash(flight: Flight, given: Parsed, is_once: bool) -> Ended:
    return flight.fault_injector.crash(given.target, is_once=is_once)


def _leak(flight: Flight, given: Parsed, _: bool) -> Ended:
    return flight.fault_injector.leak(given.target, given.number)


def _restart(flight: Flight, _: Parsed, __: bool) -> Ended:
    flight.process.kill()
    return flight.process.start


# --- the pilot ---

_BEHAVIOURS: Final[Mapping[str, tuple[Behaviour, ...]]] = {
    "manual": (Behaviour.STABILIZE,),
    "altitude": (Behaviour.ALTITUDE,),
    "position": (Behaviour.POSITION,),
    "hold": (Behaviour.HOLD, Behaviour.BRAKE),
    "guided": (Behaviour.STREAMED,),
    "mission": (Behaviour.MISSION,),
    "return": (Behaviour.RETURN,),
    "land": (Behaviour.LAND,),
}
_SWITCHES: Final = ("arm", "disarm", "kill", "on", "off")


def _modes(style: StyleTables) -> dict[str, str]:
    """What a mode may be called, in lower case, to its name in the simulated autopilot: by sense, and in its words."""
    names = {mode.name.lower(): mode.name for mode in style.modes}
    for word, behaviours in _BEHAVIOURS.items():
        fitting = [mode.name for mode in style.modes if mode.behaviour in behaviours]
        names |= {word: fitting[0]} if fitting else {}
    return names


def _check_pilot(flight: Flight, given: Parsed) -> None:
    known = [*_modes(flight.simulator.autopilot.style), *_SWITCHES]
    if given.target.lower() not in known:
        raise Refused(f"unknown pilot action {given.target!r}; {nearest(given.target.lower(), known)}")


def _pilot(flight: Flight, given: Parsed, _: bool) -> Ended:
    pilot, word = flight.simulator.pilot, given.target.lower()
    match word:
        case "arm":
            pilot.arm()
        case "disarm":
            pilot.disarm()
        case "kill":
            pilot.kill()
        case "on":
            pilot.switch_on()
        case "off":
            pilot.switch_off()
        case _:
            pilot.switch_mode(_modes(flight.simulator.autopilot.style)[word])
    return nothing


# --- cameras, scanners, the inertial unit ---

_LIGHTS: Final = ("dark", "twin")
"""Of the vehicle's light: it is off; another shines beside it."""
_DEVICE_WORDS: Final = tuple(dict.fromkeys((*ALL, *CAMERA, *DEPTH, *LASER, *_LIGHTS)))


def devices_of(flight: Flight) -> dict[str, SimDevice | SimImu]:
    """What there is in the flight's world."""
    devices: dict[str, SimDevice | SimImu] = {"imu": flight.process.imu, **flight.rig.devices}
    return {name: device for name, device in devices.items() if not isinstance(device, NoDevice)}


def words_of(name: str, device: SimDevice | SimImu) -> tuple[str, ...]:
    """The faults that a device may have."""
    if isinstance(device, SimImu):
        return IMU
    if isinstance(device, SimLaser):
        return (*ALL, *LASER)
    if isinstance(device, SimDepthCamera):
        return (*ALL, *DEPTH)
    if isinstance(device, SimLidar | SimDvl | SimProbe | SimEstimator):
        return ALL
    return (*ALL, *CAMERA, *(_LIGHTS if name == "tracker_camera" else ()))


def _check_device(flight: Flight, given: Parsed) -> None:
    devices = devices_of(flight)
    if given.target not in devices:
        raise Refused(f"the world has no device {given.target!r}; {nearest(given.target, list(devices))}")
    words = words_of(given.target, devices[given.target])
    if given.word not in words:
        raise Refused(f"{given.word!r} is not a fault of {given.target}; its faults: {', '.join(words)}")


def _corrupt_device(flight: Flight, given: Parsed, _: bool) -> Ended:
    tracker, device = flight.rig.tracker, devices_of(flight)[given.target]
    if given.word in _LIGHTS and tracker is not None:
        tracker.is_lit, tracker.has_twin = given.word != "dark", given.word == "twin"
    elif not isinstance(device, NoDevice):
        device.fault = DeviceFault(given.word, given.size)

    def end() -> None:
        if given.word in _LIGHTS and tracker is not None:
            tracker.is_lit, tracker.has_twin = True, False
        elif not isinstance(device, NoDevice):
            device.fault = None

    return end


_SHARE: Final = (0.0, 1.0)

EFFECTS: Final[Mapping[str, Effect]] = {
    **LINKS,
    "wind": Effect(
        FaultForm(
            text="wind=SPEED[/FROM]",
            does="gusty wind, in m/s, from a bearing (270)",
            bounds=(0.0, 30.0),
            size_of=("",),
        ),
        _blow,
    ),
    "current": Effect(
        FaultForm(
            text="current=SPEED[/TOWARDS]",
            does="the water flows, in m/s, towards a bearing (0)",
            bounds=(0.0, 3.0),
            size_of=("",),
        ),
        _flow,
        _check_water,
    ),
    "motor": Effect(
        FaultForm(
            text="motor:NUMBER[=SHARE]",
            does="this share of a motor's output is left (0)",
            has_target=True,
            bounds=_SHARE,
            default=0.0,
        ),
        _weaken_motor,
        _check_motor,
    ),
    "battery": Effect(
        FaultForm(text="battery=SHARE", does="remaining charge, 0 to 1", bounds=_SHARE, is_event=True),
        _drain,
        _check_battery,
    ),
    "sensor": Effect(
        FaultForm(
            text=f"sensor:NAME={'|'.join(FaultMode)}[/SIZE]",
            does=f"one of the autopilot's sensors: {', '.join(SENSORS)}",
            has_target=True,
            words=tuple(FaultMode),
            size_of=tuple(SIZED),
        ),
        _corrupt_sensor,
        _check_sensor,
    ),
    "device": Effect(
        FaultForm(
            text="device:NAME=WORD[/SIZE]",
            does=f"camera, scanner, imu, probe; WORD: {', '.join(_DEVICE_WORDS)}; sizes: late, old in s, scaled as a share, step in m",
            has_target=True,
            words=_DEVICE_WORDS,
            size_of=tuple(SIZES),
        ),
        _corrupt_device,
        _check_device,
    ),
    "hang": Effect(
        FaultForm(text="hang:COMPONENT", does="its cycle never returns", has_target=True), _hang, _check_component
    ),
    "slow": Effect(
        FaultForm(
            text="slow:COMPONENT=SECONDS",
            does="each of its cycles takes this much longer",
            has_target=True,
            bounds=(0.0, 3600.0),
        ),
        _slow,
        _check_component,
    ),
    "leak": Effect(
        FaultForm(
            text="leak:COMPONENT=SECONDS",
            does="each of its cycles takes this much longer than the one before",
            has_target=True,
            bounds=(0.0, 60.0),
        ),
        _leak,
        _check_component,
    ),
    "crash": Effect(
        FaultForm(
            text="crash:COMPONENT",
            does="its next cycle raises an error; with END every cycle does",
            has_target=True,
            is_event=True,
            may_last=True,
        ),
        _crash,
        _check_component,
    ),
    "restart": Effect(
        FaultForm(
            text="restart",
            does=f"the onboard process dies; it comes back at END, or after {AWAY_S:g} s",
            lasts_s=AWAY_S,
        ),
        _restart,
    ),
    **COMPUTER,
    "operator": OPERATOR,
    "pilot": Effect(
        FaultForm(
            text="pilot:MODE|" + "|".join(_SWITCHES),
            does=f"the pilot's switches; modes: {', '.join(_BEHAVIOURS)}, or the autopilot's mode names",
            has_target=True,
            is_event=True,
        ),
        _pilot,
        _check_pilot,
    ),
    "topic": Effect(
        FaultForm(
            text="topic:TOPIC=lost|late|stale|nan|jump|foreign[/SIZE]",
            does="corrupts its messages; sizes in s (late, stale) and m (jump); foreign adds another sender's",
            has_target=True,
            words=TOPIC_WORDS,
            size_of=("late", "stale", "jump"),
        ),
        corrupt_topic,
        check_topic,
    ),
}
"""Every kind of fault."""
