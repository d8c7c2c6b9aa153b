"""A process of its own on the network: says what it hears, answers commands, and ends as it is told."""

import asyncio
import sys

from gloc3.exchange import Publisher
from gloc3.exchange.zenoh import open_exchange
from gloc3.exchange.zenoh_session import ZenohEndpoints
from gloc3.messages.envelope import CommandReply, CommandRequest, Envelope
from gloc3.messages.topics import TopicTable


async def live(place: str) -> None:
    """Serves commands until one says how to end."""
    node = ZenohEndpoints(name="child", connect=(place,), is_child=True)
    with open_exchange(node, asyncio.get_running_loop(), TopicTable()) as exchange:
        publisher = Publisher(exchange, "p", "child", 1)
        ended: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        def serve(envelope: Envelope[CommandRequest]) -> None:
            request = envelope.payload
            reply = CommandReply(
                request_id=request.request_id, component="child", command=request.command, is_accepted=True, state=None
            )
            publisher.publish("p/components/child/reply", reply, 0.0)
            if request.command in ("leave", "fail") and not ended.done():
                ended.set_result(request.command)

        exchange.subscribe("p/components/child/command", serve)
        exchange.declare_alive("p/processes/child")
        if await ended == "fail":
            raise RuntimeError("as was asked")


if __name__ == "__main__":
    asyncio.run(live(sys.argv[1]))
