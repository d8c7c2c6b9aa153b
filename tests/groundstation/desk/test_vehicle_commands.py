"""Commands of a script to a vehicle: their words, and what telemetry has to show until each is done."""

import asyncio

import pytest
from msgspec.structs import replace
from tests.groundstation.scripted_platform import VEHICLE, ScriptedPlatform, reply_to

from gloc3.clock import run_virtual
from gloc3.errors import NoContact, Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import RequestAction
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.vehicle_commands import NotDone, VehicleCommand, parse_vehicle_command, shows
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.station.station import Station


def test_a_command_is_a_word_and_its_values() -> None:
    assert parse_vehicle_command(" take_off  5 ") == VehicleCommand(action=Action.TAKE_OFF, typed="5")
    assert str(parse_vehicle_command("go_to 47.1 8.5 20")) == "go to 47.1 8.5 20"
    assert parse_vehicle_command("hold") == VehicleCommand(action=Action.HOLD)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("takeoff 5", "'takeoff 5' is no command; did you mean 'take_off'?"),
        ("take_off", "take_off: height above home, m is expected"),
        ("take_off high", "'high': height above home, m is expected"),
        ("take_off -5", "a take-off goes to above 0 and up to 1000 m, not -5 m"),
        ("speed 500", "a speed is above 0 and up to 100 m/s, not 500 m/s"),
        ("go_to -35.363", "'-35.363': LATITUDE, LONGITUDE, HEIGHT ABOVE HOME in m is expected"),
        ("go_to 47.1 8.5 inf", "'47.1 8.5 inf': LATITUDE, LONGITUDE, HEIGHT ABOVE HOME in m is expected"),
        ("arm now", "arm takes no values"),
        ("", "'' is no command"),
    ],
)
def test_what_is_no_command_is_refused_before_anything_is_sent(text: str, reason: str) -> None:
    with pytest.raises(Refused, match=reason):
        parse_vehicle_command(text)


FLIES = replace(VEHICLE, is_armed=True, landed="in_air", mode="AUTO.LOITER", position_m=(0.0, 0.0, 4.8))


@pytest.mark.parametrize(
    ("text", "values", "before", "after"),
    [
        ("arm", (), VEHICLE, replace(VEHICLE, is_armed=True)),
        ("disarm", (), FLIES, VEHICLE),
        ("take_off 5", (5.0,), replace(FLIES, position_m=(0.0, 0.0, 4.0)), FLIES),
        ("take_off 5", (5.0,), replace(FLIES, landed="taking_off"), FLIES),
        ("hold", (), replace(FLIES, speed_m_s=3.0), FLIES),
        ("hold", (), replace(FLIES, mode="AUTO.MISSION"), replace(FLIES, mode="BRAKE")),
        ("land", (), replace(FLIES, landed="landing"), VEHICLE),
        ("return", (), replace(FLIES, mode="AUTO.RTL"), VEHICLE),
        ("mode GUIDED", (), FLIES, replace(FLIES, mode="GUIDED, on wings")),
        ("start_plan", (), FLIES, replace(FLIES, mode="AUTO")),
        ("go_to 43.1 9.2 5", (43.1, 9.2, 17.0), replace(FLIES, geo=(43.101, 9.2, 17.0)), replace(FLIES, geo=(43.1, 9.2, 16.0))),
        ("go_to 43.1 9.2 5", (43.1, 9.2, 17.0), replace(FLIES, geo=None), replace(FLIES, geo=(43.1, 9.2, 17.0))),
    ],
)  # fmt: skip
def test_telemetry_shows_when_a_command_is_done(
    text: str, values: tuple[float, ...], before: object, after: object
) -> None:
    command = parse_vehicle_command(text)
    for vehicle, is_done in ((before, False), (after, True)):
        assert isinstance(vehicle, type(VEHICLE))
        assert shows(vehicle, command, values, "quadrotor") is is_done


def test_vehicles_on_wings_circle_and_stay_armed() -> None:
    circles = replace(FLIES, speed_m_s=18.0, mode="AUTO.RTL")
    assert shows(circles, parse_vehicle_command("return"), (), "fixed wing")
    assert shows(replace(circles, mode="LOITER"), parse_vehicle_command("hold"), (), "fixed wing")
    assert not shows(circles, parse_vehicle_command("return"), (), "hexarotor")


def test_a_submarine_has_landed_at_the_surface_and_stays_armed() -> None:
    land, deep = parse_vehicle_command("land"), replace(FLIES, landed="", position_m=(0.0, 0.0, -6.0))
    surfaced = replace(deep, mode="ALT_HOLD", position_m=(0.0, 0.0, -0.1))
    assert not shows(replace(deep, mode="SURFACE"), land, (), "submarine")
    assert not shows(replace(deep, mode="ALT_HOLD"), land, (), "submarine")
    assert shows(surfaced, land, (), "submarine")
    assert not shows(surfaced, land, (), "quadrotor")


def commanded(text: str, state: str, *, is_deaf: bool = False) -> str:
    """What a command leads to at a platform with a companion, where its single action ends so."""

    async def main() -> str:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        station = Station(exchange, platform.loop, "255", 11)
        desk = Desk(station)
        platform.answer_next(RequestAction, lambda request: reply_to(request, reason="command-1"))
        platform.loop.call_later(0.1, platform.speak_every, 0.5)
        platform.loop.call_later(2.0, lambda: platform.advance("", **{"command-1": "running"}))
        if is_deaf:
            platform.loop.call_later(3.0, setattr, platform, "is_deaf", True)
        else:
            platform.loop.call_later(5.0, lambda: platform.advance("", **{"command-1": state}))
        try:
            await flights.await_vehicle(station, "heron")
            command = parse_vehicle_command(text)
            shown = await desk.commands.carry_out("heron", command, ready_s=1.0, within_s=20.0)
            assert station.now_s() == pytest.approx(5.0, abs=0.6)
            (body,) = (body for body in platform.requests if isinstance(body, RequestAction))
            return f"{body.capability} {body.arguments}: {shown}"
        finally:
            station.close()

    return run_virtual(main())


def test_with_a_companion_the_words_are_single_actions() -> None:
    assert commanded("take_off 5", "done").startswith("take_off {'height_m': 5.0}: disarmed, on ground, mode HOLD")
    assert commanded("hold", "done").startswith("hold {'duration_s': 1.0}")
    assert commanded("return", "done").startswith("return_home {}")
    assert commanded("go_to 1 2 3", "done").startswith("go_to {'position_m': [1.0, 2.0, 3.0]}")


def test_a_single_action_that_fails_or_a_vehicle_that_falls_silent_is_not_done() -> None:
    with pytest.raises(NotDone, match="land: failed"):
        commanded("land", "failed")
    with pytest.raises(NotDone, match="land: accepted, but not done within 20 s"):
        commanded("land", "running")
    with pytest.raises(NoContact, match="land: nothing heard of heron"):
        commanded("land", "", is_deaf=True)


def test_a_companion_has_no_words_for_what_it_does_itself() -> None:
    with pytest.raises(Refused, match="heron has a companion, without an action arm; it has take_off, hold, land"):
        commanded("arm", "done")


def test_a_vehicle_that_is_not_there_is_awaited() -> None:
    async def main() -> None:
        exchange = LocalExchange()
        station = Station(exchange, asyncio.get_running_loop(), "255", 11)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(5.0):
                await flights.await_vehicle(station, "1")
        station.close()

    run_virtual(main())
