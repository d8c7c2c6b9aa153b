"""All fuzz targets, in the order of the rooms that they belong to."""

from tests.fuzz.common import exchange, log, mavlink, mission, stores
from tests.fuzz.groundstation import desk, services
from tests.fuzz.onboard import autopilot, calibrating, command_server, datasets, sensors
from tests.fuzz.sitl import worlds
from tests.fuzz.target import TARGETS

__all__ = [
    "TARGETS",
    "autopilot",
    "calibrating",
    "command_server",
    "datasets",
    "desk",
    "exchange",
    "log",
    "mavlink",
    "mission",
    "sensors",
    "services",
    "stores",
    "worlds",
]
