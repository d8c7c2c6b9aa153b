"""Direct link to an autopilot, for commands that run while `gloc3 onboard` does not."""

import asyncio
from pathlib import Path

from gloc3.cli.narration import narrate
from gloc3.clock import Clock
from gloc3.mavlink.codec import Frame, Parser
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.signing import Signing, timestamp
from gloc3.mavlink.signing_key import read_signing_key
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint, parse_url
from gloc3.messages.envelope import Severity
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.companion.station_link import ONBOARD_CONTROLLER


def signing_of(url: str, clock: Clock) -> Signing | None:
    """Signing of a link whose URL names a key (`?key=FILE`); None without one.

    Raises:
        Refused: the URL is invalid.
        InputError: the file has no key, or others than its owner may read it.
    """
    file = parse_url(url).key
    if not file:
        return None
    return Signing(read_signing_key(Path(file).expanduser()), link_id=0, now=timestamp(clock.utc_s()))


class _DirectLink:
    """Frames to an endpoint, with nothing between."""

    def __init__(self, endpoint: Endpoint) -> None:
        self._endpoint = endpoint

    def send(self, frame: Frame) -> None:
        """Sends one frame."""
        self._endpoint.send(frame.raw)


async def open_direct(link: AutopilotLink, url: str, loop: asyncio.AbstractEventLoop) -> Endpoint:
    """Connects a link to the autopilot at a URL; nothing is routed.

    Raises:
        Refused: the URL is wrong, or the endpoint cannot be had.
    """
    parser = Parser()
    endpoint = await open_endpoint(url, loop, lambda data: link.receive_frames(parser.receive(data)))
    warn_of_exposure(url)
    link.open(_DirectLink(endpoint))
    return endpoint


def warn_of_exposure(url: str) -> None:
    """Warns about a link that is open to a network and not signed.

    Raises:
        Refused: the URL is wrong.
    """
    if warning := parse_url(url).warning(is_signed=False):
        narrate(warning, Severity.WARNING)


def heartbeat_of(own: Address) -> Heartbeat:
    """Our heartbeat: an autopilot that waits to be spoken to says nothing before it."""
    return Heartbeat(own, vehicle_type=ONBOARD_CONTROLLER)


def beat(heart: Heartbeat, link: AutopilotLink, now_s: float) -> None:
    """Sends a heartbeat when it is time."""
    heart.tick(now_s)
    for message in heart.outgoing():
        link.send_message(message)
