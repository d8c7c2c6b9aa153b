"""Main module of a child process of a host, which the main process starts and manages."""

import asyncio
import atexit
import ctypes
import gc
import os
import signal
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from gloc3.errors import Gloc3Error
from gloc3.exchange import zenoh_session
from gloc3.exchange.base import Deliver, Exchange, Unsubscribe
from gloc3.exchange.zenoh import ZenohExchange, open_exchange
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.hosts import HOSTS
from gloc3.messages.topics import TopicTable
from gloc3.platform.places import ProcessPlace
from gloc3.platform.reader import load_platform
from gloc3_onboard.hosts.loop import PlatformLoop
from gloc3_onboard.hosts.node import HostNode, NodeOptions
from gloc3_onboard.hosts.pipe import (
    Beat,
    ChildReady,
    ChildReport,
    ChildSetup,
    EndChild,
    FromChild,
    Pass,
    Pipe,
    ToChild,
    first_message,
)

REQUESTS: Final = ("/command", "/function")
PR_SET_PDEATHSIG: Final = 1
OOM_SCORE: Final = Path("/proc/self/oom_score_adj")
FIRST_TO_GO: Final = "500"
BEAT_S: Final = 0.25
BEATS_TO_REPORT: Final = 4
"""Heartbeats between two reports of the sensors."""
JOIN_S: Final = 20.0
"""How long the main process may take to be found."""
WRONG: Final = 2


class AgentExchange:
    """An exchange without remote requests: each arrives once, by the pipe.

    Args:
        exchange: exchange for all other messages.
    """

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange

    @property
    def here(self) -> Exchange:
        """What passes inside this process."""
        return self._exchange.here

    def publish(self, envelope: Envelope[Any]) -> None:
        """Sends a message."""
        self._exchange.publish(envelope)

    def subscribe(self, pattern: str, deliver: Deliver) -> Unsubscribe:
        """Asks for topics; for requests only as far as they come here."""
        exchange = self._exchange.here if pattern.endswith(REQUESTS) else self._exchange
        return exchange.subscribe(pattern, deliver)

    def declare_alive(self, token: str) -> Unsubscribe:
        """Says that something is here."""
        return self._exchange.declare_alive(token)

    def watch(self, pattern: str, changed: Callable[[str, bool], None]) -> Unsubscribe:
        """Reports tokens that come and go."""
        return self._exchange.watch(pattern, changed)


def main() -> int:
    """Runs as the main process commands, until it says otherwise or ends."""
    for number in (signal.SIGINT, signal.SIGTERM):  # they are meant for the main process, which leads the way out
        signal.signal(number, signal.SIG_IGN)
    atexit.register(gc.freeze)  # as in gloc3.cli.start
    end = socket.socket(fileno=int(sys.argv[1]))
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    with suppress(OSError):  # when memory ends, a child goes before the main process, which brings it up again
        OOM_SCORE.write_text(FIRST_TO_GO)
    order = first_message(end)
    if order is None or os.getppid() != order.parent:
        return 0
    try:
        with asyncio.Runner(loop_factory=lambda: PlatformLoop(order.offset_s)) as runner:
            runner.run(_run(end, order))
    except Gloc3Error as error:
        sys.stderr.write(f"{error}\n")
        return WRONG
    return 0


async def _run(end: socket.socket, order: ChildSetup) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, PlatformLoop)
    topics = TopicTable.installed()
    platform = load_platform(order.platform)
    joining = zenoh_session.ZenohEndpoints(name=order.process, connect=(order.endpoint,), is_child=True)
    with open_exchange(joining, loop, topics, _reported) as exchange:
        await joined(exchange, f"{platform.platform}/{HOSTS}/{order.host}")
        place = ProcessPlace(order.host, order.process)
        options = NodeOptions(
            platform=order.platform, logs=Path(order.logs), devices=order.devices, log_limits=order.log_limits
        )
        node = HostNode(platform, options, place, AgentExchange(exchange), loop, topics, _write_stderr)
        try:
            await ChildMain(end, order, node, exchange, loop).run()
        finally:
            await node.close()


def _reported(_kind: str, text: str) -> None:
    _write_stderr(Severity.WARNING, text)


def _write_stderr(_severity: Severity, text: str) -> None:
    """What is written there the main process narrates."""
    sys.stderr.write(f"{text}\n")


async def joined(exchange: ZenohExchange, token: str) -> None:
    """Waits for a peer, until both ends know each other's subscriptions.

    Raises:
        Gloc3Error: no peer appears.
    """
    found = asyncio.Event()
    unwatch = exchange.watch(token, lambda _, is_here: found.set() if is_here else None)
    try:
        async with asyncio.timeout(JOIN_S):
            await found.wait()
    except TimeoutError:
        raise Gloc3Error(f"{token} was not found within {JOIN_S:g} s") from None
    finally:
        unwatch()


class ChildMain:
    """The process's life between its begin and its end."""

    def __init__(
        self, end: socket.socket, order: ChildSetup, node: HostNode, exchange: ZenohExchange, loop: PlatformLoop
    ) -> None:
        self._loop = loop
        self._order, self._node, self._exchange = order, node, exchange
        self._ended = asyncio.Event()
        self._beats = 0
        self._onboard = node.make()
        self._pipe = Pipe(end, ToChild, self._loop, self._receive)  # type: ignore[arg-type] # a union is no class

    async def run(self) -> None:
        """Starts the components; returns when the main process says so or ends."""
        if self._order.lives is None:
            self._onboard.begin()
        else:
            self._onboard.begin_again(self._order.lives)
        self._pipe.send(ChildReady())
        self._beat()
        await self._ended.wait()

    def _beat(self) -> None:
        message: FromChild = Beat()
        if self._beats % BEATS_TO_REPORT == 0:
            message = Beat(self._node.sensors(), self._node.log_problem)
        self._beats += 1
        self._pipe.send(message)
        self._loop.call_later(BEAT_S, self._beat)

    def _receive(self, message: ToChild | FromChild | None) -> None:
        match message:
            case Pass(envelope=data):
                self._exchange.here.publish(self._node.context.topics.types.decode(data))
            case ChildReport(offset_s=offset_s):
                self._loop.steer(offset_s)
            case EndChild() | None:
                self._ended.set()


if __name__ == "__main__":
    sys.exit(main())
