"""Plan of a flight in virtual time: mission, platform, weather and faults."""

from pathlib import Path
from typing import Final

import msgspec

from gloc3.mavlink.transport.memory import Conditions
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.faults.sabotage import CycleCost
from gloc3_sitl.physics.wind import CALM, Wind

STATION_RADIO: Final = Conditions(latency_s=0.03)
MISSION_FILE, WORLD_FILE = "mission.yaml", "world.yaml"
"""Files in the log of a flight, beside the platform's: the second where the world is none of the package."""


class FlightPlan(msgspec.Struct, kw_only=True, frozen=True):
    """Mission, platform, weather and faults of a flight."""

    mission: str
    """A file, or the name of an example."""
    platform: str = "pelican_rtk"
    name: str = ""
    """What the platform is called, where several are of one kind; empty for the name in its file."""
    autopilot: str = ""
    """`px4` or `ardupilot`; empty for the usual one of the vehicle."""
    is_firmware: bool = False
    """That autopilot's real firmware flies, in place of one of ours; `autopilot` names it then."""
    seed: int = 0
    wind: Wind = CALM
    waves_m: float = 0.0
    """Significant height of the waves, from the west; of what swims."""
    current_m_s: float = 0.0
    """Of the water, to the north."""
    out: Path | None = None
    """Folder for the log and the pictures; None keeps nothing."""
    parameters: dict[str, float] = {}
    """Of the autopilot, that differ from its defaults."""
    battery: float = 1.0
    """Charge at the start, 1 to 0."""
    world: str = ""
    """A world's name or file; where it is empty, the one that the mission's frame belongs to."""
    home: GeoPoint | None = None
    """Start position of a mission on Earth; None for the mission's first position."""
    terrain: Path | None = None
    """Folder of terrain tiles that the onboard process has; None for none."""
    is_plain_gps: bool = False
    member: str = ""
    """Member of a network for whom the keys of the station's radios stand; empty for none."""
    has_station: bool = True
    """Whether it has its own station; a fleet shares one."""
    station_link: Conditions = STATION_RADIO
    """Conditions between station and platform, in both directions."""
    radio_depth_m: float = float("inf")
    """A vehicle that is deeper below its frame's origin is not reached by the station's radio."""
    modem_period_s: float = 0.0
    """How often a summary goes to the station by an acoustic modem; 0 where there is none."""
    cycle_cost_s: CycleCost | None = None
    """What a cycle of a component costs at a time, faults aside; None for nothing."""
