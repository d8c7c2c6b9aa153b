"""Platform file: a vehicle's properties, capabilities, limits and components."""

from hashlib import blake2s
from typing import Annotated, Literal

import msgspec

from gloc3.camera.model import CameraModel
from gloc3.component.deployment import ComponentRow, FaultPolicy
from gloc3.documents.format_version import FormatVersion
from gloc3.errors import Gloc3Error
from gloc3.log.selection import TopicChoice
from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.platform.limits import Limits, PlatformRow, Positive, Power, Share

Name = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,31}$")]


class Vehicle(PlatformRow, frozen=True, kw_only=True):
    """The vehicle itself."""

    type: Literal["quadrotor", "hexarotor", "aircraft", "vtol", "rover", "boat", "auv", "rov"]
    mass_kg: Positive
    airframe: str = ""
    """Vehicle model in simulation, of `gloc3 sitl --vehicle`; empty for the default of its type."""


class FrameOrigin(PlatformRow, frozen=True, kw_only=True):
    """Origin of a local frame."""

    geo: tuple[
        Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)],
        Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)],
        Annotated[float, msgspec.Meta(ge=-11_000.0, le=20_000.0)],
    ]
    """`[latitude, longitude, altitude above mean sea level]` in degrees and metres."""


class FrameRow(PlatformRow, frozen=True, kw_only=True):
    """A local frame: axes x, y to the left of it, height up."""

    origin: FrameOrigin
    x_axis_bearing_deg: Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)] = 0.0
    """Direction of x, clockwise from north."""

    def frame(self) -> LocalFrame:
        """The frame that the row describes."""
        return LocalFrame(GeoPoint(*self.origin.geo), self.x_axis_bearing_deg)


class LinkLossFailsafe(PlatformRow, frozen=True, kw_only=True):
    """Autopilot failsafe for a lost ground station."""

    action: Literal["continue", "hold", "return", "land"]
    after_s: Annotated[float, msgspec.Meta(ge=0.0, le=3_600.0)] = 10.0


class LowBatteryFailsafe(PlatformRow, frozen=True, kw_only=True):
    """Autopilot failsafe for a low battery."""

    action: Literal["continue", "hold", "return", "land"]
    at: Share = 0.2
    """Remaining share at which it acts."""


class PoseLostFailsafe(PlatformRow, frozen=True, kw_only=True):
    """Autopilot failsafe for a lost position."""

    action: Literal["continue", "hold", "return", "land"]


class Failsafes(PlatformRow, frozen=True, kw_only=True):
    """Failsafes that are configured on the autopilot; missions are checked against them. None: no failsafe."""

    link_loss: LinkLossFailsafe | None = None
    low_battery: LowBatteryFailsafe | None = None
    pose_lost: PoseLostFailsafe | None = None


class Capability(PlatformRow, frozen=True, kw_only=True):
    """Something that the platform can do, as an action of a mission."""

    arguments: str
    """The kind of arguments that it takes, such as `follow_waypoints`."""
    performed_by: str
    """Component that performs it; empty for a capability of the executor itself."""
    claims: tuple[Name, ...] = ()
    """Resources that it needs for itself while it runs, such as `motion`."""
    needs: tuple[str, ...] = ()
    """Topics, components or capabilities that must be alive."""
    options: dict[str, tuple[str, ...]] = {}
    """Values that are possible for an argument here, such as the names of the cameras."""
    performed_as: str = ""
    """Capability name used by the component; empty for the same name."""


class HostRow(PlatformRow, frozen=True, kw_only=True):
    """A computer of the platform."""

    on_loss: FaultPolicy = FaultPolicy.IGNORE
    """Policy in flight when the whole host is lost, in addition to those of its components' rows."""


class Platform(PlatformRow, frozen=True, kw_only=True):
    """A vehicle with everything known about it before it starts."""

    format_version: FormatVersion = msgspec.field(default=1, name="gloc3")
    """Version of the file's format; a newer one than this version of GLOC3 reads is refused."""
    platform: Name
    """Its name; the first part of all its topics."""
    vehicle: Vehicle
    arm: bool = False
    """Whether `take_off` may arm the vehicle."""
    on_stop: Literal["hold", "land"] = "hold"
    """Policy when the onboard process is stopped in flight: the autopilot's hold is confirmed, or it lands."""
    pilot: bool = False
    """Whether a pilot with a transmitter stands by on every flight, to whom the autopilot may hand over control."""
    frames: dict[Name, FrameRow] = {}
    limits: Limits = Limits()
    power: Power | None = None
    failsafes: Failsafes = Failsafes()
    capabilities: dict[Name, Capability] = {}
    devices: dict[Name, str] = {}
    """Where the data of sensors comes from, by device: URLs such as `v4l2:///dev/video0`."""
    cameras: dict[Name, CameraModel | str] = {}
    """How each camera is calibrated: a model, or a file such as `front.yaml#cam0`, relative to this one."""
    known_map: str = ""
    """A map of what is free and what is occupied there, known at the start: a file that `gloc3 log convert --to map` has
    written, relative to this one."""
    first_camera_component: Annotated[int, msgspec.Meta(ge=0, le=105)] = 100
    """MAVLink component of the first camera that the onboard process offers to other programs; the others follow, up to
    105. Greater than 100 where the vehicle has MAVLink cameras of its own; 0 to offer none."""
    members: dict[Name, str] = {}
    """Members of the network for whom the signing keys of MAVLink links stand: the key's file, relative to this one."""
    hosts: dict[Name, HostRow] = {}
    """Computers that the components run on; empty for a single one."""
    log: dict[str, TopicChoice] = {}
    """Topics that are recorded differently from their rows, by name or pattern such as `camera/*`: true, false, or at
    most so many messages a second."""
    components: tuple[ComponentRow, ...] = ()

    def local_frames(self) -> dict[str, LocalFrame]:
        """The frames by name."""
        return {name: row.frame() for name, row in self.frames.items()}

    def digest(self) -> str:
        """A digest of what missions are checked against: two files that agree in it allow the same missions."""
        names = [row.name for row in self.components]
        checked = (
            self.vehicle,
            self.arm,
            self.frames,
            self.limits,
            self.power,
            self.failsafes,
            self.capabilities,
            names,
        )
        return blake2s(msgspec.json.encode(checked, order="sorted"), digest_size=6).hexdigest()

    def component(self, name: str) -> ComponentRow | None:
        """The row of a component."""
        return next((row for row in self.components if row.name == name), None)

    @property
    def is_complete(self) -> bool:
        """Whether all its components' classes can be loaded here, so that its topics are known."""
        for row in self.components:
            try:
                row.load_class()
            except Gloc3Error:
                return False
        return True

    def topics(self) -> set[str]:
        """The topics that the platform's components publish, as far as their classes can be loaded."""
        found: set[str] = set()
        for row in self.components:
            try:
                outputs = row.load_class().outputs
            except Gloc3Error:
                found.update(topic for port in row.ports for topic in row.topics(port))
            else:
                found.update(topic for port in outputs for topic in row.topics(port))
        return found
