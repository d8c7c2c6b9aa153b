"""An autopilot's or station's link on an endpoint of its own, with no other link to route to."""

import asyncio
from typing import Protocol

from gloc3.mavlink.codec import Frame
from gloc3.mavlink.message import Address
from gloc3.mavlink.router import Router
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint
from gloc3.mavlink.transport.memory import MemoryEnd
from gloc3_onboard.autopilot.link import FrameLink
from gloc3_onboard.companion.routing import RoutedLink


class LinkUser(Protocol):
    """Handles the frames of a link, and sends by it."""

    def receive_frames(self, frames: list[Frame]) -> None:
        """Handles frames."""

    def open(self, link: FrameLink) -> None:
        """Begins to send."""


def routed_link(user: LinkUser, url: str, loop: asyncio.AbstractEventLoop) -> RoutedLink:
    """The only link of a router, whose frames a user gets."""
    return RoutedLink(url, Router(Address(1, 191)), loop, [user.receive_frames])


def wire(user: LinkUser, end: MemoryEnd, loop: asyncio.AbstractEventLoop) -> RoutedLink:
    """Connects a user to one end of a link in memory."""
    link = routed_link(user, "udpout://127.0.0.1:1", loop)
    end.on_data = link.receive
    link.open(end)
    user.open(link)
    return link


async def wire_url(user: LinkUser, url: str, loop: asyncio.AbstractEventLoop) -> Endpoint:
    """Connects a user to an endpoint, which is opened."""
    link = routed_link(user, url, loop)
    endpoint = await open_endpoint(url, loop, link.receive)
    link.open(endpoint)
    user.open(link)
    return endpoint
