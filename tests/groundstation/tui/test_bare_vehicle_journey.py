"""An operator flies the simulated vehicle, which has no companion, over UDP: palette, emergency key, questions."""

import asyncio
from pathlib import Path

import pytest
from tests.groundstation.station_scene import Scene
from textual.widgets import Input

from gloc3.messages.command_interface import EmergencyVerb
from gloc3.messages.summaries import VehicleSummary
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.tui.dialogues.questions import EmergencyQuestion, TextQuestion, YesNoQuestion

from .test_services_journey import VEHICLES, terminal

pytestmark = [pytest.mark.sockets, pytest.mark.flight]


def seen(here: Scene, name: str) -> VehicleSummary:
    """The vehicle's state."""
    timed = here.station.fleet.platforms[name].vehicle
    assert timed is not None
    return timed.value


def has_begun(here: Scene, name: str) -> bool:
    """Whether the vehicle knows where it is."""
    timed = here.station.fleet.platforms[name].vehicle
    return timed is not None and timed.value.is_armable and timed.value.geo is not None


def events(here: Scene) -> str:
    """What was told so far."""
    return "\n".join(f"{event.severity} {event.text}" for event in here.station.fleet.events)


async def commanded(here: Scene, action: Action, typed: str = "") -> None:
    """Takes a command of the palette, answers its questions, and waits for the autopilot."""
    name = f"{action}{f' {typed}' if typed else ''}".replace("_", " ")
    before = events(here).count(f"{name}: accepted by the autopilot")
    here.app.action_act(action)  # as the row of the palette does
    if typed:
        await here.wait(lambda: isinstance(here.app.screen, TextQuestion) and isinstance(here.app.focused, Input))
        here.app.screen.query_one(Input).value = typed
        await here.press("enter")
    await here.pilot.pause(0.1)
    if isinstance(here.app.screen, YesNoQuestion):
        await here.press("y")
    await here.wait(lambda: events(here).count(f"{name}: accepted by the autopilot") > before)


@pytest.mark.parametrize("style", sorted(VEHICLES))
async def test_a_vehicle_without_a_companion_is_flown_by_keys(style: str, tmp_path: Path) -> None:
    name, _, _ = VEHICLES[style]
    async with terminal(style, tmp_path) as here:
        await here.until("title", name)
        await here.wait(lambda: has_begun(here, name))
        desk = here.app.desk
        offers = desk.autopilots.offers(here.station.fleet.platforms[name])
        assert Action.TAKE_OFF in offers
        assert Action.LAND not in offers
        for _ in range(60):
            if await desk.autopilots.act(name, Action.ARM):
                break
            await asyncio.sleep(1.0)
        await commanded(here, Action.TAKE_OFF, "4")
        await here.wait(lambda: seen(here, name).position_m[2] > 3.0)
        assert Action.LAND in desk.autopilots.offers(here.station.fleet.platforms[name])
        await here.press("space")
        await here.wait(lambda: "hold: accepted by the autopilot" in events(here))
        await here.press("space")
        await here.wait(lambda: isinstance(here.app.screen, EmergencyQuestion))
        await here.press("r")
        await here.wait(lambda: "return: accepted by the autopilot" in events(here))
        await here.wait(lambda: "RTL" in seen(here, name).mode)
        assert await desk.emergency(name, EmergencyVerb.LAND)
        await here.wait(lambda: not seen(here, name).is_armed)
        here.app.action_act(Action.SPEED)
        await here.wait(lambda: isinstance(here.app.screen, TextQuestion) and isinstance(here.app.focused, Input))
        here.app.screen.query_one(Input).value = "fast"
        await here.press("enter")
        await here.wait(lambda: "'fast': speed over ground, m/s is expected" in events(here))
