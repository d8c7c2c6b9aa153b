"""End-to-end turnaround in wall time: from a pose's bytes on the autopilot link to the setpoint's bytes on it."""

import asyncio
import contextlib
import time
from statistics import quantiles
from typing import Any

from gloc3.mavlink.codec import Parser, shape
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

SECONDS = 12.0


async def fly() -> list[float]:
    """The delays of a flight, s."""
    delays: list[float] = []
    position, target = shape("LOCAL_POSITION_NED").id, shape("SET_POSITION_TARGET_LOCAL_NED").id
    async with Flight(FlightPlan(mission="hop")) as flight:
        arrived_s = 0.0
        receive: Any = flight.links.cable.b.on_data
        answer: Any = flight.links.cable.a.on_data

        def on_message(data: bytes) -> None:
            nonlocal arrived_s
            if any(frame.message_id == position for frame in Parser(is_datagram=True).receive(data)):
                arrived_s = time.perf_counter()
            receive(data)

        def handle(data: bytes) -> None:
            if any(frame.message_id == target for frame in Parser(is_datagram=True).receive(data)):
                delays.append(time.perf_counter() - arrived_s)
            answer(data)

        flight.links.cable.b.on_data, flight.links.cable.a.on_data = on_message, handle
        follower = await flight.upload_and_start()
        with contextlib.suppress(TimeoutError):
            await flight.await_end(follower, within_s=SECONDS)
    return delays


def run() -> list[str]:
    """Percentiles; the cable's modelled latency of 2 ms is in it."""
    delays = asyncio.run(fly())
    cuts = quantiles(delays, n=100)
    return [
        f"pose bytes in to setpoint bytes out, {len(delays)} setpoints, simulator in the same process",
        f"p50 {cuts[49] * 1e3:6.2f} ms    p99 {cuts[98] * 1e3:6.2f} ms    (2 ms of it are the modelled cable)",
    ]
