"""Messages on the setup of autopilot and onboard computer, the source of the pre-flight list."""

import msgspec

from gloc3.messages.envelope import Message
from gloc3.messages.link_traffic import LinkTraffic
from gloc3.messages.vehicle import Style, VehicleClass


class ReadSetup(Message, frozen=True):
    """Requests that the autopilot's setup is read again."""

    number: int
    """Grows with each time of asking."""


class AutopilotSetup(Message, frozen=True):
    """Identity and settings of the autopilot."""

    style: Style | None = None
    firmware: tuple[int, int, int] | None = None
    """Version of the flight software; None until it is reported."""
    is_official: bool = True
    """Whether the firmware is a release, and not of development."""
    parameters: dict[str, float] = {}
    """Those that matter to us, as far as they have been read."""
    unread: list[str] = []
    """Those that matter to us and were not answered."""
    sensors_present: int = 0
    """Bits of MAV_SYS_STATUS_SENSOR, from SYS_STATUS."""
    sensors_enabled: int = 0
    sensors_health: int = 0
    utc_minus_t_s: float | None = None
    """The autopilot's UTC minus our time; None where it has no UTC, or has not reported it."""
    number: int = 0
    """The last `ReadSetup` requested before this reading began; the reading has ended."""
    is_complete: bool = False
    """Whether a reading has ended since the autopilot came or restarted."""
    vehicle: VehicleClass | None = None
    rally_points: int | None = None
    """Number of rally points (PX4: safe points) that it holds; None where that was not read, or a parameter counts them."""
    clock_rate: float = 1.0
    """Its seconds in one of ours, where its clock is much too fast for ours, as in a simulation at a higher speed; else 1."""
    remote_id: str | None = None
    """Why its Remote ID is not good to arm; empty where it is, None where there is none that reports."""


class LinkCondition(msgspec.Struct, frozen=True, array_like=True):
    """One of the links of the onboard process."""

    url: str
    problem: str
    """Why it leads nowhere; empty where it does lead somewhere, as far as can be known."""
    bytes_received: int = 0
    traffic: LinkTraffic = LinkTraffic()
    """What has passed it."""
    intruder: str = ""
    """The recent peer that claims the id of another peer's autopilot; empty without one."""


class SensorCondition(msgspec.Struct, frozen=True, array_like=True):
    """One of the sensors that samplers read."""

    device: str
    source: str
    """Its URL."""
    problem: str = ""
    """Why it cannot be used, then after a semicolon what to do; empty while no problem is known."""
    age_s: float = -1.0
    """Since it brought something last; negative for never."""
    uncalibrated: list[str] = []
    """Its cameras without a calibration."""
    is_open: bool = False
    """Whether it was opened; else only properties that are known without opening are filled in."""


class ComputerState(Message, frozen=True):
    """The computer that runs the onboard process."""

    is_simulated: bool = False
    """In virtual time there is no computer of which anything could be measured."""
    disk_free_mb: float = 0.0
    """Of the folder for log and pictures, in 10^6 bytes."""
    disk_write_mb_s: float = 0.0
    """Measured when the process began, in 10^6 bytes a second; 0 where it could not be measured."""
    disk_problem: str = ""
    """Why that folder cannot be written; empty if it can."""
    log_problem: str = ""
    """Why the log is not written any more; empty while it is."""
    utc_minus_t_s: float | None = None
    """The computer's UTC minus our time."""
    links: list[LinkCondition] = []
    sensors: list[SensorCondition] = []
    log_mb_per_min: float = 0.0
    """How fast the log grows, in 10^6 bytes a minute; 0 where that is not known yet."""
