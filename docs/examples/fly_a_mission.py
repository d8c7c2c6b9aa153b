"""Flies a mission on the first vehicle of a link: python fly_a_mission.py LINK MISSION."""

import asyncio
import sys

from gloc3_groundstation.api import connect


async def main(link: str, mission: str) -> None:
    async with connect(link) as station:
        vehicle = await station.vehicle()
        await vehicle.upload(mission)
        await vehicle.start()
        async for line in vehicle.follow():
            print(line)
        print((await vehicle.end()).state)


asyncio.run(main(*sys.argv[1:]))
