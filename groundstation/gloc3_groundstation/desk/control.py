"""Permissions of this station: who may look, and who may command a vehicle."""

from gloc3.errors import Refused
from gloc3.messages.command_interface import StationRole
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station


def require_operator(station: Station) -> None:
    """Checks that this station may command at all.

    Raises:
        Refused: it is an observer.
    """
    if station.client.role is StationRole.OBSERVER:
        raise Refused(f"station {station.id} may look and not command: it is an observer")


def holder_of(platform: PlatformSnapshot) -> str:
    """The station in control; empty where there is none."""
    return platform.control.value.holder if platform.control is not None else ""


def require_control(station: Station, name: str) -> None:
    """Checks that this station is in control of a vehicle; one without a companion is commanded by every operator.

    Raises:
        Refused: it is an observer, or another station or nobody is in control.
    """
    require_operator(station)
    platform = station.fleet.get(name)
    if platform is None or not platform.has_companion:
        return
    holder = holder_of(platform)
    if holder != station.id:
        whose = f"station {holder} is" if holder else "nobody is"
        raise Refused(f"{whose} in control of {name}; request control on the fleet screen first")
