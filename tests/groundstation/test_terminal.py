"""The terminal, driven by keys: journeys of an operator with a scripted platform."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import NamedTuple
from unittest.mock import patch

from textual.pilot import Pilot
from textual.widgets import Input

from gloc3.ci import ControlState, Emergency, EmergencyVerb, LoadMission, Steer, Verb
from gloc3.exchange import LocalExchange
from gloc3_groundstation.desk import Desk
from gloc3_groundstation.flights import End
from gloc3_groundstation.plans import Plan
from gloc3_groundstation.station import Station
from gloc3_groundstation.tui.app import StationApp
from gloc3_groundstation.tui.lines import text_of
from gloc3_groundstation.tui.panel import Panel

from .scripted_platform import ScriptedPlatform, refused

PLAN = Plan(name="hold.yaml", title="cargo hold", text="mission: cargo hold\n")


class Scene(NamedTuple):
    app: StationApp
    pilot: Pilot[End | None]
    platform: ScriptedPlatform

    def shown(self, panel: str) -> str:
        self.app.look()
        return "\n".join(text_of(line) for line in self.app.screen_stack[0].query_one(f"#{panel}", Panel).lines)

    async def until(self, panel: str, text: str) -> None:
        """Waits until a panel shows a text."""
        for _ in range(300):
            if text in self.shown(panel):
                return
            await self.pilot.pause(0.003)
        raise AssertionError(f"{panel} never showed {text!r}:\n{self.shown(panel)}")

    async def press(self, *keys: str) -> None:
        """Presses keys without waiting for the processor to be idle, as `Pilot.press` does."""
        for key in keys:
            self.app.simulate_key(key)
            await self.pilot.pause(0.005)

    def asked(self, kind: type) -> list[object]:
        return [body for body in self.platform.requests if isinstance(body, kind)]


@asynccontextmanager
async def scene(
    plan: Plan | None = PLAN, size: tuple[int, int] = (80, 24), *, flies: bool = False
) -> AsyncIterator[Scene]:
    exchange = LocalExchange()
    platform = ScriptedPlatform(exchange)
    platform.delay_s = 0.001
    station = Station(exchange, platform.loop, "255", 11)
    app = StationApp(
        Desk(station, plan), waiting_for=lambda: "udpin://0.0.0.0:14550", is_starting=flies, is_closing=flies
    )
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        try:
            yield Scene(app, pilot, platform)
        finally:
            platform.is_deaf = True
            station.close()


async def test_what_comes_is_shown_and_keys_that_make_no_sense_do_nothing() -> None:
    async with scene(None) as here:
        assert "Waiting for a platform on udpin://0.0.0.0:14550." in here.shown("vehicle")
        here.platform.speak()
        await here.until("components", "command_server")
        assert "HOLD   disarmed, on ground" in here.shown("vehicle")
        panel = here.app.screen.query_one("#components", Panel)
        assert panel.border_title == "components: all 13 well"
        await here.press("s", "p", "r", "a", "u")
        await here.pilot.pause()
        assert here.asked(Steer) == here.asked(LoadMission) == []
        here.app.look()
        with patch.object(panel, "refresh") as refresh:
            here.app.look()
            assert not refresh.called, "nothing has changed, so nothing is drawn"
        for number in range(40):
            here.platform.event(f"number {number}")
        here.app.look()
        await here.pilot.pause()
        events = here.app.screen.query_one("#events", Panel)
        assert "number 39" in events.render_line(events.size.height - 1).text


async def test_a_mission_is_streamed_started_paused_resumed_and_aborted_by_keys() -> None:
    async with scene() as here:
        here.platform.answer_next(Steer, refused("pose is faulty"))
        here.platform.speak()
        await here.until("events", "is loaded and read back")
        await here.press("s")
        await here.until("events", "error: heron: start: pose is faulty")
        await here.press("s")
        await here.until("events", "the mission is started")
        assert len(here.asked(LoadMission)) == 1
        await here.until("mission", "depart")
        await here.press("p")
        await here.until("events", "pause: accepted")
        here.platform.advance("paused")
        here.app.look()
        await here.press("r")
        await here.until("events", "resume: accepted")
        here.platform.advance("running")
        here.app.look()
        await here.press("a", "n", "a", "y")
        await here.until("events", "abort: accepted")
        verbs = (Verb.START, Verb.START, Verb.PAUSE, Verb.RESUME, Verb.ABORT)
        assert here.asked(Steer) == [Steer(verb=verb) for verb in verbs]


async def test_the_emergency_key_holds_at_once_offers_more_when_pressed_again_and_leaving_is_asked() -> None:
    async with scene(None) as here:
        here.platform.control = ControlState(holder="255")
        here.platform.speak()
        here.platform.fly(is_armed=True)
        await here.until("components", "command_server")
        await here.press("space")
        await here.until("events", "emergency hold")
        await here.press("space", "l")
        await here.until("events", "emergency land")
        await here.press("space", "d")
        await here.pilot.pause()
        for name in ("herron", "heron"):
            here.app.screen.query_one(Input).value = name
            await here.press("enter")
        await here.until("events", "emergency disarm")
        verbs = [getattr(body, "verb", None) for body in here.asked(Emergency)]
        assert verbs == [EmergencyVerb.HOLD, EmergencyVerb.LAND, EmergencyVerb.DISARM]
        assert getattr(here.asked(Emergency)[-1], "confirmation", "") == "heron"
        await here.press("q", "n")
        assert not here.app._exit
        await here.press("q", "ctrl+c")
        assert here.app._exit
        assert here.app.return_code == 130, "Ctrl-C asks nothing"


async def test_it_flies_by_itself_and_closes_when_the_mission_has_ended() -> None:
    async with scene(flies=True) as here:
        here.platform.speak()
        await here.until("events", "the mission is started")
        here.platform.advance("running")
        await here.pilot.pause(0.05)
        here.platform.advance("done")
        for _ in range(50):
            await here.pilot.pause(0.01)
            if here.app._exit:
                break
        assert here.app.return_value == End(state="done")
