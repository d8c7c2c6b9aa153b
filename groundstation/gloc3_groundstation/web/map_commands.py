"""Commands of the map page: hold, and going to a place after a confirmation; by the desk, as the terminal's."""

from typing import Final

from gloc3.errors import Refused
from gloc3.messages.command_interface import EmergencyVerb
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.go_here import GoToRequest, go_to_request, last_event
from gloc3_groundstation.mapping.ground import Ground
from gloc3_groundstation.web.map_data import key_of

MOVED: Final = "the map has another origin now: choose the place again"


def asked(desk: Desk, vehicle: str, key: str, north_m: float, east_m: float) -> GoToRequest:
    """The question for a place on a page's map.

    Args:
        desk: commands the vehicle.
        vehicle: its name.
        key: names the plane in which the place was chosen.
        north_m: of the plane's origin.
        east_m: of the plane's origin.

    Raises:
        Refused: the vehicle cannot be sent there, or the page's plane is another one.
    """
    platform = desk.station.fleet.get(vehicle)
    if platform is None:
        raise Refused(f"{vehicle} is not known")
    ground = Ground(platform)
    if key_of(ground) != key:
        raise Refused(MOVED)
    return go_to_request(desk, platform, ground, north_m, east_m)


async def hold(desk: Desk, vehicle: str) -> str:
    """Has a vehicle hold at once, as the emergency key does.

    Returns:
        What became of it, for the operator.

    Raises:
        Gloc3Error: it was refused, with the reason.
    """
    if desk.station.fleet.get(vehicle) is None:
        raise Refused("there is no vehicle in view")
    if not await desk.emergency(vehicle, EmergencyVerb.HOLD):
        raise Refused(last_event(desk, vehicle))
    return f"{vehicle}: HOLD accepted. Landing and disarming: HOLD in the terminal."
