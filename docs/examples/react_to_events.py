"""Pauses a mission at its first task, looks at the vehicle's state, and resumes it: python react_to_events.py LINK MISSION."""

import asyncio
import sys

from gloc3_groundstation.api import connect


async def main(link: str, mission: str) -> None:
    async with connect(link) as station:
        vehicle = await station.vehicle(wait_s=30.0)
        await vehicle.upload(mission)
        await vehicle.start(wait_s=90.0)
        has_paused = False
        async for line in vehicle.follow():
            if line.kind == "action" and "running" in line.text and not has_paused:
                has_paused = True
                await vehicle.pause()
                await asyncio.sleep(3.0)
                state = vehicle.state.vehicle
                print("paused", "armed" if state is not None and state.value.is_armed else "disarmed")
                await vehicle.resume()
            if line.kind == "mission":
                print(line.text)


asyncio.run(main(*sys.argv[1:]))
