"""Each role tries each kind of request at a real onboard process in flight, over two router processes.

The stations are our own clients, on links of their own certificates. A request counts as permitted if it is accepted, or
is refused for another reason than the right to it.
"""

import asyncio
import socket
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import msgspec
from tests.commands.programs import program
from tests.common.network.yard import LONG, NOW, Yard

from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import (
    AnyBody,
    CallFunction,
    CiReply,
    Control,
    ControlVerb,
    CutLog,
    Emergency,
    EmergencyVerb,
    Hello,
    LoadMission,
    Outcome,
    RequestAction,
    Steer,
    Verb,
)
from gloc3.messages.topics import TopicTable
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.rights_file import RIGHTS_FILE
from gloc3.network.stations import join_platforms
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_sitl.demo.demo import free_ports

PLATFORM: Final = "pelican"
ROLES: Final = {
    "alice": "operator",
    "erin": "operator, only to land",
    "carol": "commander",
    "mike": "maintainer",
    "dora": "no role",
    "bob": "observer of the network",
}
RIGHTS: Final = """\
rights:
  - {member: carol, role: commander, of: [all]}
  - {member: alice, role: operator, of: [pelican]}
  - {member: erin, role: operator, of: [pelican], may: [land]}
  - {member: mike, role: maintainer, of: [pelican]}
"""
FENCE: Final = "geofence: {polygon_m: [[-5, -5], [20, -5], [20, 12], [-5, 12]], ceiling_m: 8}\n"
MISSION: Final = "mission: m\nframe: hold\nFENCEtasks: {t: {actions: {a: {ACTION: {ARGUMENTS}}}}}\n"
NO_RIGHT: Final = ("needs the role", "may not use", "may look and not command")
WITHIN_S: Final = 30.0
ANSWER_S: Final = 3.0
"""What has no answer by then was not forwarded: an observer's commands end at the first router."""


def mission(action: str, arguments: str = "", fence: str = FENCE) -> LoadMission:
    """One action as a mission."""
    text = MISSION.replace("FENCE", fence).replace("ACTION", action).replace("ARGUMENTS", arguments)
    return LoadMission(name="m.yaml", text=text)


GO: Final = "position_m: [1, 0, 1.5]"
WHAT: Final[dict[str, AnyBody]] = {
    "look": Hello(),
    "hold control": Control(verb=ControlVerb.REQUEST),
    "load a mission that flies somewhere": mission("go_to", GO),
    "load a mission that lands": mission("land"),
    "load a mission without a geofence": mission("land", fence=""),
    "emergency hold": Emergency(verb=EmergencyVerb.HOLD),
    "disarm in flight (not confirmed)": Emergency(verb=EmergencyVerb.DISARM),
    "change a component's rate": CallFunction(component="height", function="set_rate", arguments={"rate_hz": 20.0}),
    "end the log": CutLog(),
    "take over": Control(verb=ControlVerb.TAKE_OVER),
    "give a role": Control(verb=ControlVerb.APPOINT, station="dora", role="observer", for_s=60.0),
    "take a role back": Control(verb=ControlVerb.DISMISS, station="dora"),
}
"""In this order: what is behind `hold control` is asked for in control where that was given."""


class Cell(msgspec.Struct):
    """One member's request, and the answer."""

    member: str
    what: str
    is_permitted: bool
    answer: str


class Member:
    """A station as our own program has it, without its screens."""

    def __init__(self, name: str, yard: Yard, stack: ExitStack) -> None:
        topics, loop = TopicTable.installed(), asyncio.get_running_loop()
        exchange = LocalExchange(topics)
        network = stack.enter_context(yard.open(name))
        stack.callback(
            join_platforms(network, exchange, topics, name, signer=yard.membership(name).signer(), unsent=sys.exit)
        )
        self.name, self._client = name, CommandClient(exchange, loop, name, 7)
        stack.callback(self._client.close)
        self._summaries: list[object] = []
        exchange.subscribe(f"{PLATFORM}/ci/summary", self._summaries.append)

    async def hear(self) -> None:
        """Waits for the vehicle."""
        async with asyncio.timeout(WITHIN_S):
            while len(self._summaries) < 2:
                await asyncio.sleep(0.1)

    async def request(self, body: AnyBody) -> CiReply:
        return await self._client.request(PLATFORM, body, ANSWER_S)

    async def tries(self, what: str) -> Cell:
        reply = await self.request(WHAT[what])
        is_refused = reply.outcome is Outcome.REFUSED and not any(text in reply.reason for text in NO_RIGHT)
        is_permitted = reply.outcome is Outcome.ACCEPTED or is_refused
        return Cell(self.name, what, is_permitted, reply.reason or str(reply.outcome))


def entry(role: MemberRole, listen: str = "", to: str = "") -> register.NetworkMember:
    addresses, targets = [listen] if listen else [], [to] if to else []
    return register.NetworkMember(role=role, certificate="", until="", listen=addresses, to=targets)


def network(folder: Path) -> Yard:
    """A platform at the router root, and members at the router coast below it."""
    yard = Yard(folder / "yard")
    root, coast = (f"127.0.0.1:{port}" for port in free_ports(2, socket.SOCK_STREAM))
    roles = {name: MemberRole.OBSERVER if name == "bob" else MemberRole.OPERATOR for name in ROLES}
    members = {
        "root": entry(MemberRole.ROUTER, listen=root),
        "coast": entry(MemberRole.ROUTER, listen=coast),
        **{name: entry(role, to="coast") for name, role in roles.items()},
    }
    for name, member in members.items():
        register.add(yard.folder, name, member, NOW, LONG, is_renewed=True)
    (yard.folder / RIGHTS_FILE).write_text(RIGHTS)
    register.spread_rights(yard.folder)
    return yard


async def fly(commander: Member) -> None:
    """The commander has it take off."""
    assert (await commander.request(Control(verb=ControlVerb.TAKE_OVER))).outcome is Outcome.ACCEPTED
    up = RequestAction(capability="take_off", arguments={"height_m": 1.5})
    async with asyncio.timeout(WITHIN_S):
        while (await commander.request(up)).outcome is not Outcome.ACCEPTED:
            await asyncio.sleep(1.0)  # its pre-flight checks are not green yet
    await asyncio.sleep(6.0)


async def land(commander: Member) -> None:
    """And land again."""
    await commander.request(Control(verb=ControlVerb.TAKE_OVER))
    await commander.request(mission("land"))
    assert (await commander.request(Steer(verb=Verb.START))).outcome is Outcome.ACCEPTED
    await asyncio.sleep(6.0)


async def run(folder: Path) -> list[Cell]:
    """All members, all requests."""
    yard, found = network(folder), list[Cell]()
    (cable,) = free_ports(1, socket.SOCK_DGRAM)
    with ExitStack() as stack:
        routers = [
            stack.enter_context(program("network", "router", f"yard/{name}/network.yaml", folder=folder))
            for name in ("root", "coast")
        ]
        stack.enter_context(program("sitl", "--link", f"companion=udpout://127.0.0.1:{cable}", folder=folder))
        words = (
            "--autopilot",
            f"udpin://127.0.0.1:{cable}",
            "--out",
            "out",
            "--network",
            "yard/pelican.main/network.yaml",
        )
        onboard = stack.enter_context(program("onboard", "pelican_rtk", *words, folder=folder))
        await asyncio.to_thread(onboard.await_line, lambda line: "components; log in" in line)
        members = {name: Member(name, yard, stack) for name in ROLES}
        for member in members.values():
            await member.hear()
        await fly(members["carol"])
        await members["carol"].request(Control(verb=ControlVerb.RELEASE))
        for member in members.values():
            for what in WHAT:
                found.append(await member.tries(what))
            await member.request(Control(verb=ControlVerb.RELEASE))
        await land(members["carol"])
        for process in (onboard, *routers):
            process.interrupt()
            assert await asyncio.to_thread(process.end) == 0, process.text
    return found
