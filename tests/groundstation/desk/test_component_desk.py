"""Commands and functions of components: only what is legal is offered, what is typed is checked, replies are kept."""

import asyncio
from collections.abc import Awaitable, Callable

import msgspec
import pytest
from tests.groundstation.scripted_platform import ScriptedPlatform, refused

from gloc3.clock import run_virtual
from gloc3.component.functions import GENERIC
from gloc3.component.lci import CREATE, TABLE
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import CallFunction, CommandComponent
from gloc3.messages.summaries import Health
from gloc3.mission.model.model import Policies
from gloc3.mission.model.policy import Policy
from gloc3.platform.reader import load_platform
from gloc3_groundstation.desk.component_desk import arguments
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.missions.plans import known_platform
from gloc3_groundstation.station.snapshots import ComponentSnapshot
from gloc3_groundstation.station.station import Station


def component(health: Health | None, name: str = "pose") -> ComponentSnapshot:
    return ComponentSnapshot(
        name=name, kind="DP", nominal_rate_hz=20.0, is_required=True, standby_for="", health=health
    )


def play(steps: Callable[[Desk, ScriptedPlatform], Awaitable[None]]) -> None:
    async def main() -> None:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        station = Station(exchange, asyncio.get_running_loop(), "255", 1)
        platform.speak()
        await steps(Desk(station), platform)
        station.close()

    run_virtual(main())


def test_only_what_the_state_table_allows_is_offered() -> None:
    async def steps(desk: Desk, platform: ScriptedPlatform) -> None:
        for state, rows in TABLE.items():
            offered = desk.components.commands(component(Health(state.value)))
            assert list(offered) == [command.value for command in rows]
        assert list(desk.components.commands(component(Health.ABSENT))) == [CREATE]
        assert desk.components.commands(component(None)) == {}
        assert desk.components.commands(component(Health.FAULTY))["initialize"] == "then standby"
        assert desk.components.functions("heron", component(Health.FAULTY)) == ()
        names = [entry.name for entry in desk.components.functions("heron", component(Health.QUIET))]
        assert names == ["set_rate", "set_logging"]
        at_home = desk.components.functions("pelican", component(Health.WORKING, "waypoints"))
        assert not [entry.name for entry in at_home if entry.name.startswith("action.")]

    play(steps)


def test_the_reply_is_kept_and_told_and_what_an_action_needs_can_be_forced() -> None:
    async def steps(desk: Desk, platform: ScriptedPlatform) -> None:
        platform.states["pose"] = Health.FAULTY
        answer = await desk.components.command("heron", "pose", "initialize")
        assert (answer.is_accepted, answer.text) == (True, "state standby")
        assert platform.control.holder == "255", "control is asked for first"
        assert desk.components.answer("heron", "pose") is answer
        refusal = await desk.components.command("heron", "pose", "resume")
        assert not refusal.is_accepted
        assert refusal.text.startswith("refused: resume is not accepted in standby; accepted: ")
        assert not refusal.can_be_forced
        platform.answer_next(CommandComponent, refused("sweep.wall needs pose; pause it first, or force the command"))
        assert (await desk.components.command("heron", "pose", "stop")).can_be_forced
        await desk.components.command("heron", "pose", "start", is_forced=True)
        assert platform.requests[-1] == CommandComponent(component="pose", command="start", is_forced=True)
        texts = [event.text for event in desk.station.fleet.events]
        assert "pose: initialize: state standby" in texts

    play(steps)


def test_a_function_is_sent_with_the_types_that_it_asks_for() -> None:
    async def steps(desk: Desk, platform: ScriptedPlatform) -> None:
        answer = await desk.components.call("heron", "pose", GENERIC["set_rate"], {"rate_hz": " 5 "})
        assert platform.requests[-1] == CallFunction(component="pose", function="set_rate", arguments={"rate_hz": 5.0})
        assert answer.text == "rate_hz 5.0"

    play(steps)


@pytest.mark.parametrize(
    ("function", "texts", "expected"),
    [
        ("set_rate", {"rate_hz": "12.5"}, {"rate_hz": 12.5}),
        (
            "set_logging",
            {"items": "speed, height", "is_enabled": "no"},
            {"items": ["speed", "height"], "is_enabled": False},
        ),
        ("set_logging", {"items": '["speed"]', "is_enabled": ""}, {"items": ["speed"]}),
        ("set_logging", {"items": "", "is_enabled": ""}, {}),
    ],
)
def test_what_is_typed_becomes_arguments_and_what_is_empty_is_left_out(
    function: str, texts: dict[str, str], expected: dict[str, object]
) -> None:
    assert msgspec.json.encode(arguments(GENERIC[function], texts)) == msgspec.json.encode(expected)


@pytest.mark.parametrize(
    ("texts", "reason"),
    [
        ({"rate_hz": ""}, "rate_hz must be given"),
        ({"rate_hz": "fast"}, "rate_hz: expected a number, got text"),
        ({"rate_hz": "-1"}, "rate_hz: expected a number > 0.0"),
        ({"rate_hz": "nan"}, "rate_hz"),
        ({"rate_hz": "[1"}, "no JSON"),
    ],
)
def test_what_does_not_fit_is_refused_before_it_is_sent(texts: dict[str, str], reason: str) -> None:
    with pytest.raises(Refused, match=reason):
        arguments(GENERIC["set_rate"], texts)


def test_of_two_files_for_one_vehicle_the_one_counts_whose_components_it_has() -> None:
    by_name, by_parts = known_platform("pelican"), known_platform("pelican", names_of("pelican_rtk"))
    assert by_name is not None
    assert by_parts is not None
    assert {row.name for row in by_parts.components} == set(names_of("pelican_rtk"))
    assert "vision_pose" in {row.name for row in by_name.components}
    assert known_platform("pelican", ["nothing", "of", "ours"]) == by_name
    assert known_platform("nosuch", names_of("pelican_rtk")) is None


def names_of(file: str) -> list[str]:
    return [row.name for row in load_platform(file).components]


def test_what_follows_is_named_before_an_armed_vehicle_loses_what_it_requires() -> None:
    hold, home = Policies(), Policies(on_failure=Policy.RETURN, on_pose_lost="abort")

    async def steps(desk: Desk, platform: ScriptedPlatform) -> None:
        def harm(name: str, policies: Policies | None = hold) -> str:
            known = desk.station.fleet.get("heron")
            assert known is not None
            return desk.components.harm(known, name, policies)

        await asyncio.sleep(1.0)
        platform.speak()
        assert harm("pose") == "", "nothing is armed"
        platform.fly(is_armed=True)
        platform.speak()
        assert harm("pose") == "pose_backup takes over"
        platform.states["pose_backup"] = Health.FAULTY
        platform.speak()
        assert harm("pose") == "the pose is lost: it then lands here"
        assert harm("pose", home) == "the pose is lost: it then returns and lands"
        assert harm("pose", None) == "the pose is lost: the on_pose_lost policy then runs"
        assert harm("autopilot") == (
            "nothing replaces it: actions that need it fail, and it then holds in place, "
            "and lands after 60 s without an operator"
        )
        platform.states["pose"] = Health.FAULTY
        platform.speak()
        assert harm("pose") == "", "it does not work anyway"
        assert harm("nobody") == ""

    play(steps)
