"""A station without a screen for commands that speak to several vehicles, and end."""

import asyncio
import secrets
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from gloc3.cli.narration import ERROR, narrate
from gloc3.errors import NoContact, Refused, nearest

if TYPE_CHECKING:
    from gloc3_groundstation.assembly import GroundStation

ALL: Final = "all"
STATION_ID: Final = 254
"""Another one than that of a ground station which runs at the same time."""


class FleetSession(NamedTuple):
    """The station, and the vehicles."""

    ground: "GroundStation"
    here: list[str]
    """In contact."""
    missing: list[str]
    """Wanted, and not heard."""


@asynccontextmanager
async def open_fleet(
    source: str,
    wanted: Sequence[str],
    wait_s: float,
    system: int = STATION_ID,
    key: bytes | None = None,
) -> AsyncIterator[FleetSession]:
    """Opens a station, and waits for vehicles.

    Args:
        source: a MAVLink URL, or the network file of a station.
        wanted: names of vehicles; none for all that the network file knows, or that are heard on the link.
        wait_s: longest time until they are in contact, s.
        system: the station's MAVLink system.
        key: signs the link; None for a link that is not signed.

    Raises:
        InputError: the network file has errors.
        Refused: the network has no such vehicle.
        NoContact: none is heard.
    """
    from gloc3.network.access import MemberRole
    from gloc3_groundstation.assembly import GroundStation, StationSetup, read_membership
    from gloc3_groundstation.desk import flights

    is_link = "://" in source
    network = read_membership(None if is_link else Path(source))
    names = list(wanted)
    if network is not None:
        roles = network.file.roles
        known = sorted({member.partition(".")[0] for member, role in roles.items() if role is MemberRole.PLATFORM})
        for name in names:
            if name not in known:
                raise Refused(f"the network has no platform {name!r}; {nearest(name, known)}")
        names = names or known
        network = network.watching(names)
    setup = StationSetup(boot=secrets.randbits(32), system=system, signing_key=key, network=network)
    ground = GroundStation(setup, report=narrate)
    try:
        await ground.open([source] if is_link else [])
        station = ground.station

        def here() -> list[str]:
            found = [one.name for one in station.fleet if one.has_companion and one.is_known]
            return [name for name in names if name in found] if names else found

        with suppress(TimeoutError):
            async with asyncio.timeout(wait_s):
                if names:
                    await flights.until(station, lambda: len(here()) == len(names))
                else:
                    await flights.await_platforms(station)
        found = here()
        missing = [name for name in names if name not in found]
        if not found:
            raise NoContact(f"no vehicle was heard within {wait_s:g} s at {ground.links.describe()}: is one running?")
        for name in missing:
            narrate(f"{name}: did not respond within {wait_s:g} s", ERROR)
        yield FleetSession(ground, found, missing)
    finally:
        await ground.close()
