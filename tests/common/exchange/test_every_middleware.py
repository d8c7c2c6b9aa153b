"""What holds on every middleware alike: a component does not see which one it is on."""

from pathlib import Path
from typing import Any

import pytest
from tests.common.exchange.middlewares import ALL, EVENT, PLATFORM, event, hear, until

from gloc3.messages import Envelope

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60), pytest.mark.parametrize("middleware", ALL)]


async def test_a_message_arrives_whole_with_its_envelope(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        heard, _ = hear(ends.station, EVENT)
        await ends.reach(heard)
        sent: list[Envelope[Any]] = []
        came: list[Envelope[Any]] = []
        ends.platform.subscribe(EVENT, sent.append)
        ends.station.subscribe(EVENT, came.append)
        ends.say("hello", t_s=1 / 3)
        await until(lambda: came)
        assert came == sent
        (envelope,) = came
        assert envelope.payload == event("hello")
        assert (envelope.t_s, envelope.frame, envelope.source.component) == (1 / 3, "hold", "ci")


async def test_messages_come_once_and_in_order_however_many_patterns_fit(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        heard = [
            hear(ends.station, p)[0] for p in (EVENT, f"{PLATFORM}/ci/*", f"{PLATFORM}/**", "*/ci/ev*", "*/ci/e?ent")
        ]
        own, _ = hear(ends.platform, "**")
        await ends.reach(own, *heard)
        wanted = [str(n) for n in range(50)]
        for text in wanted:
            ends.say(text)
        await until(lambda: all(wanted[-1] in texts for texts in heard))
        assert heard == [wanted] * len(heard)
        assert own == wanted


async def test_subscriptions_come_and_go_at_any_time(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        heard, end = hear(ends.station, EVENT)
        witness, _ = hear(ends.station, f"{PLATFORM}/**")
        await ends.reach(heard, witness)
        ends.say("heard")
        await until(lambda: "heard" in witness)
        end()
        end()
        ends.say("too late")
        await until(lambda: "too late" in witness)
        assert (heard, witness) == (["heard"], ["heard", "too late"])


async def test_who_listens_to_a_process_draws_nothing_into_it(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        recorded, _ = hear(ends.station.here, "**")
        asked, _ = hear(ends.station, EVENT)
        await ends.reach(recorded, asked)
        ends.say("not asked for", f"{PLATFORM}/ci/unknown")
        ends.say("asked for")
        await until(lambda: asked)
        assert recorded[-1:] == asked == ["asked for"]
        assert (len(recorded) == 1) == (ends.station is not ends.platform)


async def test_liveliness_tells_who_comes_who_is_here_and_who_goes(middleware: str, tmp_path: Path) -> None:
    async with ALL[middleware](tmp_path) as ends:
        early: list[tuple[str, bool]] = []
        late: list[tuple[str, bool]] = []
        token = f"{PLATFORM}/pose"
        ends.station.watch(f"{PLATFORM}/*", lambda *told: early.append(told))
        ends.station.watch(f"{PLATFORM}/**", lambda *told: early.append(told))
        first = ends.platform.declare_alive(token)
        second = ends.platform.declare_alive(token)
        await until(lambda: early.count((token, True)) == 2)
        end = ends.station.watch(token, lambda *told: late.append(told))
        await until(lambda: late)
        first()
        second()
        second()
        await until(lambda: early.count((token, False)) == 2)
        await until(lambda: late == [(token, True), (token, False)])
        end()
        assert early.count((token, True)) == 2
