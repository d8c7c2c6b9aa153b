"""The devices of the onboard process, as its samplers and drivers see them; hardware, simulation and logs fit in."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from gloc3.camera.model import CameraModel
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import GeoPoint, Vector3
from gloc3.messages.perception import (
    BottomVelocity,
    DepthImage,
    EstimatorPose,
    ImuSample,
    LaserScan,
    PointCloud,
    SatelliteFix,
    WheelDistances,
)
from gloc3.messages.vehicle import (
    AutopilotPose,
    AutopilotState,
    FlightMode,
    HeightAboveGround,
    Image,
    VehicleClass,
)


class Stamped(NamedTuple):
    """An autopilot's pose with its time of validity."""

    t_s: float
    pose: AutopilotPose


class StampedHeight(NamedTuple):
    """A height with its time of validity."""

    t_s: float
    height: HeightAboveGround


class StampedImage(NamedTuple):
    """A camera's frame with its time of validity."""

    t_s: float
    image: Image


class StampedPair(NamedTuple):
    """The frames of a stereo pair with their common time of validity."""

    t_s: float
    left: Image
    right: Image


class StampedDepth(NamedTuple):
    """A depth camera's frame with its time of validity."""

    t_s: float
    depth: DepthImage


class StampedScan(NamedTuple):
    """A scanner's turn with the time of its last beam."""

    t_s: float
    scan: LaserScan


class StampedCloud(NamedTuple):
    """A 3D scanner's turn with the time of its end."""

    t_s: float
    cloud: PointCloud


class StampedImu(NamedTuple):
    """A sample of an inertial unit, with its time of validity."""

    t_s: float
    sample: ImuSample


class StampedBottomVelocity(NamedTuple):
    """A velocity over the floor with its time of validity."""

    t_s: float
    bottom: BottomVelocity


class StampedEstimatorPose(NamedTuple):
    """A pose of another estimator with its time of validity."""

    t_s: float
    pose: EstimatorPose


class StampedWheels(NamedTuple):
    """Distances travelled by the wheels, with their time of validity."""

    t_s: float
    wheels: WheelDistances


class StampedFix(NamedTuple):
    """A satellite fix with its time of validity."""

    t_s: float
    fix: SatelliteFix


class StampedReading(NamedTuple):
    """A probe's reading with its time of validity."""

    t_s: float
    value: float
    """In the probe's own unit."""


Unwatch = Callable[[], None]
"""Ends a subscription to a device."""


class Bell:
    """Notification of new data from a device to samplers, which then need not poll."""

    def __init__(self) -> None:
        self._ready: tuple[Callable[[], None], ...] = ()

    def listen(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called whenever it rings."""
        self._ready = (*self._ready, ready)

        def unwatch() -> None:
            self._ready = tuple(other for other in self._ready if other is not ready)

        return unwatch

    def ring(self) -> None:
        """Notifies all subscribers."""
        for ready in self._ready:
            ready()


class AutopilotTelemetry(Protocol):
    """Telemetry of an autopilot. Every method gives the latest value and may be called from any thread."""

    def state(self) -> AutopilotState:
        """Mode, arming, battery."""

    def pose(self) -> Stamped | None:
        """The latest estimate; None before the first."""

    def attitude(self) -> Stamped | None:
        """The latest attitude that came without a position; None before the first."""

    def on_state(self, changed: Callable[[], None]) -> Unwatch:
        """Has `changed` called, from any thread, when the state has changed."""

    def on_pose(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called, from any thread, when a new estimate is there."""


class Memory(Protocol):
    """Where a component keeps a few bytes that outlive its process."""

    def load(self) -> bytes | None:
        """What was kept last since the computer was started; None for nothing."""

    def keep(self, data: bytes) -> None:
        """Replaces what is kept. A disk that fails is not the component's concern."""


class HeightSensor(Protocol):
    """A downward range finder."""

    def height(self) -> StampedHeight | None:
        """The latest distance to the ground; None before the first."""

    def on_height(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called, from any thread, when a new distance is there."""


class SensorSource(Protocol):
    """A device that is opened, notifies of new data, and is closed; simulated, real, or a log.

    It is read after `on_new_data` and once a cycle, and may be reopened after closing.
    """

    def open(self) -> None:
        """Starts acquisition; may take some seconds.

        Raises:
            Gloc3Error: the device is not available; the message says what to do.
        """

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called, from any thread, when there is something new."""

    def close(self) -> None:
        """Ends taking data."""


class Camera(SensorSource, Protocol):
    """A camera."""

    def frame(self) -> StampedImage | None:
        """The latest frame; None before the first.

        Raises:
            Gloc3Error: the device is permanently lost; the message says what to do. The same for other sources.
        """


class StereoCamera(SensorSource, Protocol):
    """Two cameras that expose together, left and right."""

    def pair(self) -> StampedPair | None:
        """The latest two frames; None before the first."""


class DepthCamera(SensorSource, Protocol):
    """A camera that measures how far away what it sees is."""

    def depth(self) -> StampedDepth | None:
        """The latest frame; None before the first."""


class Laser(SensorSource, Protocol):
    """A range scanner."""

    def scan(self) -> StampedScan | None:
        """The latest turn; None before the first."""


class Lidar(SensorSource, Protocol):
    """A 3D scanner."""

    def cloud(self) -> StampedCloud | None:
        """The latest turn; None before the first."""


class Imu(SensorSource, Protocol):
    """An inertial measuring unit."""

    def samples(self, after_s: float) -> Sequence[StampedImu]:
        """What it felt after a time, oldest first; it keeps about the last second."""


class Dvl(SensorSource, Protocol):
    """A Doppler velocity log."""

    def bottom_velocity(self) -> StampedBottomVelocity | None:
        """The latest velocity over the floor; None before the first."""


class Probe(SensorSource, Protocol):
    """A sensor of one number: a gas, a temperature, a salinity."""

    def reading(self) -> StampedReading | None:
        """The latest reading; None before the first."""


class ExternalEstimator(SensorSource, Protocol):
    """An estimator that is not ours: visual-inertial or lidar odometry in another program or device."""

    def estimated_pose(self) -> StampedEstimatorPose | None:
        """The latest pose; None before the first."""


class Wheels(Protocol):
    """The encoders of wheels."""

    def wheels(self) -> StampedWheels | None:
        """How far they have turned; None before the first."""

    def on_wheels(self, ready: Callable[[], None]) -> Unwatch:
        """Calls `ready`, from any thread, when wheel data arrive."""


class Satellites(Protocol):
    """A satellite receiver."""

    def fix(self) -> StampedFix | None:
        """The latest fix; None before the first."""

    def on_fix(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called, from any thread, when there is a new one."""


class Rig(Protocol):
    """The cameras of a vehicle as they were calibrated."""

    def model(self, camera: str) -> CameraModel | None:
        """The model of the camera of that name, as its pictures are named; None where it has none."""


def calibrated(rig: Rig, camera: str) -> CameraModel:
    """The model of a camera.

    Raises:
        Refused: the rig has none of that name.
    """
    model = rig.model(camera)
    if model is None:
        raise Refused(f"there is no calibration of a camera {camera!r}")
    return model


def opened(device: SensorSource, ready: Callable[[], None]) -> Unwatch:
    """Opens a device and calls `ready` on new data; returns a function that ends both."""
    device.open()
    unwatch = device.on_new_data(ready)

    def close() -> None:
        device.close()
        unwatch()

    return close


class CommandAnswer(NamedTuple):
    """An autopilot's answer to a command."""

    is_accepted: bool
    reason: str


class GeoPath(NamedTuple):
    """A path through positions on Earth, as uploaded to an autopilot."""

    places: tuple[GeoPoint, ...]
    """Positions with altitudes above mean sea level, as reported by the autopilot."""
    speed_m_s: float
    acceptance_m: float
    hold_s: float
    heading_deg: float | None
    """Clockwise from north; None for along the path."""
    is_winged: bool = False
    """For flight on wings: waits in circles, also at the end; its speed is airspeed."""
    is_from_ground: bool = False
    """For flight on wings from the ground: the first position gives the height of the climb."""
    vtol: "VtolWay | None" = None
    """For what has both wings and rotors."""


class VtolWay(NamedTuple):
    """How what has both wings and rotors flies a way."""

    on_wings: bool
    """Whether its places are flown to on wings."""
    hovers: bool = True
    """Whether it hovers at the end; else, on wings, it circles there."""
    climb_m: float = 0.0
    """Of a take-off: height over the place where it stands."""
    within_m: float = 2.0
    """So near it comes on rotors to the last place of a way on wings."""
    brakes_at: GeoPoint | None = None
    """Place before the last one at which it leaves its wings; None for at once, where it is to hover."""


class FileProgress(NamedTuple):
    """What the autopilot reports of the items, numbered from 1."""

    current: int = 0
    """The item that it flies; 0 while it has reported none."""
    reached: int = 0
    """The last item that it has passed."""
    is_complete: bool = False
    """Whether it says that all are done."""


class AutopilotBehaviour(NamedTuple):
    """Rules for commanding an autopilot of one family and class."""

    vehicle: VehicleClass = VehicleClass.COPTER
    arm_in_mode: FlightMode | None = None
    """The mode in which it wants to be armed before it sets off; None for any."""
    stream_before_guided_s: float = 0.0
    """Time for which setpoints must be streamed before guided mode is accepted, s. Above 0, a stream also restores
    guided mode after a loss, and guided mode persists after a landing (PX4)."""
    climbs: bool = True
    """Whether it has a take-off command; otherwise it is armed, and follows setpoints from where it stands."""
    land_mode: FlightMode = FlightMode.LAND
    """The mode in which a motion ends: it lands, surfaces, or stops."""
    disarms_itself: bool = True
    """Whether it disarms automatically after landing; otherwise it is commanded to."""
    at_rest_s: float = 0.0
    """With that: how long it must have stood still in `land_mode`."""
    returns_to_land: bool = False
    """Whether its landing comes down wherever it is, in circles, so that its own return has to bring it home first."""
    floats: bool = False
    """With that: it comes to rest at the surface, where a current carries it on: it stands still when it stops to rise."""
    lands_into: tuple[str, ...] = ()
    """Modes, in the autopilot's names, that it enters automatically after a landing."""


class AutopilotSetpoint(NamedTuple):
    """One setpoint in the autopilot's local NED frame; None leaves an axis to the autopilot."""

    position_ned_m: Vector3 | None
    velocity_ned_m_s: Vector3 | None
    yaw_rad: float | None
    acceleration_ned_m_s2: Vector3 | None = None
    """With a position and a velocity: how the velocity changes, for vehicles that take it as feed-forward."""


class AutopilotControl(Protocol):
    """Interface for commanding an autopilot. Nothing blocks; answers are polled with the command's ticket."""

    @property
    def behaviour(self) -> AutopilotBehaviour:
        """How the autopilot that is there now wants to be commanded."""

    def state(self) -> AutopilotState:
        """The autopilot's state, as far as it is known; `is_connected` says whether it still is."""

    def send_setpoint(self, setpoint: AutopilotSetpoint) -> None:
        """Streams one setpoint."""

    def command_mode(self, mode: FlightMode) -> int:
        """Asks for a mode."""

    def command_arm(self) -> int:
        """Asks to arm."""

    def command_disarm(self, *, is_forced: bool = False) -> int:
        """Asks to disarm; the autopilot refuses it in flight, unless it is forced."""

    def command_mission_start(self) -> int:
        """Requests that the uploaded mission begins, which has an armed vehicle set off from the ground."""

    def command_take_off(self, height_m: float) -> int:
        """Asks to climb to a height above the present place, in the mode that this style needs."""

    def answer(self, ticket: int) -> CommandAnswer | None:
        """The answer to a command; None while there is none."""

    def abandon_commands(self) -> None:
        """Sends nothing again that was commanded so far, and nothing that still waits."""


class Tap(Protocol):
    """One topic that is listened to."""

    latest: Envelope[Any] | None
    count: int
    """Messages since it was opened."""

    def close(self) -> None:
        """Listens no more."""


class Taps(Protocol):
    """Subscriptions to topics; may be called from any thread."""

    def open(self, topic: str, reports: Callable[[], None] | None = None) -> Tap:
        """Subscribes to a topic, given below the platform's name; `reports` is called for every message."""
