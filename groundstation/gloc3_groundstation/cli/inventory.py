"""`gloc3 network inventory`: versions, digests, hours and batteries of many vehicles."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import msgspec
from cyclopts import Parameter

from gloc3.cli.narration import ERROR, narrate
from gloc3.cli.tables import print_json, print_table
from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.command_interface import Hello, Inventory
from gloc3_groundstation.cli.fleet_session import open_fleet

if TYPE_CHECKING:
    from gloc3_groundstation.assembly import GroundStation

ANSWER_S: Final = 10.0
COLUMNS: Final = (
    "vehicle",
    "gloc3",
    "protocol",
    "platform",
    "autopilot",
    "hosts",
    "powered h",
    "armed h",
    "armed",
    "battery",
)
"""Of the table."""


def inventory(
    file: Path,
    /,
    *platforms: str,
    wait: float = 10.0,
    json: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """List versions, digests, hours and batteries of vehicles; observers may, too.

    Args:
        file: The network file of a station, whose own process does not run meanwhile.
        platforms: The vehicles; none for all in the network file.
        wait: Longest time until they are in contact, s.
        json: Print it as JSON, by vehicle.
    """
    if not 0.0 < wait < float("inf"):
        raise Refused("--wait must be above 0 seconds")
    return asyncio.run(_inventory(file, platforms, wait, is_json=json))


async def _inventory(file: Path, platforms: Sequence[str], wait_s: float, *, is_json: bool) -> int:
    async with open_fleet(str(file), platforms, wait_s) as fleet:
        answers = await asyncio.gather(*(_request(fleet.ground, name) for name in fleet.here))
        found = {name: one for name, one in zip(fleet.here, answers, strict=True) if one is not None}
        if is_json:
            print_json(found)
        else:
            print_table(COLUMNS, [_row(name, one) for name, one in found.items()])
        return 0 if len(found) == len(fleet.here) + len(fleet.missing) else 1


async def _request(ground: "GroundStation", name: str) -> Inventory | None:
    """What a vehicle answers; None, and a line, where it answers nothing that can be used."""
    try:
        reply = await ground.station.client.carry_out(name, Hello(is_about_inventory=True), ANSWER_S)
        if "inventory" not in reply.result:
            raise Refused("its software is older and has no inventory")
        return msgspec.convert(reply.result["inventory"], Inventory)
    except (Gloc3Error, msgspec.ValidationError) as error:
        narrate(f"{name}: {error}", ERROR)
        return None


def _row(name: str, one: Inventory) -> list[str]:
    percent = f"{one.battery_percent} %" if one.battery_percent >= 0 else "-"
    return [
        name,
        one.version,
        one.protocol,
        one.platform_digest,
        one.firmware or "-",
        ", ".join(one.hosts) or "-",
        f"{one.powered_s / 3600.0:.1f}",
        f"{one.armed_s / 3600.0:.1f}",
        f"{one.armings} times",
        percent + (f", {one.battery_v:.1f} V" if one.battery_v else ""),
    ]
