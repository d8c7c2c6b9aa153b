"""A host's main process inside a test, with real child processes and the real command interface server."""

import asyncio
import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from random import Random
from typing import Any

from gloc3.clock import Clock
from gloc3.component.context import HostContext
from gloc3.component.lci import State
from gloc3.messages.envelope import ComponentStatus, Envelope
from gloc3.platform.places import ProcessPlace, rows_at
from gloc3.platform.reader import read_platform, whole_text
from gloc3.store import MemoryRecords
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.hosts.child import ChildProcess
from gloc3_onboard.hosts.host_agent import HostAgent
from gloc3_onboard.hosts.pipe import ChildSetup
from gloc3_onboard.hosts.shared import open_shared
from gloc3_onboard.process.run_log import LogLimits
from gloc3_onboard.process.runner import Onboard

HEAD = """\
platform: probe
vehicle: {type: quadrotor, mass_kg: 1.65}
components:
"""
TICKER = "tests.onboard.hosts.specimens:Ticker"


def server_row() -> str:
    """The row of the command interface server, as every platform has it."""
    text = whole_text("pelican")
    return next(line for line in text.splitlines() if "name: command_server" in line) + "\n"


class Rig:
    """What the test sees of the platform."""

    def __init__(self, onboard: Onboard, keeper: HostAgent, loop: asyncio.AbstractEventLoop, out: Path) -> None:
        self.onboard, self.keeper, self.out = onboard, keeper, out
        self.statuses: list[tuple[float, ComponentStatus]] = []
        self.received: dict[str, list[tuple[float, Envelope[Any]]]] = {}
        self._loop = loop

    def receive(self, envelope: Envelope[Any]) -> None:
        now_s = self._loop.time()
        self.received.setdefault(envelope.topic.partition("/")[2], []).append((now_s, envelope))
        if isinstance(envelope.payload, ComponentStatus):
            self.statuses.append((now_s, envelope.payload))

    def child(self, name: str) -> ChildProcess:
        return next(child for child in self.keeper.children if child.name == name)

    def state(self, component: str) -> State | None:
        return next((status.state for _, status in reversed(self.statuses) if status.name == component), None)

    def first(self, component: str, state: State, since_s: float) -> tuple[float, ComponentStatus]:
        return next(
            (t_s, status)
            for t_s, status in self.statuses
            if t_s >= since_s and status.name == component and status.state is state
        )

    async def until(self, is_so: Callable[[], bool], what: str, within_s: float = 60.0) -> None:
        end_s = self._loop.time() + within_s
        while not is_so():
            states = {name: self.state(name) for name in ("ticker", "ticker_standby")}
            assert self._loop.time() < end_s, f"not within {within_s:g} s: {what}; {states}"
            await asyncio.sleep(0.01)


@asynccontextmanager
async def rig(rows: str, out: Path) -> AsyncIterator[Rig]:
    """The platform of these rows and the server, begun; it is stopped in order."""
    file = out / "probe.yaml"
    file.write_text(HEAD + rows + server_row())
    platform = read_platform(file.read_bytes(), str(file), is_loading_classes=True)
    loop, random = asyncio.get_running_loop(), Random(1)
    problems: list[str] = []
    with open_shared(platform, "main", out, loop, lambda _, text: problems.append(text)) as shared:
        context = HostContext("probe", shared.exchange, Clock(loop), loop, shared.topics, random)

        def order(process: str, lives: dict[str, str | None] | None) -> ChildSetup:
            return ChildSetup(
                platform=str(file), host="main", process=process, endpoint=shared.endpoint, logs=str(out), devices=(),
                parent=os.getpid(), offset_s=0.0, log_limits=LogLimits(), lives=lives,
            )  # fmt: skip

        keeper = HostAgent(platform, "main", context, order, lambda _: None)
        devices = {"site": Site(platform, MemoryRecords(), MemoryRecords(), MemoryRecords())}
        onboard = Onboard(
            platform, context, devices, rows=rows_at(platform, ProcessPlace("main")), placeholders=keeper.placeholders
        )
        found = Rig(onboard, keeper, loop, out)
        shared.exchange.subscribe("probe/**", found.receive)
        try:
            keeper.begin()
            onboard.begin()
            yield found
            await onboard.stop(problems.append)
            onboard.close()
            await keeper.end()
            assert not problems, problems
        finally:
            keeper.close()


__all__ = ["TICKER", "Rig", "rig"]
