"""Intruders at a real onboard process: who reads and commands it over real TLS links, judged from its own log.

Every command is a rate of one component that is used once, so that what was carried out is known again in the log.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import signal
import socket
from collections.abc import AsyncIterator, Mapping
from contextlib import ExitStack, asynccontextmanager
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace
from tests.commands.programs import Program, program
from tests.common.network.yard import NOW, Yard

from gloc3.clock import utc_now
from gloc3.exchange import Publisher
from gloc3.exchange.zenoh import ZenohExchange, open_exchange
from gloc3.exchange.zenoh_session import ZenohEndpoints
from gloc3.log.commands import list_commands
from gloc3.log.reader import LogReader
from gloc3.messages.command_interface import AnyBody, CallFunction, CiReply, CiRequest, Control, ControlVerb
from gloc3.messages.envelope import Envelope, FunctionRequest
from gloc3.messages.topics import TopicTable
from gloc3.messages.wire import type_name
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.authority import read_certificate, read_key
from gloc3.network.platform_clocks import PlatformClocks
from gloc3.network.signatures import RequestSigner
from gloc3.platform.reader import whole_text
from gloc3_sitl.demo.demo import free_ports

PLATFORM, COMPONENT = "pelican", "hold"
FUNCTION = f"{PLATFORM}/components/{COMPONENT}/function"
TRY_S = 3.0
"""So long each intruder reads and commands."""
EVERY_S = 0.1
TIMEOUT_S = 60.0
DAY = timedelta(days=1)
LEAST_HZ, STEP_HZ = 20.0, 0.01


class Attempt(msgspec.Struct):
    """What one of them tried, and what came of it."""

    who: str
    messages_read: int
    tokens_seen: int
    sent: int
    """Commands, each of a rate of its own."""
    carried_out: int = 0
    recorded: int = 0
    """Commands that the platform's record has under its name as accepted."""
    rates_hz: list[float] = []


class Found(msgspec.Struct):
    """Of all of them."""

    attempts: list[Attempt]
    owner: Attempt
    """The operator who commands meanwhile."""
    repeated: int
    """How often the platform carried out a command that its author sent five times."""
    replayed: int
    """How often one whose encrypted bytes were sent again."""
    replayed_bytes: int
    authors: dict[str, int]
    """Accepted commands in the record, by author, role and way."""
    lines: list[str]
    """What `gloc3 log commands` prints of them, at first and at last."""
    told_of_forgeries: list[str]


class Rates:
    """Rates that are given out once."""

    def __init__(self) -> None:
        self._numbers = count()

    def next(self) -> float:
        """One that nobody has had."""
        return round(LEAST_HZ + STEP_HZ * next(self._numbers), 2)


class Speaker:
    """A station that asks under some name, on some keys, and signs with the key of its certificate, if it has one."""

    def __init__(
        self, exchange: ZenohExchange, name: str, rates: Rates, boot: int, signer: RequestSigner | None
    ) -> None:
        self.rates_hz: list[float] = []
        self._name, self._rates, self._boot = name, rates, boot
        self._exchange = exchange
        self._publisher = Publisher(exchange, name, "ci", boot)
        self._sequences, self._numbers = count(), count()
        self._answered: dict[int, asyncio.Future[CiReply]] = {}
        self._signer, self._clocks, self._now_s = signer, PlatformClocks(), asyncio.get_running_loop().time
        exchange.subscribe(f"{PLATFORM}/ci/reply", self._receive)
        exchange.subscribe(f"{PLATFORM}/ci/summary", lambda one: self._clocks.receive(one, self._now_s()))

    def request(self, body: AnyBody) -> CiRequest:
        """The next request."""
        return CiRequest(sender=self._name, boot=self._boot, sequence=next(self._sequences), body=body)

    def send(self, key: str, request: CiRequest) -> None:
        """Sends it on a key."""
        topic, source = f"{PLATFORM}/ci/{key}", self._publisher.source
        envelope: Envelope[Any] = Envelope(topic, source, next(self._numbers), 0.0, "", type_name(CiRequest), request)
        if self._signer is not None and key != "request":
            until_s, boot = self._clocks.until_s(PLATFORM, self._now_s(), TIMEOUT_S), self._clocks.boot(PLATFORM)
            types, utc_s = TopicTable.installed().types, utc_now().timestamp()
            envelope = self._signer.sign(envelope, types, until_s=until_s, boot=boot, utc_s=utc_s)
        self._exchange.publish(envelope)

    def command(self) -> CallFunction:
        """One that is known again."""
        self.rates_hz.append(self._rates.next())
        return CallFunction(component=COMPONENT, function="set_rate", arguments={"rate_hz": self.rates_hz[-1]})

    def seize(self, keys: tuple[str, ...]) -> None:
        """Takes control and commands, on all of these keys, and also the component itself."""
        for key in keys:
            self.send(key, self.request(Control(verb=ControlVerb.TAKE_OVER)))
            self.send(key, self.request(self.command()))
        arguments = self.command().arguments
        self._publisher.publish(
            FUNCTION, FunctionRequest(request_id="1", function="set_rate", arguments=arguments), 0.0
        )

    async def send_request(self, body: AnyBody, times: int = 1) -> CiReply:
        """Asks as a station does, some times at once, until it is answered."""
        request = self.request(body)
        answer = self._answered[request.sequence] = asyncio.get_running_loop().create_future()
        async with asyncio.timeout(TIMEOUT_S):
            while not self._clocks.boot(PLATFORM):
                await asyncio.sleep(0.05)
            while not answer.done():
                for _ in range(times):
                    self.send(f"request/{self._name}", request)
                await asyncio.wait([answer], timeout=1.0)
        reply: CiReply = answer.result()
        return reply

    def _receive(self, envelope: Envelope[CiReply]) -> None:
        reply = envelope.payload
        answer = self._answered.get(reply.sequence)
        if reply.sender == self._name and reply.boot == self._boot and answer is not None and not answer.done():
            answer.set_result(reply)


def signer_of(settings: Mapping[str, Any]) -> RequestSigner | None:
    """Signs with the key that Zenoh's settings name; None where they name none."""
    link = settings.get("transport/link/tls", {})
    if "connect_private_key" not in link:
        return None
    key, certificate = Path(link["connect_private_key"]), Path(link["connect_certificate"])
    return RequestSigner(read_key(key), read_certificate(certificate))


class Scene:
    """A vehicle on a network, with an operator whose commands are carried out all the time."""

    def __init__(self, yard: Yard, onboard: Program, alice: Speaker, rates: Rates) -> None:
        self.yard, self.onboard, self.alice, self.rates = yard, onboard, alice, rates
        self._boots = count(100)

    async def renew(self) -> None:
        """The platform reads its network file again."""
        before = len(self.onboard.lines)
        self.onboard.process.send_signal(signal.SIGHUP)
        await asyncio.to_thread(
            self.onboard.await_line, lambda line: "network.yaml is reloaded" in line, TIMEOUT_S, before
        )
        await self.show_that_it_obeys()

    async def show_that_it_obeys(self) -> None:
        """The operator takes control and commands."""
        async with asyncio.timeout(TIMEOUT_S):
            while (await self.alice.send_request(Control(verb=ControlVerb.TAKE_OVER))).outcome != "accepted":
                await asyncio.sleep(EVERY_S)  # the platform is still starting
        reply = await self.alice.send_request(self.alice.command())
        assert reply.outcome == "accepted", reply

    async def attempt(
        self, who: str, name: str, node: ZenohEndpoints, settings: dict[str, Any], keys: tuple[str, ...]
    ) -> Attempt:
        """Somebody opens a link, reads what can be read, and commands as some name."""
        loop, topics = asyncio.get_running_loop(), TopicTable.installed()
        messages: list[str] = []
        tokens: set[str] = set()
        with open_exchange(node, loop, topics, settings={**settings, "access_control": {"enabled": False}}) as other:
            speaker = Speaker(other, name, self.rates, next(self._boots), signer_of(settings))
            end_s = loop.time() + TRY_S
            for pattern in ("**", "*/ci/*", f"{PLATFORM}/**"):
                other.subscribe(pattern, lambda envelope: messages.append(envelope.topic))
                other.watch(pattern, lambda token, _: tokens.add(token))
            while loop.time() < end_s:
                speaker.seize(keys)
                await asyncio.sleep(EVERY_S)
            own = {FUNCTION, *(f"{PLATFORM}/ci/{key}" for key in keys)}
        await self.show_that_it_obeys()
        rates_hz = speaker.rates_hz
        return Attempt(
            who, len([topic for topic in messages if topic not in own]), len(tokens), len(rates_hz), 0, 0, rates_hz
        )


def keys_of(name: str) -> tuple[str, ...]:
    """Where an intruder sends its commands: under its own name, under the operator's, and as one inside the platform."""
    return (f"request/{name}", "request/alice", f"ask/{name}", "request")


@asynccontextmanager
async def scene(folder: Path, stack: ExitStack) -> AsyncIterator[Scene]:
    """A simulated vehicle, its onboard process on the network, and the operator."""
    yard, rates = Yard(folder / "yard"), Rates()
    for name, now, valid in (
        ("carol", datetime.now(UTC), 30 * DAY),
        ("mallory", datetime.now(UTC), 30 * DAY),
        ("erin", datetime.now(UTC), timedelta(hours=-1)),
        ("frank", datetime.now(UTC) + 10 * DAY, 30 * DAY),
    ):
        register.add(yard.folder, name, entry(), now, valid, is_renewed=False)
    (cable,) = free_ports(1, socket.SOCK_DGRAM)
    text = whole_text("pelican_rtk")
    (folder / "pelican.yaml").write_text(re.sub(r"(?m)^platform: .*$", f"platform: {PLATFORM}", text))
    stack.enter_context(program("sitl", "--link", f"companion=udpout://127.0.0.1:{cable}", folder=folder))
    onboard = stack.enter_context(
        program(
            *("onboard", "pelican.yaml", "--autopilot", f"udpin://127.0.0.1:{cable}", "--out", "out"),
            *("--network", "yard/pelican.main/network.yaml"),
            folder=folder,
        )
    )
    await asyncio.to_thread(onboard.await_line, lambda line: "components; log in" in line)
    with yard.open("alice") as network:
        found = Scene(yard, onboard, Speaker(network, "alice", rates, 9, yard.membership("alice").signer()), rates)
        await found.show_that_it_obeys()
        yield found
    onboard.interrupt()
    assert await asyncio.to_thread(onboard.end) == 0, onboard.text


def entry() -> register.NetworkMember:
    """An operator's."""
    return register.NetworkMember(role=MemberRole.OPERATOR, certificate="", until="")


async def strangers(yard: Yard, folder: Path) -> list[tuple[str, str, ZenohEndpoints, dict[str, Any]]]:
    """Those whose certificates do not count: who, their name, node and settings."""
    carol = yard.membership("carol")
    no_certificate = carol.settings()
    for key in ("connect_certificate", "connect_private_key"):
        del no_certificate["transport/link/tls"][key]
    foreign = Yard(folder / "other", yard.address)
    foreign_settings = foreign.membership("alice").settings()
    root = carol.settings()["transport/link/tls"]["root_ca_certificate"]
    foreign_settings["transport/link/tls"]["root_ca_certificate"] = root
    plain = replace(carol.node(), connect=(f"tcp/{yard.address}",))
    erin, frank = (
        yard.membership("erin", NOW - DAY),
        yard.membership("frank", NOW + 11 * DAY),
    )
    return [
        ("without encryption", "carol", plain, {}),
        ("without a certificate", "carol", carol.node(), no_certificate),
        ("operator's name, other authority", "alice", foreign.membership("alice").node(), foreign_settings),
        ("operator's certificate, expired", "erin", erin.node(), erin.settings()),
        ("operator's certificate, not yet valid", "frank", frank.node(), frank.settings()),
    ]


class Tap:
    """Carries a TCP connection on, and keeps what the client has sent: it cannot read it, but it can send it again."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._to = host, int(port)
        self.kept = bytearray()
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self) -> str:
        """Where it listens."""
        self._server = await asyncio.start_server(self._carry, "127.0.0.1", 0)
        return f"127.0.0.1:{self._server.sockets[0].getsockname()[1]}"

    async def close(self) -> None:
        """Cuts all connections."""
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def send_again(self) -> None:
        """What was kept, on a connection of its own, to whoever listens."""
        reader, writer = await asyncio.open_connection(*self._to)
        writer.write(bytes(self.kept))
        with contextlib.suppress(OSError, TimeoutError):
            async with asyncio.timeout(TRY_S):
                await writer.drain()
                await reader.read()
        writer.close()

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        other_reader, other_writer = await asyncio.open_connection(*self._to)
        for source, target, kept in ((reader, other_writer, self.kept), (other_reader, writer, None)):
            task = asyncio.create_task(self._copy(source, target, kept))
            self._tasks.add(task)

    async def _copy(self, source: asyncio.StreamReader, target: asyncio.StreamWriter, kept: bytearray | None) -> None:
        try:
            while data := await source.read(65536):
                if kept is not None:
                    kept += data
                target.write(data)
        finally:
            target.close()


async def intrude(folder: Path) -> Found:
    """All of them, one after the other."""
    with ExitStack() as stack:
        async with scene(folder, stack) as at:
            yard = at.yard
            attempts = [
                await at.attempt(who, name, node, settings, keys_of(name))
                for who, name, node, settings in await strangers(yard, folder)
            ]
            bob, mallory, carol = (yard.membership(name) for name in ("bob", "mallory", "carol"))
            attempts.append(
                await at.attempt("observer's certificate", "bob", bob.node(), bob.settings(), keys_of("bob"))
            )
            attempts.append(
                await at.attempt(
                    "another operator's certificate, in the operator's name",
                    *("alice", mallory.node(), mallory.settings(), (*keys_of("alice"), "request/mallory")),
                )
            )
            tapped_hz, kept = await tap(at)
            who = "operator's certificate"
            attempts.append(
                await at.attempt(f"{who}, good", "carol", carol.node(), carol.settings(), ("request/carol",))
            )
            register.revoke(yard.folder, "carol", datetime.now(UTC))
            await at.renew()
            attempts.append(
                await at.attempt(f"{who}, revoked", "carol", carol.node(), carol.settings(), keys_of("carol"))
            )
            attempts += await expire(at)
            repeated = at.alice.command()
            assert (await at.alice.send_request(repeated, times=5)).outcome == "accepted"
    with program("log", "commands", "out", folder=folder) as listed:
        assert listed.end() == 0, listed.text
    return judge(folder, attempts, at, tapped_hz, kept, repeated.arguments["rate_hz"], listed.lines)


async def tap(at: Scene) -> tuple[float, int]:
    """An operator commands over a line that somebody taps, who sends all of it again; the command's rate, and its bytes."""
    line = Tap(at.yard.address)
    carol = at.yard.membership("carol")
    node = replace(carol.node(), connect=(f"tls/{await line.open()}",))
    loop = asyncio.get_running_loop()
    with open_exchange(node, loop, TopicTable.installed(), settings=carol.settings()) as network:
        speaker = Speaker(network, "carol", at.rates, 8, carol.signer())
        await speaker.send_request(Control(verb=ControlVerb.TAKE_OVER))
        assert (await speaker.send_request(speaker.command())).outcome == "accepted"
    await line.close()
    await line.send_again()
    await at.show_that_it_obeys()
    return speaker.rates_hz[0], len(line.kept)


async def expire(at: Scene) -> list[Attempt]:
    """Somebody whose certificate expires while the link is open."""
    valid_s = 8.0
    loop = asyncio.get_running_loop()
    register.add(at.yard.folder, "dave", entry(), datetime.now(UTC), timedelta(seconds=valid_s), is_renewed=False)
    begin_s = loop.time()
    await at.renew()
    dave = at.yard.membership("dave")
    found = []
    with open_exchange(dave.node(), loop, TopicTable.installed(), settings=dave.settings()) as network:
        speaker = Speaker(network, "dave", at.rates, 7, dave.signer())
        messages: list[str] = []
        network.subscribe("*/ci/*", lambda envelope: messages.append(envelope.topic))
        for who, until_s in (("before", valid_s - 1.0), ("after", valid_s + 4.0)):
            messages.clear()
            speaker.rates_hz = []
            while loop.time() < begin_s + until_s:
                speaker.seize(("request/dave",))
                await asyncio.sleep(EVERY_S)
            found.append(
                Attempt(f"link open when its certificate expires: {who}", len(messages), 0, 1, 0, 0, speaker.rates_hz)
            )
            await asyncio.sleep(2.0)
    await at.show_that_it_obeys()
    return [msgspec.structs.replace(one, sent=len(one.rates_hz)) for one in found]


def judge(
    folder: Path,
    attempts: list[Attempt],
    at: Scene,
    tapped_hz: float,
    kept: int,
    repeated_hz: float,
    lines: list[str],
) -> Found:
    """What came of all of it, by the platform's log."""
    done: dict[float, int] = {}
    with LogReader(folder / "out" / "log.mcap", TopicTable.installed().types) as reader:
        for envelope in reader.entries(f"components/{COMPONENT}/function"):
            rate_hz = envelope.envelope.payload.arguments.get("rate_hz")
            if rate_hz is not None:
                done[rate_hz] = done.get(rate_hz, 0) + 1
        events = [each.envelope.payload.text for each in reader.entries("ci/event")]
        commands = list_commands(reader)
    authors: dict[str, int] = {}
    for one in commands:
        if one.outcome == "accepted":
            author = f"{one.role} {one.sender} ({one.way})"
            authors[author] = authors.get(author, 0) + 1

    def judged(attempt: Attempt) -> Attempt:
        rates = {f"{rate_hz}" for rate_hz in attempt.rates_hz}
        recorded = [one for one in commands if any(f": {rate}}}" in one.what for rate in rates)]
        return msgspec.structs.replace(
            attempt, carried_out=sum(done.get(rate_hz, 0) for rate_hz in attempt.rates_hz), recorded=len(recorded)
        )

    owner = Attempt("the operator meanwhile", 0, 0, len(at.alice.rates_hz), 0, 0, at.alice.rates_hz)
    return Found(
        attempts=[judged(attempt) for attempt in attempts],
        owner=judged(owner),
        repeated=done.get(repeated_hz, 0),
        replayed=done.get(tapped_hz, 0),
        replayed_bytes=kept,
        authors=authors,
        lines=[lines[0], lines[-1]],
        told_of_forgeries=sorted({text for text in events if "says that it is of" in text}),
    )
