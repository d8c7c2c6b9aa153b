"""Who may command an autopilot itself, and what is typed for it."""

import asyncio

import pytest
from msgspec.structs import replace
from tests.groundstation.scripted_platform import VEHICLE, ScriptedPlatform

from gloc3.clock import run_virtual
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import AnyBody, Control, ControlVerb, StationRole
from gloc3.messages.summaries import ControlState
from gloc3_groundstation.desk.autopilot_desk import AutopilotDesk, values_of
from gloc3_groundstation.desk.services_desk import ServicesDesk
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.station.fleet import with_platform
from gloc3_groundstation.station.snapshots import AutopilotSnapshot, PlatformSnapshot, Timed
from gloc3_groundstation.station.station import Station

HEARD = AutopilotSnapshot(link="udpin://127.0.0.1:14550", system=1, component=1, firmware="PX4")
HERON = PlatformSnapshot(
    name="heron", boot=1, first_received_s=0.0, received_s=0.0, vehicle=Timed(VEHICLE, 0.0), autopilot=HEARD
)


def told(holder: str, action: Action, role: StationRole = StationRole.OPERATOR) -> str:
    """Why a command is not sent to a silent companion's autopilot, which this station cannot reach."""

    async def main() -> str:
        station = Station(LocalExchange(), asyncio.get_running_loop(), "255", 11)
        station.client.role = role
        platform = replace(HERON, control=Timed(ControlState(holder=holder), 0.0), received_s=-60.0)
        station.change(lambda fleet, now_s: with_platform(fleet, platform))
        try:
            assert not await AutopilotDesk(station, ServicesDesk(station)).act("heron", action)
            return station.fleet.events[-1].text
        finally:
            station.close()

    return run_virtual(main())


def test_in_place_of_a_silent_companion_the_station_that_was_in_control_commands_and_all_may_hold() -> None:
    assert "may send hold alone" in told("254", Action.RETURN)
    assert "nobody was in control" in told("", Action.LAND)
    for holder, action in (("255", Action.RETURN), ("254", Action.HOLD), ("", Action.HOLD)):
        assert "has no link" in told(holder, action), "it would be sent"
    assert "observer" in told("255", Action.HOLD, StationRole.OBSERVER)


@pytest.mark.parametrize("is_alive", [True, False])
def test_a_companion_that_speaks_or_an_autopilot_that_is_not_heard_is_not_passed_by(*, is_alive: bool) -> None:
    async def main() -> tuple[bool, bool]:
        station = Station(LocalExchange(), asyncio.get_running_loop(), "255", 11)
        desk = AutopilotDesk(station, ServicesDesk(station))
        platform = replace(HERON, autopilot=replace(HEARD, is_alive=is_alive))
        speaks = desk.is_its_own(replace(platform, received_s=station.now_s()))
        await asyncio.sleep(60.0)
        silent = desk.is_its_own(replace(platform, received_s=station.now_s() - 60.0))
        station.close()
        return speaks, silent

    assert run_virtual(main()) == (False, is_alive)


def test_a_command_that_comes_when_the_companion_is_back_is_not_sent_past_it() -> None:
    async def main() -> str:
        station = Station(LocalExchange(), asyncio.get_running_loop(), "255", 11)
        back = replace(HERON, control=Timed(ControlState(holder="255"), 0.0), received_s=station.now_s())
        station.change(lambda fleet, now_s: with_platform(fleet, back))
        assert not await AutopilotDesk(station, ServicesDesk(station)).act("heron", Action.RETURN)
        station.close()
        return station.fleet.events[-1].text

    assert "through its onboard process" in run_virtual(main())


def test_a_companion_that_is_back_before_the_autopilot_has_answered_is_told_of_the_command() -> None:
    async def main() -> list[AnyBody]:
        exchange = LocalExchange()
        station = Station(exchange, asyncio.get_running_loop(), "255", 11)
        companion = ScriptedPlatform(exchange)
        companion.speak()
        station.notify_when_back("heron", "return")
        await asyncio.sleep(1.0)
        station.close()
        return companion.requests

    assert Control(verb=ControlVerb.OPERATED, command="return") in run_virtual(main())


def test_values_are_numbers_in_the_order_that_is_told() -> None:
    assert values_of(Action.TAKE_OFF, " 4.5 ", None) == (4.5,)
    with pytest.raises(Refused, match="height above home, m is expected"):
        values_of(Action.TAKE_OFF, "high", None)
    with pytest.raises(Refused, match="LATITUDE, LONGITUDE"):
        values_of(Action.GO_TO, "47, 8", None)
    with pytest.raises(Refused, match="is not known"):
        values_of(Action.GO_TO, "47, 8, 20", None)
