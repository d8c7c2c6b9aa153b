"""The command client over an exchange, in virtual time: uploads are read back, refusals and silence are told apart."""

from collections.abc import Awaitable, Callable
from typing import TypeVar

import pytest
from tests.groundstation.scripted_platform import ScriptedPlatform, lost, refused, reply_to

from gloc3.clock import run_virtual
from gloc3.exchange import LocalExchange
from gloc3.exchange.tunnel.routes import EMERGENCY_PATIENCE_S, REQUEST_TIMEOUT_S
from gloc3.messages.command_interface import EmergencyVerb, Hello, LoadMission, Outcome, Query, ReadMission, Steer, Verb
from gloc3_groundstation.station.command_client import (
    EMERGENCY_TIMEOUT_S,
    TIMEOUT_S,
    CommandClient,
    Declined,
    ReadBackDiffers,
    Unanswered,
)

T = TypeVar("T")
MISSION = "mission: cargo hold\nframe: hold\n"


def with_platform(play: Callable[[CommandClient, ScriptedPlatform], Awaitable[T]]) -> T:
    async def main() -> T:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        client = CommandClient(exchange, platform.loop, "255", 11)
        try:
            return await play(client, platform)
        finally:
            client.close()

    return run_virtual(main())


def test_a_request_is_answered() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> None:
        assert (await client.request("heron", Hello())).outcome is Outcome.ACCEPTED
        assert platform.loop.time() == pytest.approx(0.05)

    with_platform(play)


def test_an_upload_is_read_back() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> None:
        await client.upload("heron", "hold.yaml", MISSION)
        assert platform.text == MISSION
        assert [type(body) for body in platform.requests] == [LoadMission, ReadMission]

    with_platform(play)


def test_a_mission_that_is_read_back_differently_is_not_taken_for_loaded() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> None:
        platform.answer_next(ReadMission, lambda request: reply_to(request, text="mission: cargo hold\nframe: geo\n"))
        await client.upload("heron", "hold.yaml", MISSION)

    with pytest.raises(ReadBackDiffers, match="line 2 is 'frame: geo' instead of 'frame: hold'"):
        with_platform(play)


def test_a_mission_that_is_cut_short_is_noticed() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> None:
        platform.answer_next(ReadMission, lambda request: reply_to(request, text="mission: cargo hold\n"))
        await client.upload("heron", "hold.yaml", MISSION)

    with pytest.raises(ReadBackDiffers, match="1 lines instead of 2"):
        with_platform(play)


def test_a_refusal_carries_the_reason_and_the_findings() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> None:
        findings = "hold.yaml:2:8: unknown frame 'hold'"
        platform.answer_next(LoadMission, refused("the mission was not accepted", findings))
        await client.upload("heron", "hold.yaml", MISSION)

    with pytest.raises(Declined, match=r"the mission was not accepted\nhold\.yaml:2:8: unknown frame"):
        with_platform(play)


def test_a_start_that_is_refused_says_why() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> None:
        platform.answer_next(Steer, refused("pose is faulty"))
        await client.steer("heron", Verb.START)

    with pytest.raises(Declined, match="pose is faulty"):
        with_platform(play)


def test_a_lost_reply_is_asked_for_and_nothing_runs_twice() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> None:
        def carried_out_but_the_reply_is_lost(request: object) -> None:
            return None

        platform.answer_next(Steer, carried_out_but_the_reply_is_lost)
        platform.answer_next(Query, reply_to)
        await client.steer("heron", Verb.PAUSE)
        assert platform.requests == [Steer(verb=Verb.PAUSE), Query(boot=11, sequence=0)]

    with_platform(play)


def test_a_lost_request_is_sent_again_after_the_platform_says_that_it_never_came() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> None:
        platform.answer_next(Steer, lost)
        await client.steer("heron", Verb.PAUSE)
        assert [type(body) for body in platform.requests] == [Steer, Query, Steer]

    with_platform(play)


def test_silence_ends_as_unknown_at_the_time_limit() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> float:
        platform.is_deaf = True
        with pytest.raises(Unanswered, match="heron has not answered for 16 s"):
            await client.steer("heron", Verb.ABORT)
        return platform.loop.time()

    assert with_platform(play) == pytest.approx(16.0)


def test_nothing_that_was_given_up_is_carried_out_later_by_the_link() -> None:
    assert TIMEOUT_S > REQUEST_TIMEOUT_S
    assert EMERGENCY_TIMEOUT_S > EMERGENCY_PATIENCE_S


def test_the_emergency_key_names_its_author() -> None:
    async def play(client: CommandClient, platform: ScriptedPlatform) -> None:
        await client.emergency("heron", EmergencyVerb.HOLD)
        (body,) = platform.requests
        assert getattr(body, "author", "") == "station 255"

    with_platform(play)
