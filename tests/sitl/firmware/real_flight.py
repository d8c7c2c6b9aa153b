"""A flight of the real ArduCopter on our physics, judged by the truth."""

import asyncio
import math
import signal
from pathlib import Path
from typing import NamedTuple

from tests.sitl.firmware.guided_client import REBOOT, GuidedClient

from gloc3.log.reader import LogReader
from gloc3_sitl.firmware.body import BodySettings
from gloc3_sitl.firmware.run import FirmwareOptions, run_firmware
from gloc3_sitl.flight.messages import SimTruth
from gloc3_sitl.physics.wind import CALM, Wind
from gloc3_sitl.world import World

WAYPOINTS = ((5.0, 0.0, 3.0), (5.0, 5.0, 4.0), (0.0, 5.0, 3.0), (0.0, 0.0, 3.0))
HOVER_AT = WAYPOINTS[-1]


class Flown(NamedTuple):
    """What the truth says of a flight."""

    hover_rms_m: float
    hover_max_m: float
    misses_m: tuple[float, ...]
    """How near it came to each waypoint."""
    landed_m: float
    """Height at the end."""
    factor: float
    """Simulated seconds to one of the wall clock, of the whole flight."""
    code: int


async def fly(out: Path, *, speed: float, hover_s: float, wind: Wind = CALM) -> Flown:
    """Takes off, flies four waypoints, hovers at the last, lands, and reboots."""
    loop = asyncio.get_running_loop()
    async with GuidedClient() as client:
        running = asyncio.ensure_future(
            run_firmware(
                FirmwareOptions(
                    firmware="ardupilot",
                    world=World.load("open"),
                    body=BodySettings(wind=wind),
                    parameters={},
                    links=(client.url,),
                    port=0,
                    speed=speed,
                    out=out,
                )
            )
        )
        await client.get_ready()
        begin = (client.boot_s(), loop.time())
        await client.take_off(HOVER_AT[2])
        for waypoint in WAYPOINTS:
            await client.fly_to(*waypoint)
        await client.rest(3.0)
        hover_from_s = loop.time()
        await client.rest(hover_s)
        hover_to_s = loop.time()
        await client.land()
        factor = (client.boot_s() - begin[0]) / (loop.time() - begin[1])
        landed_s = loop.time()
        await client.command(REBOOT, 1)
        await client.until(lambda: client.texts.count("ArduPilot Ready") == 2, "its start anew")
        signal.raise_signal(signal.SIGINT)
        code = await running
    with LogReader(out / "truth.mcap") as reader:
        path = [
            (entry.envelope.t_s, entry.envelope.payload.position_ned_m)
            for entry in reader.entries("sim/truth")
            if isinstance(entry.envelope.payload, SimTruth)
        ]
    places = [(t_s, (n, e, -d)) for t_s, (n, e, d) in path]
    errors = [math.dist(place, HOVER_AT) for t_s, place in places if hover_from_s <= t_s <= hover_to_s]
    flown = [place for t_s, place in places if t_s <= landed_s]
    return Flown(
        hover_rms_m=math.sqrt(sum(error * error for error in errors) / len(errors)),
        hover_max_m=max(errors),
        misses_m=tuple(min(math.dist(place, waypoint) for place in flown) for waypoint in WAYPOINTS),
        landed_m=flown[-1][2],
        factor=factor,
        code=code,
    )
