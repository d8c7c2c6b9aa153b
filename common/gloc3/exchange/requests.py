"""Request and reply over any middleware: a message out, the first fitting reply or a time-out back."""

import asyncio
from typing import Any

from gloc3.exchange.base import Exchange, Publisher
from gloc3.messages.envelope import CommandRequest, Envelope, FunctionRequest, Message

REPLY_TOPICS = {CommandRequest: "reply", FunctionRequest: "function_reply"}


async def request(
    exchange: Exchange, publisher: Publisher, topic: str, message: CommandRequest | FunctionRequest, timeout_s: float
) -> Any:
    """Publishes a request on `PLATFORM/components/NAME/{command,function}` and waits for the reply.

    Raises:
        TimeoutError: no reply came within `timeout_s`. Whether the request was carried out is then *unknown*.
    """
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[Message] = loop.create_future()

    def take(envelope: Envelope[Any]) -> None:
        if envelope.payload.request_id == message.request_id and not answer.done():
            answer.set_result(envelope.payload)

    unsubscribe = exchange.subscribe(f"{topic.rpartition('/')[0]}/{REPLY_TOPICS[type(message)]}", take)
    try:
        publisher.publish(topic, message, loop.time())
        async with asyncio.timeout(timeout_s):
            return await answer
    finally:
        unsubscribe()
