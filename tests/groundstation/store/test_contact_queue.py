"""Missions wait for the next contact: shown, withdrawn, sent once and in order; what moves a vehicle never waits."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from tests.groundstation.scripted_platform import VEHICLE

from gloc3.clock import VirtualLoop
from gloc3.exchange import LocalExchange, Publisher
from gloc3.messages.command_interface import CiReply, CiRequest, Control, LoadMission, Outcome, ReadMission, Steer, Verb
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import ControlState, MissionSummary
from gloc3.messages.topics import TopicTable
from gloc3.mission.model.model import digest_of
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.contact_queue import ContactQueue

TEXT = "mission: {}\nframe: hold\ntasks: {{a: {{actions: {{b: {{wait: {{duration_s: 1}}}}}}}}}}\n"


class Far:
    """A platform that takes missions while there is contact, and says nothing otherwise."""

    def __init__(self) -> None:
        self.is_here, self.refused, self.loads = True, "", list[str]()
        self.is_deaf_after_load = False
        self.state = "waiting"
        self.requests: list[CiRequest] = []
        self._text = self._holder = ""
        self._loop, topics = asyncio.get_running_loop(), TopicTable.installed()
        self.exchange = LocalExchange(topics)
        self._publisher = Publisher(self.exchange, "petrel", "command_server", 1)
        self.exchange.subscribe("petrel/ci/request", self._take)
        self.station = Station(self.exchange, self._loop, "255", 1)
        self._notify()

    def _notify(self) -> None:
        if self.is_here:
            self._write("vehicle", VEHICLE)
            self._write("control", ControlState(holder=self._holder))
            digest = digest_of(self._text) if self._text else ""
            self._write("mission", MissionSummary(name="m", digest=digest, state=self.state if digest else ""))
        self._timer = self._loop.call_later(0.5, self._notify)

    def _write(self, topic: str, message: Any) -> None:
        self._publisher.publish(f"petrel/ci/{topic}", message, self._loop.time())

    def _take(self, envelope: Envelope[CiRequest]) -> None:
        request = envelope.payload
        if not self.is_here:
            return
        self.requests.append(request)
        body, text, outcome = request.body, "", Outcome.ACCEPTED
        if isinstance(body, Control):
            self._holder = request.sender
            self._write("control", ControlState(holder=self._holder))
        elif isinstance(body, LoadMission):
            self.loads.append(body.name)
            if body.name == self.refused:
                outcome = Outcome.REFUSED
            else:
                self._text = body.text
            if self.is_deaf_after_load:
                self.is_deaf_after_load = self.is_here = False
                return
        elif isinstance(body, ReadMission):
            text = self._text
        reason = "the mission is running; abort it first" if outcome is Outcome.REFUSED else ""
        reply = CiReply(
            sender=request.sender,
            boot=request.boot,
            sequence=request.sequence,
            outcome=outcome,
            reason=reason,
            text=text,
        )
        self._loop.call_later(0.1, self._write, "reply", reply)

    def shown(self) -> list[str]:
        return [event.text for event in self.station.fleet.events]


def plan(name: str) -> CheckedPlan:
    return CheckedPlan(name=name, title=name, text=TEXT.format(name))


def played(steps: Callable[[Far], Awaitable[None]]) -> Far:
    async def whole() -> Far:
        far = Far()
        await asyncio.sleep(1.0)
        far.is_here = False
        await asyncio.sleep(5.0)
        await steps(far)
        far.station.close()
        far._timer.cancel()
        return far

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(whole())


def test_what_waits_is_sent_once_and_in_its_order_and_what_is_refused_is_told() -> None:
    async def steps(far: Far) -> None:
        queue = ContactQueue(far.station)
        one, two, three = (queue.add("petrel", plan(name)) for name in ("one", "two", "three"))
        far.refused = "two"
        await asyncio.sleep(30.0)
        assert not far.requests[-1:] or far.loads == []
        assert [queued.plan.name for queued in queue.of("petrel")] == ["one", "two", "three"]
        far.is_here = True
        assert [await queue.ended(queued) for queued in (one, three)] == [None, None]
        assert "abort it first" in str(await queue.ended(two))
        await asyncio.sleep(30.0)
        queue.close()

    far = played(steps)
    assert far.loads == ["one", "two", "three"]
    assert any("'two' was refused, and is no longer queued: the mission is running" in text for text in far.shown())
    assert not [request for request in far.requests if isinstance(request.body, Steer)], "nothing is started"


def test_what_is_withdrawn_is_not_sent_and_the_rest_outlives_the_station(tmp_path: Path) -> None:
    async def steps(far: Far) -> None:
        queue = ContactQueue(far.station, tmp_path / "queue.json")
        queue.add("petrel", plan("one"))
        queue.add("petrel", plan("two"))
        assert queue.withdraw("petrel")
        queue.close()
        queue = ContactQueue(far.station, tmp_path / "queue.json")
        far.is_here = True
        await asyncio.sleep(10.0)
        assert queue.of("petrel") == []
        queue.close()

    assert played(steps).loads == ["one"]


def test_an_upload_whose_answer_is_lost_is_not_sent_twice() -> None:
    async def steps(far: Far) -> None:
        queue = ContactQueue(far.station)
        far.is_deaf_after_load = far.is_here = True
        queued = queue.add("petrel", plan("one"))
        await asyncio.sleep(120.0)
        assert queue.of("petrel"), "it is not known whether it has arrived"
        far.is_here = True
        assert await queue.ended(queued) is None
        queue.close()

    far = played(steps)
    assert far.loads == ["one"]
    assert "'one' is there already" in far.shown()


def test_what_waits_lets_the_mission_under_way_end_first() -> None:
    async def steps(far: Far) -> None:
        queue = ContactQueue(far.station)
        far._text, far.state = "the mission before", "running"
        queued = queue.add("petrel", plan("one"))
        far.is_here = True
        await asyncio.sleep(20.0)
        assert far.loads == []
        assert "'one' waits for the end of the running mission" in far.shown()
        far.state = "done"
        assert await queue.ended(queued) is None
        queue.close()

    assert played(steps).loads == ["one"]


def test_a_start_never_waits_for_contact() -> None:
    async def steps(far: Far) -> None:
        desk = Desk(far.station, plan("one"))
        assert await desk.start("petrel") == {}
        await desk.stream("petrel")
        assert [queued.plan.name for queued in desk.queue.of("petrel")] == ["one"]
        reply = await far.station.client.request("petrel", Steer(verb=Verb.ABORT))
        assert reply.outcome is Outcome.UNKNOWN
        far.is_here = True
        await asyncio.sleep(10.0)
        desk.queue.close()

    far = played(steps)
    assert far.loads == ["one"]
    assert not [request for request in far.requests if isinstance(request.body, Steer)]
    assert any("a start is never queued" in text for text in far.shown())
