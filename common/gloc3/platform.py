"""The platform file: what a vehicle is, can do, is limited to, and which components make it up."""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from gloc3 import schema
from gloc3.camera_model import CameraModel
from gloc3.deployment import ComponentRow, FaultPolicy
from gloc3.document import load_bytes, parse
from gloc3.errors import Finding, Gloc3Error, InputError, NotThere, nearest
from gloc3.frames import GeoPoint, LocalFrame
from gloc3.installed import installed_points

Name = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,31}$")]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
Height = Annotated[float, msgspec.Meta(ge=-11_000.0, le=1e6)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class _Row(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The base of everything that stands in a platform file."""


class Vehicle(_Row, frozen=True, kw_only=True):
    """The vehicle itself."""

    type: Literal["quadrotor", "hexarotor", "aircraft", "rover", "boat", "auv", "rov"]
    mass_kg: Positive
    airframe: str = ""
    """What stands for it in simulation, of `gloc3 sitl --vehicle`; empty for the usual one of its type."""


class FrameOrigin(_Row, frozen=True, kw_only=True):
    """Where a local frame begins."""

    geo: tuple[
        Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)],
        Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)],
        Annotated[float, msgspec.Meta(ge=-11_000.0, le=20_000.0)],
    ]
    """`[latitude, longitude, altitude above mean sea level]` in degrees and metres."""


class FrameRow(_Row, frozen=True, kw_only=True):
    """A local frame: axes x, y to the left of it, height up."""

    origin: FrameOrigin
    x_axis_bearing_deg: Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)] = 0.0
    """Direction of x, clockwise from north."""

    def frame(self) -> LocalFrame:
        """The frame that the row describes."""
        return LocalFrame(GeoPoint(*self.origin.geo), self.x_axis_bearing_deg)


class Limits(_Row, frozen=True, kw_only=True):
    """What the driver and the limiter never let the vehicle exceed, and missions are checked against."""

    speed_m_s: Positive = 3.0
    """Greatest horizontal speed."""
    climb_m_s: Positive = 1.0
    """Greatest vertical speed."""
    landing_m_s: Positive = 0.5
    """Speed of the last part of a landing; landings are estimated with it."""
    acceleration_m_s2: Positive = 2.5
    height_min_m: Height = 0.3
    """Least height above home of a waypoint; negative for what dives."""
    height_max_m: Height = 30.0
    """Greatest height above home."""
    altitude_min_m: NotNegative = 0.5
    """Least height over the ground, or the floor of the water, that a way may be asked to keep."""
    fence_margin_m: NotNegative = 0.5
    """Distance that waypoints and legs keep from the fence."""
    survey_height_m: Height | None = None
    """Height above home at which patterns are flown that say none: 0 on the ground or the water, negative for what dives."""
    survey_speed_m_s: Positive | None = None
    """Speed of ways that say none; None: 1 m/s, or the greatest where that is less."""
    survey_acceptance_m: Positive = 0.25
    """So near patterns that say nothing come to a waypoint."""
    speed_min_m_s: NotNegative = 0.0
    """Slower ways are refused: what flies on wings falls."""
    turn_radius_m: NotNegative = 0.0
    """Of what cannot turn on the spot nor stop, such as a plane: ways need room to turn, and it waits in circles."""

    def __post_init__(self) -> None:
        if self.height_min_m >= self.height_max_m:
            raise ValueError("height_min_m must be less than height_max_m")
        if self.survey_height_m is not None and not self.height_min_m <= self.survey_height_m <= self.height_max_m:
            raise ValueError("survey_height_m must be from height_min_m to height_max_m")
        if self.survey_speed_m_s is not None and self.survey_speed_m_s > self.speed_m_s:
            raise ValueError("survey_speed_m_s must be no more than speed_m_s")
        if not self.speed_min_m_s <= (self.survey_speed_m_s or self.speed_m_s) <= self.speed_m_s:
            raise ValueError("speed_min_m_s must be no more than survey_speed_m_s and speed_m_s")


class Power(_Row, frozen=True, kw_only=True):
    """The stated power model from which the energy of a mission is estimated."""

    hover_w: NotNegative
    """Power to hover (or to stay put)."""
    per_m_s_w: NotNegative = 0.0
    """More power for each metre per second of horizontal speed."""
    climb_w_per_m_s: NotNegative = 0.0
    """More power for each metre per second of climb."""
    avionics_w: NotNegative = 0.0
    """Computers and sensors, all the time."""
    battery_wh: Positive
    """Energy of the full battery."""
    reserve: Share = 0.25
    """Share of the battery that missions must leave; below it the battery counts as low."""

    @property
    def usable_wh(self) -> float:
        """What a mission may use."""
        return self.battery_wh * (1.0 - self.reserve)


class LinkLossFailsafe(_Row, frozen=True, kw_only=True):
    """What the autopilot does by itself without a ground station."""

    action: Literal["continue", "hold", "return", "land"]
    after_s: Annotated[float, msgspec.Meta(ge=0.0, le=3_600.0)] = 10.0


class LowBatteryFailsafe(_Row, frozen=True, kw_only=True):
    """What the autopilot does by itself when the battery is low."""

    action: Literal["continue", "hold", "return", "land"]
    at: Share = 0.2
    """Remaining share at which it acts."""


class PoseLostFailsafe(_Row, frozen=True, kw_only=True):
    """What the autopilot does by itself when it has no position."""

    action: Literal["continue", "hold", "return", "land"]


class Failsafes(_Row, frozen=True, kw_only=True):
    """What the autopilot is set to do by itself; missions are checked for agreeing with it. None: nothing."""

    link_loss: LinkLossFailsafe | None = None
    low_battery: LowBatteryFailsafe | None = None
    pose_lost: PoseLostFailsafe | None = None


class Capability(_Row, frozen=True, kw_only=True):
    """Something that the platform can do, as an action of a mission."""

    arguments: str
    """The kind of arguments that it takes, such as `follow_waypoints`."""
    performed_by: str
    """The component that performs it; empty for what the executor does itself."""
    claims: tuple[Name, ...] = ()
    """Resources that it needs for itself while it runs, such as `motion`."""
    needs: tuple[str, ...] = ()
    """Topics, components or capabilities that must be alive."""
    options: dict[str, tuple[str, ...]] = {}
    """Values that are possible for an argument here, such as the names of the cameras."""
    performed_as: str = ""
    """The capability as which the component performs it; empty for its own name."""


class HostRow(_Row, frozen=True, kw_only=True):
    """A computer of the platform."""

    on_loss: FaultPolicy = FaultPolicy.IGNORE
    """What is done in flight when nothing is heard of the whole host, beside what its components' rows say."""


class Platform(_Row, frozen=True, kw_only=True):
    """A vehicle with all that is known of it before it starts."""

    platform: Name
    """Its name; the first part of all its topics."""
    vehicle: Vehicle
    arm: bool = False
    """Whether `take_off` may arm the vehicle."""
    on_stop: Literal["hold", "land"] = "hold"
    """What is done when the onboard process is told to end in flight: the autopilot's hold is confirmed, or it lands."""
    frames: dict[Name, FrameRow] = {}
    limits: Limits = Limits()
    power: Power | None = None
    failsafes: Failsafes = Failsafes()
    capabilities: dict[Name, Capability] = {}
    devices: dict[Name, str] = {}
    """Where the data of sensors comes from, by device: URLs such as `v4l2:///dev/video0`."""
    cameras: dict[Name, CameraModel | str] = {}
    """How each camera is calibrated: a model, or a file such as `front.yaml#cam0`, relative to this one."""
    hosts: dict[Name, HostRow] = {}
    """The computers that the components run on; none for a single one."""
    components: tuple[ComponentRow, ...] = ()

    def local_frames(self) -> dict[str, LocalFrame]:
        """The frames by name."""
        return {name: row.frame() for name, row in self.frames.items()}

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


def load_platform(
    name: str,
    *,
    is_loading_classes: bool = False,
    devices: Collection[str] | None = None,
    warn: Callable[[Finding], None] | None = None,
) -> Platform:
    """Reads a platform by path, or by the name of one that an installed package brings; see `read_platform`.

    Raises:
        InputError: with everything that is wrong in it.
    """
    path = find_platform(name)
    return read_platform(load_bytes(path), str(path), is_loading_classes=is_loading_classes, devices=devices, warn=warn)


def find_platform(name: str) -> Path:
    """The file of a platform; plain names are looked up in the folders of the entry points `gloc3.platforms`.

    Raises:
        NotThere: there is none of that name.
    """
    path, known = Path(name), platform_files()
    if path.is_dir() and name not in known:
        raise NotThere([Finding(file=name, message="is a folder, not a platform file")])
    if path.suffix or path.is_file():
        return path
    if name not in known:
        raise NotThere([Finding(file=name, message="no such platform", hint=nearest(name, sorted(known)))])
    return known[name]


def platform_files() -> dict[str, Path]:
    """The files of all platforms that installed packages bring, by the files' names."""
    known: dict[str, Path] = {}
    for point in installed_points("gloc3.platforms"):
        for folder in point.load().__path__:
            known.update({file.stem: file for file in sorted(Path(folder).glob("*.yaml"))})
    return known


def read_platform(
    data: bytes | str,
    file: str,
    *,
    is_loading_classes: bool = False,
    devices: Collection[str] | None = None,
    warn: Callable[[Finding], None] | None = None,
) -> Platform:
    """Reads and checks a platform file.

    Args:
        data: its content.
        file: what the findings call it.
        is_loading_classes: whether the components' classes are imported, and ports, topics and settings checked against
            them.
        devices: with the classes: patterns of the devices that the host has; None does not check them.
        warn: takes what is doubtful in a file that can be used.

    Raises:
        InputError: with everything that is wrong in it.
    """
    from gloc3.platform_check import findings_of

    document = parse(data, file)
    findings: list[Finding] = []
    platform = schema.check(document.root, Platform, file, findings)
    if platform is not None:
        findings += findings_of(platform, document, is_loading_classes=is_loading_classes, devices=devices)
    if platform is None or any(not finding.is_warning for finding in findings):
        raise InputError(sorted(findings))
    if warn is not None:
        for finding in sorted(findings):
            warn(finding)
    return platform
