"""Commands a vehicle, with or without a companion, step by step: python command_a_vehicle.py LINK COMMAND..."""

import asyncio
import sys

from gloc3_groundstation.api import NotDone, NotHeard, Refused, connect


async def main(link: str, *commands: str) -> None:
    async with connect(link) as station:
        vehicle = await station.vehicle()
        for command in commands:
            print(command, "->", await vehicle.command(command))


try:
    asyncio.run(main(*sys.argv[1:]))
except (Refused, NotDone, NotHeard) as error:
    sys.exit(f"not done: {error}")
