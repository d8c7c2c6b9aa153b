"""Attacks on a vehicle's network while it flies, over network namespaces: attackers and vehicle are different computers.

Each attack is a process in a namespace of its own (`python -m tests.onboard.hostile_network SPECIFICATION`). What came of
it is judged from the vehicle's own log: commands that were carried out, and the longest time for which the loop stood still.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import msgspec
import zenoh
from msgspec.structs import replace
from tests.bare_loop import bare_loop
from tests.commands.listening import listening
from tests.commands.programs import Program, program
from tests.common.network.yard import NOW, Yard
from tests.onboard.hosts.namespaces import run as run_program
from tests.onboard.intruders import Rates, Speaker, Tap, keys_of, signer_of, strangers

from gloc3.clock import monotonic_s
from gloc3.exchange.zenoh import open_exchange
from gloc3.exchange.zenoh_session import ZenohEndpoints, new_session
from gloc3.log.commands import list_commands
from gloc3.log.reader import LogReader
from gloc3.messages.topics import TopicTable
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.rights_file import RIGHTS_FILE
from gloc3.platform.reader import whole_text
from gloc3_sitl.demo.demo import free_ports

ROOT: Final = Path(__file__).parents[2]
NET: Final = "10.88.0"
VEHICLE, GROUND, STRANGER = "vehicle", "ground", "stranger"
SPACES: Final = {VEHICLE: f"{NET}.1", GROUND: f"{NET}.2", STRANGER: f"{NET}.3"}
ADDRESS: Final = f"{SPACES[VEHICLE]}:7447"
SCOUTED: Final = 7446
"""Port of Zenoh's multicast scouting."""
CONNECTED_S: Final = 0.5
"""Time in which connections are accepted, s."""
BEGUN: Final = b"\x16\x03\x01\x02\x00"
"""The beginning of TLS: the header of a record, without the record."""
LOOP_TOPIC: Final = "setpoint"
"""A topic that the vehicle's loop publishes by its own timer."""
LOOP_S: Final = 0.05
"""Its period."""
MISSION: Final = """\
mission: hostile
frame: hold
geofence: {polygon_m: [[-5, -5], [20, -5], [20, 12], [-5, 12]], ceiling_m: 8}
on_link_loss: continue
tasks:
  stay:
    actions:
      up: {take_off: {height_m: 1.5}}
      wait: {hold: {duration_s: 600}, after: [up]}
"""


class Attack(msgspec.Struct, frozen=True, kw_only=True):
    """One attack."""

    name: str
    kind: str
    """`speak`, `flood`, `huge`, `idle`, `scout`, `replay` or `join`."""
    space: str = STRANGER
    seconds: float = 5.0
    member: str = ""
    node: ZenohEndpoints | None = None
    settings: dict[str, Any] = {}
    number: int = 0
    """Messages a second, or connections."""
    size: int = 0
    """Bytes of a message."""
    first: bytes = b""
    """What each connection sends."""


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """What the attacker reports."""

    sent: int = 0
    read: int = 0
    note: str = ""


class Phase(msgspec.Struct, frozen=True, kw_only=True):
    """An attack as the vehicle has lived through it."""

    name: str
    outcome: Outcome
    stalled_s: float
    """Longest time for which its loop published nothing, less the period."""
    bare_s: float
    """The longest time for which a loop that does nothing was late on this computer in the same time."""
    load: float
    """Of the computer, at the end."""
    grown_mb: float
    """Memory of its process: at the end more than at the beginning."""


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """All of it."""

    phases: list[Phase]
    accepted: dict[str, int]
    """Accepted commands, by their author."""
    set_rates: int
    """Functions of intruders that a component has carried out."""
    mission: str
    """Whether the operator's mission was still running at the end: its state."""
    lost: int
    """How often the operator's station has lost the vehicle."""
    open_sockets: list[str]
    refused: list[str]
    """The vehicle's events about connections and messages that came too often."""


# --- the attackers ---


async def speak(attack: Attack) -> Outcome:
    """Opens a link, reads what can be read, and commands under several names."""
    assert attack.node is not None
    loop, topics, read = asyncio.get_running_loop(), TopicTable.installed(), list[str]()
    settings = {**attack.settings, "access_control": {"enabled": False}}
    with open_exchange(attack.node, loop, topics, settings=settings) as exchange:
        speaker = Speaker(exchange, attack.member, Rates(), os.getpid(), signer_of(settings))
        own = {f"pelican/ci/{key}" for key in keys_of(attack.member)}
        exchange.subscribe("**", lambda one: read.append(one.topic))
        end_s = loop.time() + attack.seconds
        while loop.time() < end_s:
            speaker.seize(keys_of(attack.member))
            await asyncio.sleep(0.1)
    foreign = [topic for topic in read if topic not in own and "/function" not in topic and "members/" not in topic]
    return Outcome(sent=len(speaker.rates_hz), read=len(foreign))


def _raw(attack: Attack) -> zenoh.Session:
    assert attack.node is not None
    return new_session(attack.node, {**attack.settings, "access_control": {"enabled": False}})


async def flood(attack: Attack) -> Outcome:
    """Puts short messages on a key, at a rate."""
    loop, sent, data = asyncio.get_running_loop(), 0, os.urandom(300)
    with _raw(attack) as session:
        publisher = session.declare_publisher(f"pelican/ci/ask/{attack.member}")
        await asyncio.sleep(0.5)
        begin_s = loop.time()
        while (elapsed_s := loop.time() - begin_s) < attack.seconds:
            while sent < attack.number * elapsed_s:
                publisher.put(data)
                sent += 1
            await asyncio.sleep(0.005)
    return Outcome(sent=sent, note=f"{sent / attack.seconds:,.0f} a second")


async def huge(attack: Attack) -> Outcome:
    """Puts long messages on a key."""
    loop, data, sent = asyncio.get_running_loop(), bytes(attack.size), 0
    with _raw(attack) as session:
        await asyncio.sleep(0.5)
        end_s = loop.time() + attack.seconds
        while loop.time() < end_s:
            await asyncio.to_thread(session.put, f"pelican/ci/ask/{attack.member}", data)
            sent += 1
            await asyncio.sleep(0.2)
    return Outcome(sent=sent, note=f"{attack.size / 1e6:.0f} MB each")


async def idle(attack: Attack) -> Outcome:
    """Opens TCP connections and sends nothing more than the first bytes."""
    host, _, port = ADDRESS.rpartition(":")
    opened = list[socket.socket]()
    end_s = asyncio.get_running_loop().time() + attack.seconds
    for _ in range(attack.number):
        one = socket.socket()
        one.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            one.connect((host, int(port)))
        opened.append(one)
    await asyncio.sleep(CONNECTED_S)
    for one in opened:
        with contextlib.suppress(OSError):  # it may be closed, or not connected
            one.send(attack.first)
    await asyncio.sleep(max(end_s - asyncio.get_running_loop().time(), 0.0))
    for one in opened:
        one.close()
    return Outcome(sent=len(opened))


async def scout(attack: Attack) -> Outcome:
    """Asks by multicast, as Zenoh does, who is there."""
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "true")
    found: list[str] = []
    scouting = zenoh.scout(what="router|peer|client", config=config)
    await asyncio.sleep(attack.seconds)
    while (hello := scouting.try_recv()) is not None:
        found.append(str(hello))
    scouting.stop()  # type: ignore[no-untyped-call]
    return Outcome(sent=1, read=len(found))


async def replay(attack: Attack) -> Outcome:
    """Sends again, encrypted as it was, what a member has sent."""
    assert attack.node is not None
    line = Tap(ADDRESS)
    node = replace(attack.node, connect=(f"tls/{await line.open()}",))
    settings = {**attack.settings, "access_control": {"enabled": False}}
    loop = asyncio.get_running_loop()
    with open_exchange(node, loop, TopicTable.installed(), settings=settings) as exchange:
        speaker = Speaker(exchange, attack.member, Rates(), os.getpid(), signer_of(settings))
        reply = await speaker.send_request(speaker.command())
    await line.close()
    await line.send_again()
    return Outcome(sent=len(line.kept), note=f"the member's own command: {reply.reason or reply.outcome}")


async def join(attack: Attack) -> Outcome:
    """A member connects; how long until it hears the vehicle."""
    assert attack.node is not None
    loop, read = asyncio.get_running_loop(), list[str]()
    begin_s = loop.time()
    with open_exchange(attack.node, loop, TopicTable.installed(), settings=attack.settings) as exchange:
        exchange.subscribe("pelican/ci/summary", lambda one: read.append(one.topic))
        while not read and loop.time() < begin_s + attack.seconds:
            await asyncio.sleep(0.02)
    return Outcome(read=len(read), note=f"{loop.time() - begin_s:.1f} s" if read else "not at all")


KINDS: Final = {one.__name__: one for one in (speak, flood, huge, idle, scout, replay, join)}


# --- the scene ---


@contextmanager
def spaces() -> Iterator[None]:
    """Three computers on one network: the vehicle, the ground, and a stranger."""
    _clear()
    try:
        run_program("ip", "link", "add", "gloc3-hb", "type", "bridge")
        run_program("ip", "link", "set", "gloc3-hb", "up")
        for space, address in SPACES.items():
            name, wire = f"gloc3-h-{space}", f"gl3-{space[:6]}"
            run_program("ip", "netns", "add", name)
            run_program("ip", "link", "add", wire, "type", "veth", "peer", "name", "wire", "netns", name)
            run_program("ip", "link", "set", wire, "master", "gloc3-hb", "up")
            run_program("ip", "-n", name, "addr", "add", f"{address}/24", "dev", "wire")
            run_program("ip", "-n", name, "link", "set", "wire", "up")
            run_program("ip", "-n", name, "link", "set", "lo", "up")
        yield
    finally:
        _clear()


def _clear() -> None:
    for space in SPACES:
        run_program("ip", "netns", "del", f"gloc3-h-{space}", is_checked=False)
        run_program("ip", "link", "del", f"gl3-{space[:6]}", is_checked=False)
    run_program("ip", "link", "del", "gloc3-hb", is_checked=False)


def inside(space: str) -> tuple[str, ...]:
    """What runs a program on one of the computers."""
    return ("ip", "netns", "exec", f"gloc3-h-{space}")


def made_yard(folder: Path) -> Yard:
    """The network: a vehicle, the one operator who may fly it, and members who turn against it."""
    yard = Yard(folder / "yard", ADDRESS)
    entry = register.NetworkMember(role=MemberRole.OPERATOR, certificate="", until="")
    days = timedelta(days=1)
    for name, now, valid in (
        ("carol", NOW, 30 * days),
        ("mallory", NOW, 30 * days),
        ("dave", NOW, 30 * days),
        ("office", NOW, 30 * days),
        ("erin", NOW, timedelta(hours=-1)),
        ("frank", NOW + 10 * days, 30 * days),
    ):
        register.add(yard.folder, name, entry, now, valid, is_renewed=False)
    (yard.folder / RIGHTS_FILE).write_text("rights: [{member: alice, role: operator, of: [pelican]}]\n")
    register.spread_rights(yard.folder)
    (folder / "hostile.yaml").write_text(MISSION)
    (folder / "pelican.yaml").write_text(
        whole_text("pelican_rtk").replace("platform: pelican_rtk", "platform: pelican")
    )
    return yard


async def attacks_on(yard: Yard, folder: Path, seconds: float = 6.0) -> list[Attack]:
    """Everything that is tried, in this order; `revoked` stands between those of carol."""
    bob, mallory, carol, dave = (yard.membership(name) for name in ("bob", "mallory", "carol", "dave"))

    def insider(name: str, kind: str, one: Any, **fields: Any) -> Attack:
        values = {"space": GROUND, "seconds": seconds, **fields}
        return Attack(name=name, kind=kind, member=one.file.member, node=one.node(), settings=one.settings(), **values)

    return [
        Attack(name="nothing, for comparison", kind="idle", number=0, seconds=seconds),
        *(
            Attack(name=who, kind="speak", member=name, node=node, settings=settings, seconds=seconds)
            for who, name, node, settings in await strangers(yard, folder)
        ),
        Attack(name="scouting by multicast", kind="scout", seconds=seconds),
        insider("an observer puts commands in others' names", "speak", bob),
        insider("an operator without rights puts commands, also in another's name", "speak", mallory),
        insider("a member's encrypted bytes are sent again", "replay", carol),
        insider("a member that was revoked by a pushed list", "speak", carol),
        insider("an observer asks 10,000 times a second", "flood", bob, number=10_000),
        insider("an observer's questions have 200 MB", "huge", bob, size=200_000_000),
        Attack(name="1,500 idle connections", kind="idle", number=1500, seconds=20.0),
        insider("… and a member that connects afterwards", "join", dave, seconds=180.0),
        Attack(name="1,500 connections that begin TLS", kind="idle", number=1500, first=BEGUN, seconds=10.0),
        insider("… and a member that connects after these", "join", dave, seconds=180.0),
    ]


def _rss_mb(process: int) -> float:
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _attack(attack: Attack, folder: Path) -> Outcome:
    """Runs an attack on its computer."""
    file = folder / "attack.json"
    file.write_bytes(msgspec.json.encode(attack))
    running = Program((str(file),), ROOT, inside(attack.space), module="tests.onboard.hostile_network")
    try:
        assert running.end(attack.seconds + 60.0) == 0, running.text
        return msgspec.json.decode(running.lines[-1], type=Outcome)
    finally:
        if running.process.poll() is None:
            running.process.kill()
        running.close()


def _push_revocation(yard: Yard, folder: Path, onboard: Program) -> None:
    register.revoke(yard.folder, "carol", datetime.now(UTC))
    words = ("network", "push", "yard/office/network.yaml")
    with program(*words, folder=folder, before=inside(GROUND)) as push:
        assert push.end() == 0, push.text
    onboard.await_line(lambda line: line.endswith("it revokes carol"))


def fly_and_attack(folder: Path, yard: Yard, attacks: Sequence[Attack]) -> Result:
    """Flies a mission, runs the attacks one after the other, and judges them."""
    spans, outcomes, grown = list[tuple[float, float]](), list[Outcome](), list[float]()
    bares, loads = list[float](), list[float]()
    (cable,) = free_ports(1, socket.SOCK_DGRAM)
    with ExitStack() as stack:
        there = inside(VEHICLE)
        simulated = ("sitl", "--link", f"companion=udpout://127.0.0.1:{cable}")
        stack.enter_context(program(*simulated, folder=folder, before=there))
        own = ("--autopilot", f"udpin://127.0.0.1:{cable}", "--network", "yard/pelican.main/network.yaml")
        onboard = stack.enter_context(
            program("onboard", "pelican.yaml", *own, "--out", "out", folder=folder, before=there)
        )
        onboard.await_line(lambda line: "components; log in" in line)
        flown = ("--mission", "hostile.yaml", "--network", "yard/alice/network.yaml")
        alice = stack.enter_context(program("station", "--headless", *flown, folder=folder, before=inside(GROUND)))
        alice.await_line(lambda line: "stay.wait" in line and "running" in line)
        sockets = [str(one) for one in listening(onboard.process.pid) if one.is_open]
        bare = stack.enter_context(bare_loop())
        for attack in attacks:
            if "revoked" in attack.name:
                _push_revocation(yard, folder, onboard)
            bare.report()
            before_mb, begin_s = _rss_mb(onboard.process.pid), monotonic_s()
            outcomes.append(_attack(attack, folder))
            spans.append((begin_s, monotonic_s()))
            grown.append(_rss_mb(onboard.process.pid) - before_mb)
            bares.append(bare.report().most_s)
            loads.append(os.getloadavg()[0])
        state = "running" if "mission" in alice.text and "failed" not in alice.text else alice.lines[-1]
        lost = alice.text.count("link lost") + alice.text.count(" is heard again")
        alice.interrupt()
        onboard.interrupt()
        assert onboard.end() == 0, onboard.text
    with LogReader(folder / "out" / "log.mcap", TopicTable.installed().types) as reader:
        times = [each.envelope.t_s for each in reader.entries(LOOP_TOPIC)]
        accepted: dict[str, int] = {}
        for command in list_commands(reader):
            if command.outcome == "accepted":
                accepted[command.sender] = accepted.get(command.sender, 0) + 1
        functions = [
            each.envelope.payload.arguments.get("rate_hz")
            for each in reader.entries("components/hold/function")
            if each.envelope.payload.function == "set_rate"
        ]
        refused = [each.envelope.payload.text for each in reader.entries("components/network/event")]
    phases = [
        Phase(
            name=attack.name,
            outcome=outcome,
            stalled_s=stall(times, *span),
            bare_s=bare_s,
            load=load,
            grown_mb=mb,
        )
        for attack, outcome, span, bare_s, load, mb in zip(attacks, outcomes, spans, bares, loads, grown, strict=True)
    ]
    return Result(
        phases=phases,
        accepted=accepted,
        set_rates=len(functions),
        mission=state,
        lost=lost,
        open_sockets=sockets,
        refused=[text for text in refused if text.startswith(("refused", "too_many"))],
    )


def stall(times: Sequence[float], begin_s: float, end_s: float) -> float:
    """The longest gap of what a loop publishes, less its period; infinite where it published next to nothing."""
    inside_span = [time for time in times if begin_s <= time <= end_s]
    gaps = [later - earlier for earlier, later in pairwise(inside_span)]
    return max(max(gaps) - LOOP_S, 0.0) if gaps else float("inf")


def main(file: Path) -> None:
    """Runs one attack, and prints what came of it."""
    attack = msgspec.json.decode(file.read_bytes(), type=Attack)
    outcome = asyncio.run(KINDS[attack.kind](attack))
    sys.stdout.write(msgspec.json.encode(outcome).decode() + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
