"""The local middleware: order, patterns, liveliness, and subscribers that raise."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from gloc3.clock import run_virtual
from gloc3.exchange import LocalExchange, Publisher, base, request
from gloc3.messages.envelope import CommandReply, CommandRequest, Envelope, Message, Source


class Word(Message, frozen=True):
    """A word."""

    text: str


def in_loop(test: Callable[[LocalExchange], None]) -> None:
    """Runs a test within a loop."""

    async def main() -> None:
        test(LocalExchange())

    run_virtual(main())


def publisher(exchange: LocalExchange) -> Publisher:
    """Someone who publishes."""
    return Publisher(exchange, "p", "speaker", 7)


def test_a_message_passes_by_reference_with_its_envelope() -> None:
    def test(exchange: LocalExchange) -> None:
        got: list[Envelope[Any]] = []
        exchange.subscribe("p/word", got.append)
        word = Word(text="hello")
        publisher(exchange).publish("p/word", word, 1.5, "ned")
        (envelope,) = got
        assert envelope.payload is word
        assert (envelope.topic, envelope.t_s, envelope.frame, envelope.sequence) == ("p/word", 1.5, "ned", 0)
        assert (envelope.source.platform, envelope.source.component, envelope.source.boot) == ("p", "speaker", 7)
        assert envelope.type.startswith("Word#")

    in_loop(test)


def test_sequences_count_by_topic_and_start_anew_with_a_new_boot() -> None:
    def test(exchange: LocalExchange) -> None:
        got: list[Envelope[Any]] = []
        exchange.subscribe("**", got.append)
        speaker = publisher(exchange)
        for topic in ("p/a", "p/b", "p/a"):
            speaker.publish(topic, Word(text=""), 0.0)
        speaker.restart(8)
        speaker.publish("p/a", Word(text=""), 0.0)
        assert [(e.topic, e.sequence, e.source.boot) for e in got] == [
            ("p/a", 0, 7),
            ("p/b", 0, 7),
            ("p/a", 1, 7),
            ("p/a", 0, 8),
        ]

    in_loop(test)


def test_everybody_gets_messages_in_the_order_of_publishing_even_those_published_meanwhile() -> None:
    def test(exchange: LocalExchange) -> None:
        speaker = publisher(exchange)
        got: list[tuple[str, str]] = []

        def answer(envelope: Envelope[Word]) -> None:
            got.append(("first", envelope.payload.text))
            if envelope.payload.text == "question":
                speaker.publish("p/word", Word(text="answer"), 0.0)

        exchange.subscribe("p/word", answer)
        exchange.subscribe("p/word", lambda e: got.append(("second", e.payload.text)))
        speaker.publish("p/word", Word(text="question"), 0.0)
        assert got == [("first", "question"), ("second", "question"), ("first", "answer"), ("second", "answer")]

    in_loop(test)


def test_subscriptions_come_and_go_at_any_time() -> None:
    def test(exchange: LocalExchange) -> None:
        speaker = publisher(exchange)
        got: list[str] = []
        speaker.publish("p/word", Word(text="too early"), 0.0)
        end = exchange.subscribe("p/*", lambda e: got.append(e.payload.text))
        speaker.publish("p/word", Word(text="heard"), 0.0)
        end()
        end()
        speaker.publish("p/word", Word(text="too late"), 0.0)
        assert got == ["heard"]

    in_loop(test)


def test_a_subscriber_that_raises_harms_nobody_and_is_told_loudly() -> None:
    got: list[str] = []

    async def main() -> None:
        exchange = LocalExchange()

        def fail(envelope: Envelope[Any]) -> None:
            raise OSError("disk full")

        exchange.subscribe("p/word", fail)
        exchange.subscribe("p/word", lambda e: got.append(e.payload.text))
        exchange.watch("p/*", lambda token, is_alive: fail(None))  # type: ignore[arg-type]
        publisher(exchange).publish("p/word", Word(text="one"), 0.0)
        publisher(exchange).publish("p/word", Word(text="two"), 0.0)
        exchange.declare_alive("p/someone")

    with pytest.raises(OSError, match="disk full"):
        run_virtual(main())
    assert got == ["one", "two"]


def test_liveliness_tells_who_comes_who_is_here_and_who_goes() -> None:
    def test(exchange: LocalExchange) -> None:
        early: list[tuple[str, bool]] = []
        late: list[tuple[str, bool]] = []
        exchange.watch("p/components/*", lambda *reported: early.append(reported))
        first = exchange.declare_alive("p/components/pose")
        second = exchange.declare_alive("p/components/pose")
        end = exchange.watch("p/components/*", lambda *reported: late.append(reported))
        first()
        first()
        assert early == late == [("p/components/pose", True)]
        second()
        assert early == late == [("p/components/pose", True), ("p/components/pose", False)]
        end()
        exchange.declare_alive("p/components/pose")
        assert len(late) == 2

    in_loop(test)


def test_a_request_gets_the_reply_that_fits_and_leaves_no_subscription() -> None:
    async def main() -> None:
        exchange = LocalExchange()
        loop = asyncio.get_running_loop()
        server = Publisher(exchange, "p", "pose", 1)

        def serve(envelope: Envelope[CommandRequest]) -> None:
            for request_id in ("another", envelope.payload.request_id):
                reply = CommandReply(
                    request_id=request_id, component="pose", command="start", is_accepted=True, state=None
                )
                loop.call_later(0.5, server.publish, "p/components/pose/reply", reply, loop.time())

        exchange.subscribe("p/components/pose/command", serve)
        message = CommandRequest(request_id="mine", command="start")
        reply = await request(exchange, publisher(exchange), "p/components/pose/command", message, 1.0)
        assert reply.request_id == "mine"
        assert loop.time() == 0.5
        with pytest.raises(TimeoutError):
            await request(exchange, publisher(exchange), "p/components/nobody/command", message, 1.0)
        assert loop.time() == 1.5
        assert len(exchange._subscribers) == 1

    run_virtual(main())


def test_topics_that_others_invent_take_room_for_a_while_only() -> None:
    exchange = LocalExchange()
    received: list[str] = []
    exchange.subscribe("p/pose", lambda envelope: received.append(envelope.topic))
    for number in range(base.MOST_ROUTES + 5):
        exchange.publish(Envelope(f"invented/{number}", Source("p", "c", 1), 0, 0.0, "", "", None))
    exchange.publish(Envelope("p/pose", Source("p", "c", 1), 0, 0.0, "", "", None))
    assert received == ["p/pose"]
    assert len(exchange._routes) < 10
