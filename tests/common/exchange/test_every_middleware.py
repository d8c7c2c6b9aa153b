"""What holds on every middleware alike: a component does not see which one it is on."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from tests.common.exchange.middlewares import ALL, EVENT, PLATFORM, TABLE, event, receive, until

from gloc3.exchange import Publisher
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import ComponentTable

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60), pytest.mark.parametrize("middleware", ALL)]


async def test_a_message_arrives_whole_with_its_envelope(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        received, _ = receive(ends.station, EVENT)
        await ends.reach(received)
        sent: list[Envelope[Any]] = []
        came: list[Envelope[Any]] = []
        ends.platform.subscribe(EVENT, sent.append)
        ends.station.subscribe(EVENT, came.append)
        ends.report("hello", t_s=1 / 3)
        await until(lambda: came)
        assert came == sent
        (envelope,) = came
        assert envelope.payload == event("hello")
        assert (envelope.t_s, envelope.frame, envelope.source.component) == (1 / 3, "hold", "ci")


async def test_messages_come_once_and_in_order_however_many_patterns_fit(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        received = [
            receive(ends.station, p)[0] for p in (EVENT, f"{PLATFORM}/ci/*", f"{PLATFORM}/**", "*/ci/ev*", "*/ci/e?ent")
        ]
        own, _ = receive(ends.platform, "**")
        await ends.reach(own, *received)
        wanted = [str(n) for n in range(50)]
        for text in wanted:
            ends.report(text)
        await until(lambda: all(wanted[-1] in texts for texts in received))
        assert received == [wanted] * len(received)
        assert own == wanted


async def test_subscriptions_come_and_go_at_any_time(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        received, end = receive(ends.station, EVENT)
        witness, _ = receive(ends.station, f"{PLATFORM}/**")
        await ends.reach(received, witness)
        ends.report("heard")
        await until(lambda: "heard" in witness)
        end()
        end()
        ends.report("too late")
        await until(lambda: "too late" in witness)
        assert (received, witness) == (["heard"], ["heard", "too late"])


async def test_who_listens_to_a_process_draws_nothing_into_it(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        recorded, _ = receive(ends.station.here, "**")
        requested, _ = receive(ends.station, EVENT)
        await ends.reach(recorded, requested)
        ends.report("not asked for", f"{PLATFORM}/ci/unknown")
        ends.report("asked for")
        await until(lambda: requested)
        assert recorded[-1:] == requested == ["asked for"]
        assert (len(recorded) == 1) == (ends.station is not ends.platform)


async def test_who_asks_late_gets_the_last_message_of_what_is_and_then_each_once(
    middleware: str, tmp_path: Path
) -> None:
    async with ALL[middleware](tmp_path) as ends:
        received, _ = receive(ends.station, EVENT)
        await ends.reach(received)
        tables: list[list[int]] = []

        def request(pattern: str) -> list[int]:
            seen: list[int] = []
            tables.append(seen)
            ends.station.subscribe(pattern, lambda e: seen.append(e.payload.table) if e.topic == TABLE else None)
            return seen

        publisher = Publisher(ends.platform, PLATFORM, "ci", 7)
        for number in (1, 2):
            publisher.publish(TABLE, ComponentTable(table=number, rows=[]), 0.25)
        await asyncio.sleep(0.2)
        first = request(TABLE)
        await until(lambda: first == [2])
        for pattern in (f"{PLATFORM}/ci/*", "**"):
            request(pattern)
        await until(lambda: tables == [[2], [2], [2]])
        publisher.publish(TABLE, ComponentTable(table=3, rows=[]), 0.25)
        await until(lambda: tables == [[2, 3], [2, 3], [2, 3]])


async def test_liveliness_tells_who_comes_who_is_here_and_who_goes(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        early: list[tuple[str, bool]] = []
        late: list[tuple[str, bool]] = []
        token = f"{PLATFORM}/pose"
        ends.station.watch(f"{PLATFORM}/*", lambda *reported: early.append(reported))
        ends.station.watch(f"{PLATFORM}/**", lambda *reported: early.append(reported))
        first = ends.platform.declare_alive(token)
        second = ends.platform.declare_alive(token)
        await until(lambda: early.count((token, True)) == 2)
        end = ends.station.watch(token, lambda *reported: late.append(reported))
        await until(lambda: late)
        first()
        second()
        second()
        await until(lambda: early.count((token, False)) == 2)
        await until(lambda: late == [(token, True), (token, False)])
        end()
        assert early.count((token, True)) == 2
