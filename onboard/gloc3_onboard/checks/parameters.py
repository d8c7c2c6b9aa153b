"""The form of the parameter tables: which autopilot parameters matter before a start, and what their values mean."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

RequestParameters = Callable[[str], float | None]
"""A parameter's value; None where it has not been read."""

CONTINUE, HOLD, RETURN, LAND = "continue", "hold", "return", "land"
"""Autopilot actions, as in the platform file."""
DISARM, TERMINATE, PILOT = "disarm", "terminate", "give the pilot control"
"""What no platform file allows."""


class Failsafe(NamedTuple):
    """One of the autopilot's failsafes."""

    parameter: str
    """Chooses the action; empty where the style always does the same."""
    actions: Mapping[int, str]
    """Actions by parameter value; with an empty parameter, 0 is the action."""
    limit: Callable[[RequestParameters], float | None] = lambda _: None
    """When it acts: seconds, or share of the battery; None where that is not known or does not matter."""
    limit_parameters: tuple[str, ...] = ()
    """What the limit is made of."""
    exempt: tuple[str, int] | None = None
    """A parameter and the bit of it by which nothing is done while it follows our setpoints."""
    enabled_by: str = ""
    """A parameter that is 0 where nothing is done."""
    volts: str = ""
    """A parameter with a voltage at which it acts, too; 0 for none."""


class ReturnTable(NamedTuple):
    """The autopilot's own return: to a height, straight home, and down."""

    heights: Mapping[str, float]
    """The parameter of its least height above home by its names in several versions, to its unit in metres."""
    climbs: Mapping[str, float] = {}
    """The same of the least climb from where it is."""
    hover_heights: Mapping[str, float] = {}
    """The same of the height of a return on rotors, of what has wings, too."""
    radii: tuple[str, ...] = ()
    """Parameters of the radius of the circle over home in which it ends, in metres; the first that is not 0 counts."""
    circles: tuple[str, str] | None = None
    """A parameter that is 0 where it circles over home until somebody lands it, and how to have it land."""
    lands: str = ""
    """A parameter that is 0 where it ends at home or at a rally point."""
    rally: str = ""
    """A parameter that counts the rally points that it holds."""


class FenceLimit(NamedTuple):
    """A limit of the autopilot's own fence; 0 is none where `kind` is 0."""

    parameter: str
    """In metres from home."""
    reach: str
    """Which reach of a mission it limits: `away`, `up` or `down`."""
    kind: int = 0
    """The bit of `FenceTable.kinds` that selects it; 0 where its value alone does."""


class FenceTable(NamedTuple):
    """The autopilot's own fence."""

    breach: Failsafe
    """What it does when the vehicle leaves the fence."""
    limits: tuple[FenceLimit, ...]
    kinds: str = ""
    """A parameter whose bits select the enforced limits, with `POLYGONS` for uploaded ones; empty where all are."""
    enabled_by: str = ""
    """A parameter that is 0 while the fence needs a command to be enabled."""


POLYGONS = 4
"""The bit of ArduPilot's FENCE_TYPE for uploaded polygons and circles."""


class StyleTable(NamedTuple):
    """The parameters that are read from an autopilot, and their meaning."""

    least_firmware: tuple[int, int, int]
    """Oldest supported firmware version."""
    link_loss: Failsafe
    low_battery: Failsafe
    pose_lost: Failsafe
    setpoints_lost: Failsafe
    fence: FenceTable
    calibrated: Mapping[str, str]
    """Parameters that are 0 until a sensor has been calibrated, and the sensor."""
    arming_checks: Mapping[str, float]
    """The parameter of the arming checks by the names of several versions, and its value while all are made."""
    doubtful: Mapping[str, tuple[float, str]] = {}
    """Parameter values that deserve a warning, and their effect."""
    hindering: Mapping[str, tuple[tuple[float, ...], str, float]] = {}
    """Parameters with values by which our paths are not flown, what they do, and a value that does not."""
    ignoring_pilot: Mapping[str, tuple[tuple[float, ...], str, float]] = {}
    """The same of values by which a pilot's transmitter is ignored; wrong where a pilot stands by."""
    own_return: ReturnTable = ReturnTable({})
    """Without heights where it does not climb."""
    critical_battery: Failsafe = Failsafe("", {0: CONTINUE})
    transmitter_lost: Failsafe = Failsafe("", {0: CONTINUE})
    """Of a pilot who stands by."""
    dead_reckoning: Failsafe = Failsafe("", {0: CONTINUE})
    """Without satellites, while the position is reckoned on."""

    @property
    def alternatives(self) -> tuple[str, ...]:
        """Names of which a vehicle has one or another, by its version."""
        return (*self.arming_checks, *self.own_return.heights, *self.own_return.climbs)

    @property
    def failsafes(self) -> dict[str, Failsafe]:
        """All of them, by what brings them about."""
        return {
            "link loss": self.link_loss,
            "low battery": self.low_battery,
            "critical battery": self.critical_battery,
            "transmitter lost": self.transmitter_lost,
            "setpoints lost": self.setpoints_lost,
            "position lost": self.pose_lost,
            "dead reckoning": self.dead_reckoning,
            "fence": self.fence.breach,
        }

    def names(self) -> tuple[str, ...]:
        """Every parameter that is to be read."""
        found: dict[str, None] = {}
        fence = self.fence
        for failsafe in self.failsafes.values():
            exempt = failsafe.exempt[0] if failsafe.exempt is not None else ""
            found |= dict.fromkeys((failsafe.parameter, failsafe.enabled_by, *failsafe.limit_parameters, exempt))
            found |= dict.fromkeys((failsafe.volts,))
        found |= dict.fromkeys((fence.kinds, fence.enabled_by, *(limit.parameter for limit in fence.limits)))
        found |= dict.fromkeys((*self.calibrated, *self.arming_checks, *self.doubtful, *self.hindering))
        found |= dict.fromkeys(self.ignoring_pilot)
        own = self.own_return
        found |= dict.fromkeys((*own.heights, *own.climbs, *own.hover_heights, *own.radii, own.lands, own.rally))
        found |= dict.fromkeys(own.circles[:1] if own.circles is not None else ())
        return tuple(name for name in found if name)


def share_of(part: str, whole: str) -> Callable[[RequestParameters], float | None]:
    """A limit that is one parameter as a share of another."""

    def share(request: RequestParameters) -> float | None:
        left, all_of_it = request(part), request(whole)
        return None if left is None or not all_of_it else left / all_of_it

    return share


def value_of(name: str) -> Callable[[RequestParameters], float | None]:
    """A limit that is a parameter."""
    return lambda request: request(name)
