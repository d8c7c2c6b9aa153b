"""The host in wall time, with real threads: what virtual time cannot show. Bounds are loose on purpose."""

import asyncio
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import pytest

from gloc3.clock import Clock, starved_s
from gloc3.component.context import HostContext
from gloc3.component.host import ComponentHost
from gloc3.component.lci import State
from gloc3.exchange import LocalExchange, Publisher, request
from gloc3.messages.envelope import CommandReply, CommandRequest, Envelope
from gloc3.messages.topics import TopicTable

from .specimen import Diary, Driver, Specimen, row

pytestmark = pytest.mark.thorough


class Site:
    """Hosts in the running loop, which is a real one."""

    def __init__(self) -> None:
        loop = asyncio.get_running_loop()
        self.exchange = LocalExchange()
        self.context = HostContext("site", self.exchange, Clock(loop), loop, TopicTable(), Random(1))
        self.hosts: list[ComponentHost] = []
        self.envelopes: list[Envelope[Any]] = []
        self.exchange.subscribe("**", self.envelopes.append)
        self._publisher = Publisher(self.exchange, "site", "test", 0)

    def host(self, create: Callable[[], Any], name: str = "specimen", **entries: Any) -> ComponentHost:
        """Hosts one more component and begins it."""
        entries.setdefault("rate_hz", 100.0)
        host = ComponentHost(row(name, **entries), create, self.context)
        self.hosts.append(host)
        host.begin()
        return host

    async def command(self, command: str, *then: str) -> CommandReply:
        """Sends a command and waits for the reply."""
        message = CommandRequest(request_id=command, command=command, then=then)
        topic = "site/components/specimen/command"
        reply: CommandReply = await request(self.exchange, self._publisher, topic, message, 10.0)
        return reply

    async def until(self, events: Callable[[], bool]) -> None:
        """Waits until something on the exchange has made a condition true."""
        changed = asyncio.Event()
        unsubscribe = self.exchange.subscribe("**", lambda _: changed.set())
        async with asyncio.timeout(60.0):
            while not events():
                changed.clear()
                await changed.wait()
        unsubscribe()


@contextmanager
def site() -> Iterator[Site]:
    """A site whose hosts are closed at the end."""
    found = Site()
    try:
        yield found
    finally:
        for host in found.hosts:
            host.close()


def in_wall_time(main: Callable[[], Awaitable[None]]) -> None:
    """Runs a test in an ordinary loop."""

    async def run() -> None:
        await main()

    asyncio.run(run())


def test_a_stuck_cycle_is_hung_while_others_run_on_and_its_thread_does_nothing_when_it_comes_back() -> None:
    async def main() -> None:
        release = threading.Event()
        diary, other = Diary(), Diary()
        with site() as here:
            host = here.host(lambda: Driver(diary))
            here.host(lambda: Specimen(other), "other", ports={"result": "other"})
            await here.until(lambda: len(diary.writes) > 3)
            diary.acts["work"] = release.wait
            await here.until(lambda: host.state is State.FAULTY)
            assert host.errors.last_cause == "hung: a cycle had not ended after 0.2 s"
            await here.until(lambda: "stop" in diary.calls)
            assert diary.calls.index("make_safe") < diary.calls.index("stop")
            cycles = other.calls.count("work")
            await here.until(lambda: other.calls.count("work") > cycles + 5)
            del diary.acts["work"]
            writes = len(diary.writes)
            stuck = [thread for thread in threading.enumerate() if thread.name == "specimen"]
            release.set()
            stuck[0].join(5.0)
            assert not stuck[0].is_alive()
            assert len(diary.writes) == writes
            assert (await here.command("initialize", "start")).state is State.WORKING
            assert diary.made == 2
            await here.until(lambda: len(diary.writes) > writes + 3)
            assert all(b > a for a, b in zip(diary.writes, diary.writes[1:], strict=False))

    in_wall_time(main)


class StarvedClock(Clock):
    """The clock of a process whose threads wait for a processor all the time."""

    def starved_s(self) -> float:
        return self.now_s()


@pytest.mark.parametrize("blocked_s", [0.6, 60.0])
def test_a_process_without_a_processor_makes_nothing_hung_within_a_second(blocked_s: float) -> None:
    async def main() -> None:
        release = threading.Event()
        diary = Diary()
        with site() as here:
            here.context = here.context._replace(clock=StarvedClock(asyncio.get_running_loop()))
            host = here.host(lambda: Driver(diary))
            await here.until(lambda: len(diary.writes) > 3)
            diary.acts["work"] = release.wait
            writes = len(diary.writes)
            asyncio.get_running_loop().call_later(blocked_s, release.set)
            await here.until(lambda: host.state is State.FAULTY or len(diary.writes) > writes + 1)
            assert host.state is (State.WORKING if blocked_s < 1.0 else State.FAULTY)
            release.set()

    in_wall_time(main)


def test_what_threads_wait_for_a_processor_is_read_from_the_kernel(tmp_path: Path) -> None:
    for thread, text in {"7": "5 2000000000 9\n", "8": "5 500000000 9\n", "9": "\n"}.items():
        (tmp_path / thread).mkdir()
        (tmp_path / thread / "schedstat").write_text(text)
    assert starved_s(tmp_path) == pytest.approx(2.5)
    assert starved_s(tmp_path / "none") == 0.0
    assert starved_s() > 0.0


def test_a_process_that_stands_still_for_a_moment_makes_nothing_hung() -> None:
    async def main() -> None:
        begun, release = threading.Event(), threading.Event()
        diary = Diary()
        with site() as here:
            host = here.host(lambda: Driver(diary))
            await here.until(lambda: len(diary.writes) > 3)

            def work() -> None:
                begun.set()
                release.wait()

            diary.acts["work"] = work
            while not begun.is_set():
                await asyncio.sleep(0.001)
            time.sleep(0.6)  # neither this thread nor the component's gets on
            asyncio.get_running_loop().call_later(0.02, release.set)
            writes = len(diary.writes)
            await here.until(lambda: host.state is State.FAULTY or len(diary.writes) > writes)
            assert host.state is State.WORKING

    in_wall_time(main)


@pytest.mark.parametrize("command", ["initialize", "stop"])
def test_a_stuck_method_is_a_time_out_and_its_component_can_be_brought_up_again(command: str) -> None:
    async def main() -> None:
        release = threading.Event()
        diary = Diary()
        with site() as here:
            host = here.host(lambda: Specimen(diary), begin="idle", timeout_s=0.25)
            if command == "stop":
                await here.command("initialize", "start")
            diary.acts[command] = release.wait
            reply = await here.command(command)
            assert (reply.is_accepted, reply.state) == (False, State.FAULTY)
            assert reply.reason == f"{command} failed: timeout: {command} took over 0.25 s"
            diary.acts.clear()
            assert (await here.command("initialize", "start")).state is State.WORKING
            assert host.state is State.WORKING
            release.set()

    in_wall_time(main)


def test_a_start_that_returns_after_its_time_out_is_stopped_and_does_not_disturb_the_next() -> None:
    async def main() -> None:
        release = threading.Event()
        diary = Diary()
        diary.acts["start"] = release.wait
        with site() as here:
            host = here.host(lambda: Specimen(diary), timeout_s=0.25)
            await here.until(lambda: host.state is State.FAULTY)
            late = [thread for thread in threading.enumerate() if thread.name == "specimen"]
            assert diary.methods()[-1] == "start"
            release.set()
            late[0].join(5.0)
            assert diary.methods()[-2:] == ["start", "stop"]
            diary.acts.clear()
            assert (await here.command("initialize", "start")).state is State.WORKING
            assert diary.methods().count("stop") == 1

    in_wall_time(main)


def test_a_component_whose_finish_is_stuck_too_can_be_brought_up_at_the_second_try() -> None:
    async def main() -> None:
        release = threading.Event()
        diary = Diary()
        with site() as here:
            here.host(lambda: Specimen(diary), timeout_s=0.25)
            await here.until(lambda: "work" in diary.calls)
            diary.acts["stop"] = diary.acts["finish"] = release.wait
            await here.command("stop")
            reply = await here.command("initialize")
            assert reply.reason == "initialize failed: timeout: initialize took over 0.25 s"
            assert (await here.command("initialize", "start")).state is State.WORKING
            release.set()

    in_wall_time(main)


def test_methods_run_off_the_control_path_and_other_commands_are_busy() -> None:
    async def main() -> None:
        release = threading.Event()
        diary, other = Diary(), Diary()
        diary.acts["initialize"] = release.wait
        with site() as here:
            host = here.host(lambda: Specimen(diary))
            here.host(lambda: Specimen(other), "other", ports={"result": "other"})
            await here.until(lambda: other.calls.count("work") > 5)
            assert host.is_beginning
            assert (await here.command("shutdown")).reason.startswith("busy")
            release.set()
            await here.until(lambda: host.state is State.WORKING)

    in_wall_time(main)


@pytest.mark.parametrize("error", [SystemExit(1), KeyboardInterrupt()])
def test_an_author_who_exits_or_kills_his_thread_harms_only_himself(error: BaseException) -> None:
    async def main() -> None:
        diary, other = Diary(), Diary()
        diary.errors["work"] = error
        with site() as here:
            host = here.host(lambda: Specimen(diary))
            here.host(lambda: Specimen(other), "other", ports={"result": "other"})
            await here.until(lambda: host.state is State.FAULTY)
            cycles = other.calls.count("work")
            await here.until(lambda: other.calls.count("work") > cycles + 3)

    in_wall_time(main)


def test_costs_are_measured_in_wall_time() -> None:
    async def main() -> None:
        with site() as here:
            host = here.host(lambda: Specimen(Diary()))
            await here.until(lambda: host.status().cycles > 3)
            assert 0.0 < host.status().cycle_mean_s < 1.0

    in_wall_time(main)


def test_a_closed_host_leaves_no_thread_behind() -> None:
    async def main() -> None:
        with site() as here:
            host = here.host(lambda: Specimen(Diary()), "leaving")
            await here.until(lambda: host.status().cycles > 3)
        for thread in threading.enumerate():
            if thread.name == "leaving":
                thread.join(timeout=60.0)
                assert not thread.is_alive()

    in_wall_time(main)
