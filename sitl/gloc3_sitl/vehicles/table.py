"""The table of simulated vehicles, one row each."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final

from gloc3.errors import Misuse, Refused, nearest
from gloc3.messages.frames import GeoPoint
from gloc3.platform.platform import Platform
from gloc3_sitl.autopilot import airframe
from gloc3_sitl.autopilot.control.multirotor import MultirotorControl
from gloc3_sitl.autopilot.control.underwater import UnderwaterControl
from gloc3_sitl.autopilot.modes import StyleTables
from gloc3_sitl.autopilot.styles.ardupilot import ARDUPILOT
from gloc3_sitl.autopilot.styles.ardusub import ARDUSUB
from gloc3_sitl.autopilot.styles.plane import PLANE
from gloc3_sitl.autopilot.styles.px4 import PX4
from gloc3_sitl.autopilot.styles.px4_vtol import PX4_VTOL
from gloc3_sitl.autopilot.styles.quadplane import QUADPLANE as QUADPLANE_STYLE
from gloc3_sitl.autopilot.styles.rover import BOAT, ROVER
from gloc3_sitl.autopilot.vehicle_class import BOAT as BOAT_CLASS
from gloc3_sitl.autopilot.vehicle_class import MULTIROTOR, VTOL, AutopilotClass
from gloc3_sitl.autopilot.vehicle_class import PLANE as PLANE_CLASS
from gloc3_sitl.autopilot.vehicle_class import ROVER as ROVER_CLASS
from gloc3_sitl.physics.body import MakeBody, Situation, VehicleBody
from gloc3_sitl.physics.fixed_wing import FixedWing
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.physics.lift_rotors import Quadplane
from gloc3_sitl.physics.rover import SkidRover
from gloc3_sitl.physics.underwater import UnderwaterVehicle
from gloc3_sitl.physics.vessel import Vessel
from gloc3_sitl.sensors.airspeed import Airspeed
from gloc3_sitl.sensors.battery import Pack
from gloc3_sitl.sensors.compass import Compass
from gloc3_sitl.sensors.depth import DepthSensor, LeakSensor
from gloc3_sitl.sensors.fix import ACOUSTIC, FixSensor, SurfaceFix
from gloc3_sitl.sensors.range_finder import Altimeter
from gloc3_sitl.sensors.sensor import SimulatedSensor
from gloc3_sitl.sensors.wheels import WheelEncoders
from gloc3_sitl.vehicles import HUMMINGBIRD, PELICAN, MultirotorModel
from gloc3_sitl.vehicles.aerosonde import AEROSONDE
from gloc3_sitl.vehicles.auv import AUV
from gloc3_sitl.vehicles.jackal import JACKAL
from gloc3_sitl.vehicles.otter import OTTER
from gloc3_sitl.vehicles.quadplane import LIFT_ROTORS, QUADPLANE
from gloc3_sitl.vehicles.rov import ROV
from gloc3_sitl.vehicles.underwater import UnderwaterModel

MOST_WAVES_M: Final = 5.0
MOST_CURRENT_M_S: Final = 3.0
MakeSensors = Callable[[int, GeoPoint], Sequence[SimulatedSensor[Any]]]
"""Makes sensors from a seed and the home."""


def _none(seed: int, home: GeoPoint) -> Sequence[SimulatedSensor[Any]]:
    """No sensors beside those that every vehicle has."""
    del seed, home
    return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleRow:
    """One vehicle."""

    types: tuple[str, ...]
    """Platform types that this vehicle represents."""
    body: MakeBody
    """Makes its physics."""
    pack: Pack
    """Its battery."""
    vehicle_class: AutopilotClass
    """How the autopilot steers it."""
    styles: Mapping[str, StyleTables]
    """Autopilots that can steer it, by name; the first is the usual one."""
    world: str = "open"
    """Default world of missions on Earth; it can be placed anywhere."""
    swims: bool = False
    """Whether waves and current reach it."""
    imu_bias_share: float = 1.0
    """Biases of its inertial unit, as a share of those of a multirotor's."""
    is_diving: bool = False
    """The ground under it is the floor of the water."""
    sensors: MakeSensors = _none
    """Sensors beside those that every vehicle has, or in place of one of the same name."""
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """How its autopilots are set otherwise than they come, by their names."""


def _quadrotor(model: MultirotorModel) -> MakeBody:
    """A body with four rotors."""

    def make(situation: Situation) -> VehicleBody:
        return Quadrotor(
            model.aircraft,
            situation.home,
            wind=situation.wind,
            seed=situation.seed,
            rate_hz=situation.rate_hz,
            heading_deg=situation.heading_deg,
        )

    return make


def _diving(model: UnderwaterModel) -> MakeBody:
    """A body under water."""

    def make(situation: Situation) -> VehicleBody:
        return UnderwaterVehicle(
            model,
            situation.home,
            situation.water,
            wind=situation.wind,
            seed=situation.seed,
            rate_hz=situation.rate_hz,
            heading_deg=situation.heading_deg,
        )

    return make


def _submarine(model: UnderwaterModel) -> AutopilotClass:
    """ArduSub's view of the vehicle: bidirectional outputs around 1500 us."""
    outputs = len(model.thrusters) + (2 if model.fins is not None else 0)
    return AutopilotClass(
        mav_type=12,
        floats=True,
        control=lambda craft: UnderwaterControl(craft, model),
        reports_landed=False,
        output_numbers=tuple(range(1, outputs + 1)),
        neutral_us=1500,
        span_us=400,
    )


_TACTICAL: Final = 0.1
"""Accelerometers of 0.3 mg beside a fibre-optic gyrocompass: what leans the level by more turns the heading, too."""


def _diving_sensors(seed: int, home: GeoPoint) -> Sequence[SimulatedSensor[Any]]:
    """Depth in place of the barometer, an echo sounder in place of the laser, a good compass, fixes at the surface only, leak contacts."""
    return DepthSensor(seed, home), Altimeter(seed), Compass(seed, home), SurfaceFix(seed, home), LeakSensor(seed)


def _located_sensors(seed: int, home: GeoPoint) -> Sequence[SimulatedSensor[Any]]:
    """The same with acoustic positions at any depth."""
    acoustic = FixSensor(seed, home, ACOUSTIC, rate_hz=5.0)
    return DepthSensor(seed, home), Altimeter(seed), Compass(seed, home), acoustic, LeakSensor(seed)


def _submarine_row(kind: str, model: UnderwaterModel) -> VehicleRow:
    """What dives: an AUV or an ROV, under ArduSub."""
    return VehicleRow(
        types=(kind,),
        body=_diving(model),
        pack=model,
        vehicle_class=_submarine(model),
        styles={"ardupilot": ARDUSUB},
        world="bay",
        swims=True,
        imu_bias_share=_TACTICAL,
        is_diving=True,
        parameters={"ardupilot": {"BATT_FS_LOW_ACT": 3.0, "BATT_FS_CRT_ACT": 2.0}},
        sensors=_diving_sensors,
    )


_PELICAN: Final = VehicleRow(
    types=("quadrotor", "hexarotor"),
    body=_quadrotor(PELICAN),
    pack=PELICAN,
    vehicle_class=MULTIROTOR,
    styles={"px4": PX4, "ardupilot": ARDUPILOT},
)
VEHICLES: Final[Mapping[str, VehicleRow]] = {
    "pelican": _PELICAN,
    "copter": replace(
        _PELICAN,
        types=(),
        styles={"ardupilot": ARDUPILOT, "px4": PX4},
    ),
    "hummingbird": VehicleRow(
        types=(),
        body=_quadrotor(HUMMINGBIRD),
        pack=HUMMINGBIRD,
        vehicle_class=replace(MULTIROTOR, control=partial(MultirotorControl, airframe=airframe.HUMMINGBIRD)),
        styles={"px4": PX4, "ardupilot": ARDUPILOT},
        parameters={
            "px4": {"MPC_THR_HOVER": airframe.HUMMINGBIRD.hover_thrust},
            "ardupilot": {"MOT_THST_HOVER": airframe.HUMMINGBIRD.hover_thrust},
        },
    ),
    "auv": _submarine_row("auv", AUV),
    "rov": _submarine_row("rov", ROV),
    "submarine": replace(_submarine_row("", ROV), types=(), sensors=_located_sensors),
    "rover": VehicleRow(
        types=("rover",),
        body=partial(SkidRover, JACKAL),
        pack=JACKAL,
        vehicle_class=ROVER_CLASS,
        styles={"ardupilot": ROVER},
        parameters={"ardupilot": {"BATT_FS_LOW_ACT": 2.0, "BATT_FS_CRT_ACT": 5.0}},
        sensors=lambda seed, _: [WheelEncoders(seed, JACKAL.ticks_per_m)],
    ),
    "boat": VehicleRow(
        types=("boat",),
        body=partial(Vessel, OTTER),
        pack=OTTER,
        vehicle_class=BOAT_CLASS,
        styles={"ardupilot": BOAT},
        parameters={"ardupilot": {"BATT_FS_LOW_ACT": 6.0, "BATT_FS_CRT_ACT": 5.0}},
        swims=True,
    ),
    "plane": VehicleRow(
        types=("aircraft",),
        body=partial(FixedWing, AEROSONDE),
        pack=AEROSONDE,
        vehicle_class=PLANE_CLASS,
        styles={"ardupilot": PLANE},
        parameters={"ardupilot": {"BATT_FS_LOW_ACT": 2.0, "BATT_LOW_MAH": 2000.0, "BATT_CRT_MAH": 1000.0}},
        sensors=lambda seed, home: [Airspeed(seed, home)],
    ),
    "quadplane": VehicleRow(
        types=("vtol",),
        body=partial(Quadplane, QUADPLANE, LIFT_ROTORS),
        pack=QUADPLANE,
        vehicle_class=VTOL,
        styles={"px4": PX4_VTOL, "ardupilot": QUADPLANE_STYLE},
        sensors=lambda seed, home: [Airspeed(seed, home)],
        parameters={
            "px4": {"MIS_TKO_LAND_REQ": 0.0, "COM_QC_ACT": -1.0, "RTL_TYPE": 0.0},
            "ardupilot": {
                "BATT_FS_LOW_ACT": 1.0,
                "BATT_LOW_MAH": 2000.0,
                "BATT_CRT_MAH": 1000.0,
                "Q_MAV_TYPE": 22.0,
                "Q_GUIDED_MODE": 1.0,
                "Q_RTL_MODE": 1.0,
                "Q_TRANS_FAIL": 15.0,
                "Q_TRANS_FAIL_ACT": -1.0,
            },
        },
    ),
}
"""By the name that `gloc3 sitl --vehicle` takes."""
STYLES: Final = sorted({style for row in VEHICLES.values() for style in row.styles}, reverse=True)
"""Autopilots that can be simulated."""


def vehicle_of(platform: Platform) -> str:
    """Returns the simulated vehicle of a platform: the airframe that it names, or the one of its type.

    Raises:
        Misuse: it names one that there is not.
    """
    if platform.vehicle.airframe:
        vehicle_named(platform.vehicle.airframe)
        return platform.vehicle.airframe
    return next((name for name, row in VEHICLES.items() if platform.vehicle.type in row.types), "pelican")


def vehicle_named(name: str) -> VehicleRow:
    """Returns the row of a vehicle.

    Raises:
        Misuse: there is none.
    """
    if name not in VEHICLES:
        raise Misuse(f"unknown vehicle {name!r}; {nearest(name, list(VEHICLES))}")
    return VEHICLES[name]


def check_sea(vehicle: str, waves_m: float, current_m_s: float) -> None:
    """Checks the requested waves and current.

    Args:
        vehicle: which is in it.
        waves_m: significant height.
        current_m_s: of the water.

    Raises:
        Refused: it is out of range, or does not reach the vehicle.
    """
    if not 0.0 <= waves_m <= MOST_WAVES_M:
        raise Refused(f"--waves must be from 0 to {MOST_WAVES_M:g} m")
    if not abs(current_m_s) <= MOST_CURRENT_M_S:
        raise Refused(f"--current must be from -{MOST_CURRENT_M_S:g} to {MOST_CURRENT_M_S:g} m/s")
    if (waves_m or current_m_s) and not vehicle_named(vehicle).swims:
        swimmers = ", ".join(name for name, row in VEHICLES.items() if row.swims)
        raise Refused(f"--waves and --current need a vehicle in water ({swimmers}), not {vehicle!r}")


def style_of(vehicle: str, wanted: str | None) -> str:
    """Returns the autopilot style of a vehicle: the requested one, or its default.

    Raises:
        Misuse: there is none of that name, or it does not steer such vehicles here.
    """
    styles = vehicle_named(vehicle).styles
    if wanted is None:
        return next(iter(styles))
    if wanted not in STYLES:
        raise Misuse(f"unknown autopilot {wanted!r}; {nearest(wanted, STYLES)}")
    if wanted not in styles:
        raise Misuse(f"autopilot {wanted!r} does not support {vehicle!r}; use {' or '.join(styles)}")
    return wanted
