"""Steering by hand at the station: the dead-man's key, a gamepad's bytes, and a screen that says whether the vehicle follows."""

import asyncio
import os
import re
import struct
from pathlib import Path

import msgspec
import pytest
from tests.groundstation.scripted_platform import refused, reply_to
from tests.groundstation.station_scene import Scene, scene
from textual.widgets import Static

from gloc3.clock import VirtualLoop, run_virtual
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import CiRequest, RequestAction, Steer, Verb
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import MissionSummary
from gloc3.messages.teleoperation import DEMAND_HZ, TeleoperationState, VelocityDemand
from gloc3_groundstation.desk.teleoperation import RELEASES, FullSpeed, HandControl
from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.joysticks.linux_reader import FULL
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_groundstation.store.configuration import Configuration
from gloc3_groundstation.tui.dialogues.teleoperate import TeleoperateDialogue
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.panel import Panel

pytestmark = pytest.mark.thorough

AXIS, BUTTON, INITIAL = 2, 1, 0x80


def event(kind: int, number: int, value: int, t_ms: int = 0) -> bytes:
    return struct.pack("<IhBB", t_ms, value, kind, number)


# --- the dead-man's key, in virtual time ---


async def _hold() -> list[tuple[float, VelocityDemand]]:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    exchange = LocalExchange()
    sent: list[tuple[float, VelocityDemand]] = []
    exchange.subscribe("rov/velocity_demand", lambda e: sent.append((loop.time(), e.payload)))
    client = CommandClient(exchange, loop, "255", 1)
    hand = HandControl(client, loop, "rov", FullSpeed(0.6, 0.3, 20.0))
    hand.move(StickDemand(1.0, -2.0, 0.5, -1.0))
    await asyncio.sleep(1.0)
    assert sent == [], "sticks alone send nothing"
    began_s = loop.time()
    for _ in range(20):
        hand.hold_key(0.6)
        await asyncio.sleep(0.05)
    await asyncio.sleep(5.0)
    client.close()
    return [(t_s - began_s, demand) for t_s, demand in sent]


def test_demands_go_out_ten_times_a_second_while_the_key_repeats_and_say_that_it_was_let_go() -> None:
    sent = run_virtual(_hold())
    moving = [(t_s, demand) for t_s, demand in sent if any(demand.velocity_cm_s)]
    assert {demand.velocity_cm_s for _, demand in moving} == {(60, -60, 15)}
    assert {demand.yaw_rate_cdeg_s for _, demand in moving} == {-2000}
    assert moving[-1][0] == pytest.approx(0.95 + 0.6, abs=0.11)
    assert len(moving) == pytest.approx(DEMAND_HZ * moving[-1][0], abs=1.5)
    assert [demand.velocity_cm_s for _, demand in sent[len(moving) :]] == [(0, 0, 0)] * RELEASES
    assert [demand.sequence for _, demand in sent] == list(range(len(sent)))


# --- the screen ---


class Watcher:
    """Keeps what the station demands of the scene's vehicle."""

    def __init__(self, here: Scene) -> None:
        self.here = here
        self.demands: list[VelocityDemand] = []
        here.exchange.subscribe("heron/velocity_demand", self._receive)

    def _receive(self, envelope: Envelope[VelocityDemand]) -> None:
        self.demands.append(envelope.payload)

    def follow(self, **fields: object) -> None:
        """The vehicle says that it follows the last demand."""
        last = self.demands[-1]
        state = TeleoperationState(
            t_s=0.0,
            action_id="go",
            is_live=True,
            session=last.session,
            sequence=last.sequence,
            velocity_cm_s=last.velocity_cm_s,
            measured_cm_s=(11, 0, -2),
            yaw_rate_cdeg_s=0,
            measured_yaw_rate_cdeg_s=-150,
        )
        self.here.platform.report("teleoperation", msgspec.structs.replace(state, **fields))

    @property
    def text(self) -> str:
        panels = self.here.app.screen.query("#helm").results(Panel)
        return "\n".join(text_of(line) for panel in panels for line in panel.lines)

    async def sees(self, text: str) -> None:
        await self.here.wait(lambda: text in self.text)


async def _open(here: Scene) -> Watcher:
    here.platform.speak()
    await here.go("5")
    await here.wait(lambda: here.app.base is not None and here.app.base.view is not None)
    await here.wait(lambda: here.app.platform is not None)
    here.app.show_fleet()
    await here.press("t")
    await here.shows(TeleoperateDialogue)
    return Watcher(here)


@pytest.mark.sockets  # a key counts for a moment of wall time
async def test_it_is_begun_by_key_goes_while_the_key_is_kept_and_ends_with_the_dialogue() -> None:
    async with scene() as here:
        monitor = await _open(here)
        assert any("HOLD at once" in str(one.render()) for one in here.app.screen.query(Static))
        await monitor.sees("NOT BEGUN")
        here.platform.answer_next(RequestAction, lambda request: reply_to(request, reason="command-1"))
        await here.press("w", "w", "enter")
        await monitor.sees("NOT HEARD")
        assert [body.capability for body in here.requested(RequestAction) if isinstance(body, RequestAction)] == [
            "teleoperate"
        ]
        assert monitor.demands == [], "the key that begins it does not move it"
        await here.press("enter")
        await here.wait(lambda: bool(monitor.demands))
        assert monitor.demands[0].velocity_cm_s[0] > 0
        monitor.follow()
        await monitor.sees("LIVE")
        assert "+50%" in monitor.text
        assert "+0.11" in monitor.text
        assert "-1.50" in monitor.text
        await here.wait(lambda: monitor.demands[-1].velocity_cm_s == (0, 0, 0))
        monitor.follow(is_live=False, reason="the last demand has expired")
        await monitor.sees("AT REST")
        await here.press("enter")
        await here.wait(lambda: monitor.demands[-1].velocity_cm_s[0] > 0)
        monitor.follow(is_live=False, reason="the last demand has expired")
        await monitor.sees("NOT FOLLOWED")
        await here.press("escape")
        await here.wait(lambda: bool(here.requested(Steer)))
        (steer,) = here.requested(Steer)
        assert isinstance(steer, Steer)
        assert (steer.verb, steer.target) == (Verb.ABORT, "command-1")
        assert monitor.demands[-1].velocity_cm_s == (0, 0, 0), "it lets go when it is closed"


async def test_what_is_granted_after_the_operator_has_left_is_given_back() -> None:
    async with scene() as here:
        await _open(here)
        held: list[CiRequest] = []
        here.platform.answer_next(RequestAction, held.append)
        await here.press("enter")
        await here.wait(lambda: bool(held))
        await here.press("escape")
        assert not here.requested(Steer)
        here.platform.report("reply", reply_to(held[0], reason="command-1"))
        await here.wait(lambda: bool(here.requested(Steer)))
        (steer,) = here.requested(Steer)
        assert isinstance(steer, Steer)
        assert (steer.verb, steer.target) == (Verb.ABORT, "command-1")


async def test_a_refusal_and_an_end_by_the_vehicle_are_said() -> None:
    async with scene() as here:
        monitor = await _open(here)
        reason = "the vehicle is on the ground, and none of take_off, drive_off, depart and dive has been asked for yet"
        here.platform.answer_next(RequestAction, refused(reason))
        await here.press("w", "enter")
        await monitor.sees("asked for yet")
        assert re.search(r"surge +\+25% +–", monitor.text), "nothing is asked of a vehicle that is not steered"
        assert max(len(line) for line in monitor.text.splitlines()) <= 60
        here.platform.answer_next(RequestAction, lambda request: reply_to(request, reason="command-2"))
        await here.press("enter")
        await monitor.sees("NOT HEARD")
        here.platform.mission = MissionSummary(name="", digest="", state="", tasks={"command-2": "aborted"})
        here.platform.speak()
        await monitor.sees("ended (aborted)")
        await monitor.sees("NOT BEGUN")


async def test_a_gamepad_steers_by_real_bytes_and_one_that_goes_lets_go(tmp_path: Path) -> None:
    fifo = tmp_path / "js0"
    os.mkfifo(fifo)
    async with scene(configuration=Configuration(gamepad=str(fifo))) as here:
        monitor = await _open(here)
        pad = os.open(fifo, os.O_WRONLY)
        here.platform.answer_next(RequestAction, lambda request: reply_to(request, reason="command-1"))
        await here.press("enter")
        await monitor.sees("NOT HEARD")
        os.write(pad, event(AXIS, 1, -FULL))
        await here.pilot.pause(0.2)
        assert monitor.demands == []
        os.write(pad, event(BUTTON, 4, 1))
        await here.wait(lambda: bool(monitor.demands) and monitor.demands[-1].velocity_cm_s[2] > 0)
        os.close(pad)
        await here.wait(lambda: monitor.demands[-1].velocity_cm_s == (0, 0, 0))
        await monitor.sees("it is disconnected")


async def test_a_gamepad_that_is_not_there_is_said_and_keys_steer_all_the_same(tmp_path: Path) -> None:
    async with scene(configuration=Configuration(gamepad=str(tmp_path / "js7"))) as here:
        monitor = await _open(here)
        await monitor.sees("js7: No such file or directory")
        here.platform.answer_next(RequestAction, lambda request: reply_to(request, reason="command-1"))
        await here.press("enter")
        await monitor.sees("NOT HEARD")
        await here.press("down", "enter")
        await here.wait(lambda: bool(monitor.demands) and monitor.demands[-1].velocity_cm_s[2] < 0)
