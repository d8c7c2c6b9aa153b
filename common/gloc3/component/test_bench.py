"""Test bench: components under their real hosts, on one exchange, in virtual time, without sockets or sleeps."""

import asyncio
from collections.abc import Callable
from random import Random
from types import TracebackType
from typing import Any, Final, Self

from gloc3.clock import Clock, VirtualLoop
from gloc3.component.component import Component
from gloc3.component.context import HostContext
from gloc3.component.deployment import ComponentRow
from gloc3.component.host import ComponentHost
from gloc3.component.lci import State
from gloc3.exchange import LocalExchange, Publisher, request
from gloc3.messages.envelope import CommandReply, CommandRequest, Envelope, FunctionReply, FunctionRequest, Message
from gloc3.messages.topics import TopicTable

PLATFORM: Final = "bench"
REPLY_TIMEOUT_S: Final = 60.0


class Bench:
    """Hosts components and stands in for the rest of the platform.

    ```python
    with Bench() as bench:
        bench.host(ComponentRow(name="echo", class_name="mine:Echo", rate_hz=10.0), Echo)
        bench.send("question", Question(text="?"))
        bench.run(0.1)
        assert bench.last("answer").text == "?"
    ```
    """

    def __init__(
        self,
        *,
        topics: TopicTable | None = None,
        seed: int = 1,
        cycle_cost_s: Callable[[str, float], float] | None = None,
        method_cost_s: Callable[[str, str, float], float] | None = None,
    ) -> None:
        """Creates an empty bench; the costs model the duration of cycles and methods (default: zero)."""
        self.loop = VirtualLoop()
        self.exchange = LocalExchange()
        self.context = HostContext(
            platform=PLATFORM,
            exchange=self.exchange,
            clock=Clock(self.loop),
            loop=self.loop,
            topics=topics or TopicTable(),
            random=Random(seed),
            cycle_cost_s=cycle_cost_s,
            method_cost_s=method_cost_s,
        )
        self.hosts: dict[str, ComponentHost] = {}
        self.envelopes: list[Envelope[Any]] = []
        """Everything that was published, in order."""
        self.exchange.subscribe("**", self.envelopes.append)
        self._publisher = Publisher(self.exchange, PLATFORM, "bench", 0)
        self._requests = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for host in self.hosts.values():
            host.close()
        self.loop.close()
        if error is None and self.loop.failures:
            raise self.loop.failures[0]

    def host(self, row: ComponentRow, create: Callable[[], Component[Any]]) -> ComponentHost:
        """Adds a component to the bench and brings it to the state that its row asks for."""
        host = self.hosts[row.name] = ComponentHost(row, create, self.context)
        self._within_loop(host.begin)
        return host

    def run(self, duration_s: float) -> None:
        """Lets virtual time pass."""
        self.loop.run_until_complete(asyncio.sleep(duration_s))

    def send(self, topic: str, message: Message, *, t_s: float | None = None, frame: str = "") -> None:
        """Publishes a message (the topic without the platform's name)."""
        now_s = self.loop.time() if t_s is None else t_s
        self._within_loop(lambda: self._publisher.publish(f"{PLATFORM}/{topic}", message, now_s, frame))

    def command(self, name: str, command: str, settings: dict[str, Any] | None = None, *then: str) -> CommandReply:
        """Sends an LCI command (or several, carried out together) and waits for the reply."""
        message = CommandRequest(request_id=self._next_id(), command=command, settings=settings, then=then)
        reply: CommandReply = self._request(f"components/{name}/command", message)
        return reply

    def call(self, name: str, function: str, **arguments: Any) -> FunctionReply:
        """Sends a function message and waits for the reply."""
        message = FunctionRequest(request_id=self._next_id(), function=function, arguments=arguments)
        reply: FunctionReply = self._request(f"components/{name}/function", message)
        return reply

    def state(self, name: str) -> State | None:
        """A component's state; None is *absent*."""
        return self.hosts[name].state

    def all(self, topic: str) -> list[Any]:
        """Messages published on a topic, oldest first."""
        return [envelope.payload for envelope in self.envelopes if envelope.topic == f"{PLATFORM}/{topic}"]

    def last(self, topic: str) -> Any:
        """The newest message of a topic.

        Raises:
            LookupError: there was none.
        """
        found = self.all(topic)
        if not found:
            raise LookupError(f"nothing was published on {topic!r}")
        return found[-1]

    def _next_id(self) -> str:
        self._requests += 1
        return str(self._requests)

    def _request(self, topic: str, message: CommandRequest | FunctionRequest) -> Any:
        return self.loop.run_until_complete(
            request(self.exchange, self._publisher, f"{PLATFORM}/{topic}", message, REPLY_TIMEOUT_S)
        )

    def _within_loop(self, act: Callable[[], None]) -> None:
        async def main() -> None:
            act()

        self.loop.run_until_complete(main())
