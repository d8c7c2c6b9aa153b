"""A request ends with its reply, or as unknown; it is asked about before it is sent again."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from gloc3.clock import run_virtual
from gloc3.exchange import LocalExchange
from gloc3.exchange.base import Publisher
from gloc3.exchange.tunnel.events import Undelivered
from gloc3.messages.command_interface import (
    AnyBody,
    CiReply,
    CiRequest,
    Hello,
    LoadMission,
    Outcome,
    Query,
    ReadMission,
)
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import Health, Summary
from gloc3_groundstation.station.command_client import PATIENCE_S, CommandClient


class Stage:
    """A client, and what it sends to platforms that answer as the test says."""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.exchange = LocalExchange()
        self.sent: list[Envelope[CiRequest]] = []
        self.sent_s: list[float] = []
        self.on_sent: Callable[[Envelope[CiRequest]], None] = lambda _: None
        self.exchange.subscribe("*/ci/request", self._receive)
        self.client = CommandClient(self.exchange, self.loop, "255", 5)

    def _receive(self, envelope: Envelope[CiRequest]) -> None:
        self.sent.append(envelope)
        self.sent_s.append(self.loop.time())
        self.on_sent(envelope)

    def request(self, body: AnyBody, timeout_s: float = 10.0, platform: str = "a") -> asyncio.Future[CiReply]:
        return self.loop.create_task(self.client.request(platform, body, timeout_s))

    def take(self) -> list[Envelope[CiRequest]]:
        """What was sent since the last time."""
        used, self.sent = self.sent, []
        return used

    def answer(
        self, envelope: Envelope[CiRequest], outcome: Outcome = Outcome.ACCEPTED, boot: int = 5, platform: str = "a"
    ) -> None:
        request = envelope.payload
        reply = CiReply(sender=request.sender, boot=boot, sequence=request.sequence, outcome=outcome)
        Publisher(self.exchange, platform, "server", 1).publish(f"{platform}/ci/reply", reply, self.loop.time())

    def lose(self, envelope: Envelope[CiRequest], reason: str, *, is_certain: bool) -> None:
        self.client.undelivered(Undelivered(envelope, None, is_certain, reason))


def play(steps: Callable[[Stage], Awaitable[None]]) -> None:
    async def main() -> None:
        stage = Stage()
        try:
            await steps(stage)
        finally:
            stage.client.close()

    run_virtual(main())


def test_a_request_ends_by_the_platform_s_own_clock_as_it_ends_for_the_operator() -> None:
    async def steps(stage: Stage) -> None:
        platform = Publisher(stage.exchange, "a", "command_server", 4)
        summary = Summary(table=0, health=Health.WORKING, lines=[])
        stage.request(Hello())
        for late_s in (0.9, 0.2, 1.4):
            await asyncio.sleep(1.0)
            platform.publish("a/ci/summary", summary, stage.loop.time() + 7000.0 - late_s)
        stage.request(Hello(), timeout_s=6.0)
        await asyncio.sleep(0.0)
        unknown, known = [one.payload for one in stage.take() if isinstance(one.payload.body, Hello)]
        assert unknown.until_s == 0.0, "it has not learned the clock yet"
        assert 7008.7 < known.until_s <= 7008.8, "behind by the shortest latency"
        restarted = Publisher(stage.exchange, "a", "command_server", 5)
        restarted.publish("a/ci/summary", summary, 2.0)
        stage.request(Hello(), timeout_s=6.0)
        await asyncio.sleep(0.0)
        assert stage.take()[-1].payload.until_s == 8.0

    play(steps)


def test_a_reply_ends_its_request_and_only_its_own() -> None:
    async def steps(stage: Stage) -> None:
        first, second = stage.request(Hello()), stage.request(Hello())
        await asyncio.sleep(0.1)
        one, two = stage.take()
        stage.answer(two, boot=4)
        stage.answer(two, platform="b")
        await asyncio.sleep(0.1)
        assert not first.done()
        assert not second.done()
        stage.answer(two)
        await asyncio.sleep(0.1)
        assert second.done()
        assert not first.done()
        stage.answer(one)
        assert (await first).outcome is Outcome.ACCEPTED
        await asyncio.sleep(60.0)
        assert stage.take() == []

    play(steps)


def test_requests_are_counted_for_each_platform() -> None:
    async def steps(stage: Stage) -> None:
        waiting = [stage.request(Hello(), platform=platform) for platform in ("a", "a", "b")]
        await asyncio.sleep(0.1)
        sent = [(one.topic.partition("/")[0], one.payload.sequence) for one in stage.take()]
        assert sent == [("a", 0), ("a", 1), ("b", 0)]
        await asyncio.gather(*waiting)

    play(steps)


def test_a_late_reply_is_asked_for_and_the_answer_counts_as_the_reply() -> None:
    async def steps(stage: Stage) -> None:
        waiting = stage.request(ReadMission())
        await asyncio.sleep(PATIENCE_S + 0.1)
        _, query = stage.take()
        assert query.payload.body == Query(boot=5, sequence=0)
        assert stage.sent_s[1] == PATIENCE_S
        stage.answer(query, Outcome.REFUSED)
        assert await waiting == CiReply(sender="255", boot=5, sequence=0, outcome=Outcome.REFUSED)

    play(steps)


def test_what_never_arrived_is_sent_again_under_its_id() -> None:
    async def steps(stage: Stage) -> None:
        waiting = stage.request(ReadMission())
        await asyncio.sleep(2.5)
        original, query = stage.take()
        stage.answer(query, Outcome.UNKNOWN)
        (again,) = stage.take()
        assert again.payload == original.payload
        stage.answer(again)
        assert (await waiting).outcome is Outcome.ACCEPTED

    play(steps)


def test_a_request_whose_end_the_platform_itself_does_not_know_is_unknown() -> None:
    async def steps(stage: Stage) -> None:
        stage.on_sent = lambda sent: stage.answer(sent, Outcome.UNKNOWN)
        assert (await stage.request(ReadMission())).outcome is Outcome.UNKNOWN
        assert stage.loop.time() == 0.0

    play(steps)


def test_without_any_answer_the_outcome_is_unknown_and_says_who_was_silent() -> None:
    async def steps(stage: Stage) -> None:
        ended = await stage.request(ReadMission(), 3.0)
        assert (ended.outcome, ended.reason) == (Outcome.UNKNOWN, "a has not answered for 3 s")
        assert stage.loop.time() == 3.0
        stage.take()
        await asyncio.sleep(60.0)
        assert stage.take() == []

    play(steps)


def test_a_long_mission_is_given_time_before_it_is_asked_about() -> None:
    async def steps(stage: Stage) -> None:
        await stage.request(LoadMission(name="m", text="x" * 20_000), 60.0)
        assert stage.sent_s[:2] == [0.0, PATIENCE_S + 20.0]

    play(steps)


@settings(max_examples=60)
@given(st.lists(st.sampled_from(["lose", *Outcome]), max_size=12), st.floats(0.1, 3.0))
def test_every_request_ends_exactly_once_in_time_whatever_is_answered(script: list[str], delay_s: float) -> None:
    async def steps(stage: Stage) -> None:
        answers = iter(script)

        def respond(sent: Envelope[Any]) -> None:
            answer = next(answers, "lose")
            if answer != "lose":
                stage.loop.call_later(delay_s, stage.answer, sent, Outcome(answer))

        stage.on_sent = respond
        await stage.request(ReadMission(), 8.0)
        assert stage.loop.time() <= 8.0
        stage.take()
        await asyncio.sleep(60.0)
        assert stage.take() == []

    play(steps)


def test_what_the_link_surely_never_delivered_is_refused_at_once() -> None:
    async def steps(stage: Stage) -> None:
        waiting = stage.request(ReadMission())
        await asyncio.sleep(0.1)
        (original,) = stage.take()
        stage.lose(replace(original, topic="b/ci/request"), "that is another platform", is_certain=True)
        assert not waiting.done()
        stage.lose(original, "versions differ", is_certain=True)
        ended = await waiting
        assert (ended.outcome, ended.sequence, ended.reason) == (Outcome.REFUSED, 0, "not delivered: versions differ")
        assert stage.loop.time() == 0.1

    play(steps)


def test_what_may_have_been_delivered_is_asked_about_at_once_and_else_unknown() -> None:
    async def steps(stage: Stage) -> None:
        waiting = stage.request(ReadMission())
        await asyncio.sleep(0.5)
        (original,) = stage.take()
        stage.lose(original, "no answer from a", is_certain=False)
        await asyncio.sleep(0.1)
        (query,) = stage.take()
        assert query.payload.body == Query(boot=5, sequence=0)
        assert stage.sent_s[1] == 0.5
        stage.lose(query, "nobody heard", is_certain=True)  # the question, not what it is about
        stage.lose(original, "nobody heard", is_certain=True)  # too late to be sure again
        assert not waiting.done()
        ended = await waiting
        assert ended.outcome is Outcome.UNKNOWN
        assert ended.reason == "it may have been delivered (nobody heard), and a has not answered for 10 s"

    play(steps)


def test_of_a_request_that_was_sent_twice_one_loss_proves_nothing() -> None:
    async def steps(stage: Stage) -> None:
        waiting = stage.request(ReadMission())
        await asyncio.sleep(2.5)
        original, query = stage.take()
        stage.answer(query, Outcome.UNKNOWN)
        (again,) = stage.take()
        assert again.payload == original.payload
        stage.lose(again, "nobody heard", is_certain=True)
        assert not waiting.done()
        assert [type(one.payload.body) for one in stage.take()] == [Query]
        await waiting

    play(steps)


def test_a_client_that_is_closed_lets_nobody_wait() -> None:
    async def steps(stage: Stage) -> None:
        waiting = stage.request(ReadMission())
        await asyncio.sleep(0.1)
        stage.client.close()
        await asyncio.sleep(0.1)
        assert waiting.cancelled()

    play(steps)
