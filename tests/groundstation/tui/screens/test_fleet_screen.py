"""The fleet screen, driven by keys: marks, orders, control with a second station, links."""

import msgspec
import pytest
from tests.groundstation.desk.test_fleet_desk import SharedPlatform
from tests.groundstation.station_scene import LINKS, PLAN, ScriptedLinks, scene
from tests.groundstation.tui.views.test_views import PLATFORM, view

from gloc3.messages.command_interface import Control, ControlVerb, Emergency, Steer, Verb
from gloc3.messages.summaries import ControlState
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.links.link_snapshot import LinkSnapshot
from gloc3_groundstation.station.fleet import without
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.tui.dialogues.questions import TextQuestion, YesNoQuestion
from gloc3_groundstation.tui.views.fleet import control_lines, fleet_line, link_line, rate
from gloc3_groundstation.tui.widgets.lines import text_of


def test_a_vehicles_line_tells_its_state_and_its_worst_component_at_eighty_columns() -> None:
    line = text_of(fleet_line(view(PLATFORM), PLATFORM, {"heron"}, 80))
    assert line.split() == ["►", "●", "heron", "disarmed", "97", "%", "ok", "running", "all", "13", "well"]
    wide = text_of(fleet_line(view(PLATFORM), PLATFORM, (), 200))
    assert "here" in wide
    assert "HOLD" in wide


def test_a_links_line_tells_what_passes_who_is_behind_it_or_what_is_wrong() -> None:
    udp, _, tcp = (text_of(link_line(link, 120)) for link in LINKS)
    assert udp.split()[:6] == ["udpin://0.0.0.0:14550", "18.4", "k", "640", "120,311", "4,012"]
    assert "heron, autopilot 1/1" in udp
    assert tcp.rstrip().endswith("connection refused")
    assert [rate(value) for value in (0.0, 9_999.0, 18_400.0, 2.5e6)] == ["0", "9999", "18.4 k", "2.5 M"]


def test_a_links_line_tells_what_was_refused_or_did_not_come() -> None:
    link = LinkSnapshot(
        url="udpin://0.0.0.0:14550", is_connected=True, received=("autopilot 1/1",), frames_in=95, lost=5
    )
    assert "autopilot 1/1; 5% lost or left out" in text_of(link_line(link, 140))
    refused = msgspec.structs.replace(link, refusals={"not signed": 12}, received=())
    assert "12 refused: not signed; 5% lost or left out; no system heard" in text_of(link_line(refused, 200))


def test_who_asks_for_control_is_told_with_the_keys_that_answer() -> None:
    text = [text_of(line) for line in control_lines(view(PLATFORM), {ControlVerb.GRANT, ControlVerb.REFUSE}, 80)]
    assert text == [" this station in control", "   g grant   f refuse"]


@pytest.mark.sockets
async def test_marked_vehicles_are_ordered_together_after_a_question_that_names_them() -> None:
    async with scene(None) as here:
        here.platform.speak()
        others = [SharedPlatform(here.exchange, name, 20 + n) for n, name in enumerate(("egret", "stork"))]
        for other in others:
            other.speak()
        await here.go("0")
        await here.until("vehicles", "stork")
        await here.press("m", "down")
        await here.until("title", "egret 2/3")
        await here.press("m")
        await here.wait(lambda: here.shown("vehicles").count("●") == 2)
        await here.press("p")
        await here.shows(YesNoQuestion)
        question = here.app.screen
        assert isinstance(question, YesNoQuestion)
        assert "heron, egret" in question._question
        await here.press("y")
        await here.wait(lambda: all(Steer(verb=Verb.PAUSE) in each.requests for each in (here.platform, others[0])))
        assert not [body for body in others[1].requests if isinstance(body, Steer)]
        await here.wait(lambda: here.app.screen is here.app.base)
        await here.press("M", "l")
        await here.shows(YesNoQuestion)
        await here.press("n")
        await here.wait(lambda: here.app.screen is here.app.base)
        assert here.requested(Emergency) == [], "no is no"
        await here.press("M", "l")
        await here.shows(YesNoQuestion)
        await here.press("n")
        await here.wait(lambda: here.app.screen is here.app.base)
        assert here.requested(Emergency) == [], "landing hurts, so it is asked about for one vehicle too"
        before = len(others[0].requests)
        await here.press("p")
        await here.wait(lambda: others[0].requests[before:].count(Steer(verb=Verb.PAUSE)) == 1)


@pytest.mark.sockets
async def test_a_start_asks_about_the_vehicles_that_the_mission_names_whichever_are_marked() -> None:
    async with scene(None) as here:
        here.platform.speak()
        for number, name in enumerate(("egret", "stork")):
            SharedPlatform(here.exchange, name, 20 + number).speak()
        here.app.desk.missions._plan = msgspec.structs.replace(PLAN, platforms=("egret", "stork"))
        await here.go("0")
        await here.until("vehicles", "stork")
        for keys in (["s"], ["M", "s"]):
            await here.press(*keys)
            await here.shows(YesNoQuestion)
            assert "Start: egret, stork?" in getattr(here.app.screen, "_question", "")
            await here.press("n")
            await here.wait(lambda: here.app.screen is here.app.base)


@pytest.mark.sockets
async def test_a_key_right_after_the_cursor_was_moved_commands_the_vehicle_under_it() -> None:
    async with scene(None) as here:
        here.platform.speak()
        egret = SharedPlatform(here.exchange, "egret", 20)
        egret.speak()
        await here.go("0")
        await here.until("vehicles", "egret")
        await here.until("title", "heron 1/2")
        for key in ("down", "h", "c"):  # at once, as over a slow SSH connection
            here.app.simulate_key(key)
        await here.wait(lambda: any(isinstance(body, Emergency) for body in egret.requests))
        await here.wait(lambda: egret.control == ControlState(holder="255"))
        assert here.requested(Emergency) == here.requested(Control) == []
        await here.until("title", "egret 2/2")


@pytest.mark.sockets
async def test_the_cursor_selects_no_vehicle_by_itself_when_the_one_under_it_has_gone() -> None:
    async with scene(None) as here:
        here.platform.speak()
        SharedPlatform(here.exchange, "egret", 20).speak()
        await here.go("0")
        await here.until("title", "heron 1/2")
        await here.press("down")
        await here.until("title", "egret 2/2")
        here.station.change(lambda fleet, _: without(fleet, "egret"))
        await here.until("title", "no vehicle in view: v shows one")
        await here.still("title")
        await here.press("h", "space")
        assert here.requested(Emergency) == []
        await here.press("v")
        await here.until("title", "heron")


@pytest.mark.sockets
async def test_control_of_a_second_vehicle_is_requested_and_granted_between_two_stations() -> None:
    async with scene(None) as here:
        other = Desk(Station(here.exchange, here.platform.loop, "254", 12))
        egret = SharedPlatform(here.exchange, "egret", 20)
        egret.authority.holder = "254"
        here.platform.speak()
        egret.tell_control()
        egret.speak()
        await here.go("0")
        await here.until("vehicles", "egret")
        await here.press("down")
        await here.until("control", "station 254 in control")
        await here.press("c")
        await here.wait(lambda: egret.control == ControlState(holder="254", requested_by="255"))
        await here.until("control", "this station has requested it")
        assert any("station 255 requests control" in event.text for event in other.station.fleet.events)
        assert await other.fleet.control("egret", ControlVerb.GRANT)
        await here.until("control", "this station in control")
        egret.speak_every(0.5)  # and now the other way round
        here.app.run_worker(other.request_control("egret"))
        await here.until("title", "254 requests control")
        await here.until("alert", "station 254 requests control")
        await here.until("control", "station 254 requests it")
        await here.press("g")
        await here.until("control", "station 254 in control")
        await here.press("t")
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.until("control", "this station in control")
        other.station.close()


@pytest.mark.sockets
async def test_a_link_is_opened_and_closed_by_keys() -> None:
    links = ScriptedLinks(*LINKS)
    async with scene(None, links=links) as here:
        here.platform.speak()
        await here.go("0")
        await here.until("links", "serial:///dev/ttyUSB0")
        await here.press("n")
        await here.shows(TextQuestion)
        (await here.field()).value = "tcpout://boat:5760"
        await here.press("enter")
        await here.until("links", "tcpout://boat:5760")
        await here.press("tab")
        await here.wait(lambda: getattr(here.app.focused, "id", "") == "links")
        await here.press("delete")
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.wait(lambda: "udpin" not in here.shown("links"))
        assert [link.url for link in links.open][-1] == "tcpout://boat:5760"


@pytest.mark.sockets
async def test_frames_are_forwarded_one_way_unless_commands_are_let_pass() -> None:
    links = ScriptedLinks(*LINKS)
    async with scene(None, links=links) as here:
        here.platform.speak()
        await here.go("0")
        for answer, forwards in (("n", "one way"), ("y", "both ways")):
            await here.press("w")
            await here.shows(TextQuestion)
            (await here.field()).value = f"udpout://{answer}:14550"
            await here.press("enter")
            await here.shows(YesNoQuestion)
            await here.press(answer)
            await here.until("links", f"udpout://{answer}:14550")
            assert links.open[-1].forwards == forwards
        await here.press("w")
        await here.shows(TextQuestion)
        await here.press("escape")
        await here.wait(lambda: here.app.screen is here.app.base)
        assert links.open[-1].url == "udpout://y:14550"


class Corrections:
    """Takes addresses of corrections."""

    def __init__(self) -> None:
        self.opened: list[str] = []

    async def open(self, url: str) -> None:
        self.opened.append(url)

    async def stop(self) -> None:
        self.opened.append("stop")


@pytest.mark.sockets
async def test_the_password_of_a_caster_is_typed_without_being_shown() -> None:
    async with scene(None) as here:
        taken = here.app.desk.fleet.corrections = Corrections()
        here.platform.speak()
        here.app.action_corrections()  # as the row of the palette does
        await here.shows(TextQuestion)
        (await here.field()).value = "ntrip://me@home.org@caster:2101/BASE"
        await here.press("enter")
        await here.wait(lambda: "Password of me@home.org" in str(getattr(here.app.screen, "_question", "")))
        field = await here.field()
        assert field.password
        field.value = "s/cret@"
        await here.press("enter")
        await here.wait(lambda: taken.opened == ["ntrip://me@home.org:s%2Fcret%40@caster:2101/BASE"])
        here.app.action_corrections()
        await here.wait(lambda: "from where" in str(getattr(here.app.screen, "_question", "")))
        (await here.field()).value = "tcp://base:9000"
        await here.press("enter")
        await here.wait(lambda: taken.opened[-1] == "tcp://base:9000")
        here.app.action_end_corrections()
        await here.wait(lambda: taken.opened[-1] == "stop")
