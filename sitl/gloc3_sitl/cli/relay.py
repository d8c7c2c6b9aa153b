"""`gloc3 relay`: passes datagrams between two addresses over a simulated link with limited rate, latency and loss."""

import asyncio
import signal
from random import Random
from typing import Final, Literal

from cyclopts import App
from msgspec.structs import replace

from gloc3.cli.narration import narrate
from gloc3.errors import Refused
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint, parse_url
from gloc3.mavlink.transport.memory import ACOUSTIC, Conditions, MemoryEnd, MemoryLink
from gloc3.messages.envelope import Severity

KINDS: Final = {
    "perfect": Conditions(),
    "radio": Conditions(latency_s=0.03, loss=0.02, bandwidth_bit_s=57_600.0, bits_per_byte=10.0),
    "acoustic": ACOUSTIC,
}
ADVICE: Final = "it passes signed frames on, so sign at both ends, or listen on 127.0.0.1"
HALF_DUPLEX: Final = ("radio", "acoustic")

app = App(
    name="gloc3 relay",
    help="""Pass datagrams between two addresses over a simulated link, until Ctrl-C.

    For example, an acoustic modem between an onboard process and a station, all on this machine:

    - `gloc3 onboard auv --acoustic udpout://127.0.0.1:15001`
    - `gloc3 relay udpin://127.0.0.1:15001 udpout://127.0.0.1:15002 --link acoustic`
    - `gloc3 station --acoustic auv=udpin://127.0.0.1:15002`

    Commands go back over the same link once a summary has arrived.""",
    help_format="markdown",
    version_flags=[],
)


@app.default
def relay(
    one: str,
    other: str,
    /,
    *,
    link: Literal["perfect", "radio", "acoustic"] = "perfect",
    rate: float | None = None,
    latency: float | None = None,
    loss: float | None = None,
    seed: int = 0,
) -> int:
    """Pass datagrams between two addresses.

    Args:
        one: A MAVLink-style URL: udpin://HOST:PORT, udpout://, tcpin://, tcpout:// or serial://.
        other: The URL of the other end.
        link: Kind of link: perfect, radio (57,600 baud, 30 ms, 2 % lost) or acoustic (80 bit/s, 2 to 3 s, 10 %
            lost); in the last two both directions share the line.
        rate: Bit rate in bit/s, instead of the link's; 0 for no limit.
        latency: Latency in seconds, instead of the link's.
        loss: Share of the datagrams that is lost, 0 to 1, instead of the link's.
        seed: Seed of losses and delays.
    """
    for url in (one, other):
        parse_url(url).check_unkeyed("gloc3 relay")
    conditions = KINDS[link]
    for name, value, most in (("--rate", rate, 1e12), ("--latency", latency, 3600.0), ("--loss", loss, 1.0)):
        if value is not None and not 0.0 <= value <= most:
            raise Refused(f"{name} must be from 0 to {most:g}")
    if rate is not None:
        conditions = replace(conditions, bandwidth_bit_s=rate or None)
    if latency is not None:
        conditions = replace(conditions, latency_s=latency)
    if loss is not None:
        conditions = replace(conditions, loss=loss)
    return asyncio.run(_relay(one, other, conditions, seed, is_half_duplex=link in HALF_DUPLEX))


async def _relay(one: str, other: str, conditions: Conditions, seed: int, *, is_half_duplex: bool) -> int:
    loop, over = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, over.set)
    link = MemoryLink(loop, Random(seed), conditions, is_half_duplex=is_half_duplex)
    endpoints = [await _joined(one, link.a, loop), await _joined(other, link.b, loop)]
    narrate(f"relaying between {' and '.join(map(_address, endpoints))}")
    for url in (one, other):
        if warning := parse_url(url).warning(is_signed=False, advice=ADVICE):
            narrate(warning, Severity.WARNING)
    try:
        await over.wait()
    finally:
        for endpoint in endpoints:
            await endpoint.close()
    passed = f"{link.a.sent + link.b.sent} datagrams; {link.a.lost + link.b.lost} lost"
    narrate(f"{passed}, {link.a.dropped + link.b.dropped} dropped from full queues")
    return 0


def _address(endpoint: Endpoint) -> str:
    """Address of an endpoint, also where the URL asked for any free port."""
    return endpoint.url.replace(":0", f":{endpoint.local_port}") if endpoint.url.endswith(":0") else endpoint.url


async def _joined(url: str, end: MemoryEnd, loop: asyncio.AbstractEventLoop) -> Endpoint:
    endpoint = await open_endpoint(url, loop, end.send)
    end.on_data = endpoint.send
    return endpoint
