"""On real links: without a certificate nothing is read or commanded, and each role does what it may, no more."""

import asyncio
from collections.abc import Mapping
from contextlib import ExitStack
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from tests.common.exchange.middlewares import event, receive, until
from tests.common.network.yard import MEMBERS, NOW, Yard
from zenoh import CongestionControl

from gloc3.exchange import Publisher
from gloc3.exchange.zenoh import ZenohExchange, open_exchange
from gloc3.exchange.zenoh_session import QUIC, new_session
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import ENVELOPE_BYTES, MESSAGE_BYTES, TopicTable
from gloc3.messages.vehicle import Image
from gloc3.messages.watch import Sample
from gloc3.network.access import MemberRole
from gloc3.network.file import Membership
from gloc3.network.register import revoke

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(120)]
SEEN = "pelican/ci/event"
ORDERS = "pelican/ci/request/"


class Scene:
    """The platform's main computer, an operator who shows that the network works, and somebody else."""

    def __init__(self, main: ZenohExchange, alice: ZenohExchange) -> None:
        self.main = main
        self.used, _ = receive(main, f"{ORDERS}*")
        self.requested, _ = receive(main, "pelican/ci/ask/*")
        self.moved, _ = receive(main, "pelican/motion/*")
        self.alice_reads, _ = receive(alice, "*/ci/*")
        self._main = Publisher(main, "pelican", "ci", 1)
        self._alice = Publisher(alice, "pelican", "alice", 1)

    async def play(self, other: ZenohExchange, name: str) -> tuple[list[str], bool]:
        """What another reads, and whether its command comes in, while the operator's messages go both ways."""
        reads, end = receive(other, "*/ci/*")
        sees_tokens, end_tokens = receive(other, "pelican/**")
        speaker = Publisher(other, "pelican", name, 1)
        for texts in (self.used, self.requested, self.moved, self.alice_reads):
            texts.clear()
        rounds = 0
        while rounds < 30 or not (self.alice_reads and "alice" in self.used):
            self._main.publish(SEEN, event("state"), 0.0)
            self._alice.publish(f"{ORDERS}alice", event("alice"), 0.0)
            for topic in (f"{ORDERS}{name}", f"{ORDERS}alice", "pelican/ci/request", "pelican/motion/grant"):
                speaker.publish(topic, event(f"order of {name}"), 0.0)
            speaker.publish(f"pelican/ci/ask/{name}", event(f"question of {name}"), 0.0)
            await asyncio.sleep(0.03)
            rounds += 1
        end()
        end_tokens()
        own = {f"order of {name}", f"question of {name}"}
        read = [text for text in (*reads, *sees_tokens) if text not in own]
        return read, f"order of {name}" in (*self.used, *self.moved)


@pytest.mark.parametrize("over", ["", QUIC], ids=["tls", "quic"])
async def test_an_operator_reads_and_commands_and_an_observer_only_looks_and_asks(over: str, tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard", over=over)
    with yard.open("pelican.main") as main, yard.open("alice") as alice, yard.open("bob") as bob:
        scene = Scene(main, alice)
        read, is_commanding = await scene.play(bob, "bob")
        assert "state" in read
        assert "alice" not in scene.moved
        assert not is_commanding
        assert "question of bob" in scene.requested


async def test_hosts_of_a_platform_share_everything_and_stations_see_no_more_than_their_part(tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard")
    with ExitStack() as stack:
        ends = {name: stack.enter_context(yard.open(name)) for name in MEMBERS}
        alive = {name: watched(exchange) for name, exchange in ends.items()}
        received = {name: receive(exchange, "pelican/odometry/*")[0] for name, exchange in ends.items()}
        ends["pelican.vision"].declare_alive("pelican/components/odometer")
        ends["bob"].declare_alive("pelican/components/pretended")
        vision = Publisher(ends["pelican.vision"], "pelican", "odometer", 1)
        while not (received["pelican.main"] and "pelican/components/odometer" in alive["alice"]):
            vision.publish("pelican/odometry/stereo", event("moved"), 0.0)
            await asyncio.sleep(0.03)
        assert not received["alice"]
        assert not received["bob"]
        assert all("pelican/components/pretended" not in alive[name] for name in MEMBERS if name != "bob")


def note(topics: list[str], envelope: Envelope[Any]) -> None:
    topics.append(envelope.topic)


async def test_pictures_reach_through_memory_only_who_may_read_them_though_all_are_of_one_user(tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard")
    camera, looked_at = "pelican/camera/front", "pelican/watch/large/camera/front"
    picture = Image(camera="front", width=200, height=100, data=bytes(20_000))
    sample = Sample(type="Preview", component="c", boot=1, sequence=1, frame="", rate_hz=1.0, payload=bytes(20_000))
    with ExitStack() as stack:
        ends = {name: stack.enter_context(yard.open(name)) for name in MEMBERS}
        came: dict[str, list[str]] = {name: [] for name in MEMBERS}
        for name, exchange in ends.items():
            for pattern in ("pelican/camera/*", "pelican/watch/**"):
                exchange.subscribe(pattern, partial(note, came[name]))
        vision = Publisher(ends["pelican.vision"], "pelican", "viewer", 1)
        begin_s = asyncio.get_running_loop().time()
        while not (came["pelican.main"].count(camera) > 30 and came["bob"].count(looked_at) > 30):
            vision.publish(camera, picture, 0.0)
            vision.publish(looked_at, sample, 0.0)
            await asyncio.sleep(0.05)
        assert asyncio.get_running_loop().time() > begin_s + 1.0, "so long they come through the links, too"
        assert set(came["bob"]) == set(came["alice"]) == {looked_at}
        assert "memfd:gloc3" in Path("/proc/self/maps").read_text()


def watched(exchange: ZenohExchange) -> set[str]:
    """The tokens of components that a member has ever seen."""
    seen: set[str] = set()
    for pattern in ("**", "*/components/*"):
        exchange.watch(pattern, lambda token, _: seen.add(token))
    return seen


def without_certificate(settings: dict[str, Any]) -> None:
    for key in ("connect_certificate", "connect_private_key"):
        del settings["transport/link/tls"][key]


def unrestricted(settings: dict[str, Any]) -> None:
    settings["access_control"] = {"enabled": False}


@pytest.mark.parametrize(
    ("stranger", "over"),
    [
        ("plain", ""),
        ("without a certificate", ""),
        ("without a certificate", QUIC),
        ("of another authority", ""),
        ("of another authority", QUIC),
        ("expired", ""),
    ],
)
async def test_without_a_certificate_that_counts_nothing_is_read_or_commanded(
    stranger: str, over: str, tmp_path: Path
) -> None:
    yard = Yard(tmp_path / "yard", over=over)
    yard.add("eve", MemberRole.OPERATOR, timedelta(hours=-1) if stranger == "expired" else timedelta(days=1))
    eve = yard.membership("eve", NOW - timedelta(days=1)) if stranger == "expired" else yard.membership("eve")
    node, settings = eve.node(), eve.settings()
    unrestricted(settings)
    if stranger == "plain":
        node, settings = replace(node, connect=(f"tcp/{yard.address}",)), {}
    elif stranger == "without a certificate":
        without_certificate(settings)
    elif stranger == "of another authority":
        other = Yard(tmp_path / "other")
        settings["transport/link/tls"] = tls_of(other.membership("alice"), trusting=eve)
    loop, topics = asyncio.get_running_loop(), TopicTable.installed()
    with (
        yard.open("pelican.main") as main,
        yard.open("alice") as alice,
        open_exchange(node, loop, topics, settings=settings) as stranger_end,
    ):
        assert await Scene(main, alice).play(stranger_end, "eve") == ([], False)


def tls_of(membership: Membership, trusting: Membership) -> Mapping[str, Any]:
    """A member's keys, with the authority of another."""
    authority = trusting.settings()["transport/link/tls"]["root_ca_certificate"]
    return {**membership.settings()["transport/link/tls"], "root_ca_certificate": authority}


async def test_a_revoked_certificate_counts_no_more_and_a_renewed_one_takes_the_place_of_the_old(
    tmp_path: Path,
) -> None:
    yard = Yard(tmp_path / "yard", over=QUIC)  # whose port is free only a moment after its end
    bob = yard.membership("bob")
    yard.add("carol", MemberRole.OPERATOR)
    with yard.open("pelican.main") as main, yard.open("alice") as alice, yard.open("carol") as carol:
        scene = Scene(main, alice)
        read, is_commanding = await scene.play(carol, "carol")
        assert "state" in read
        assert is_commanding
        revoke(yard.folder, "carol", NOW)
        new = yard.membership("pelican.main")
        await main.renew(new.node(), new.settings())
        await until(lambda: main.problems() == {})
        assert await scene.play(carol, "carol") == ([], False)
    (yard.folder / "bob").rename(yard.folder / "old")
    yard.add("bob", MemberRole.OPERATOR, is_renewed=True)
    previous = bob.path.parent.parent / "old" / bob.path.name
    with (
        yard.open("pelican.main") as main,
        yard.open("alice") as alice,
        yard.open("bob", bob._replace(path=previous)) as before,
    ):
        scene = Scene(main, alice)
        assert await scene.play(before, "bob") == ([], False)
        with yard.open("bob") as after:
            read, is_commanding = await scene.play(after, "bob")
            assert "state" in read
            assert is_commanding


async def test_a_link_ends_when_a_certificate_expires(tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard")
    yard.add("dave", MemberRole.OBSERVER, timedelta(seconds=8))
    loop = asyncio.get_running_loop()
    with yard.open("pelican.main") as main, yard.open("alice") as alice, yard.open("dave") as dave:
        scene = Scene(main, alice)
        read, _ = await scene.play(dave, "dave")
        assert "state" in read
        begin_s = loop.time()
        while read and loop.time() - begin_s < 60.0:
            await asyncio.sleep(1.0)
            read, _ = await scene.play(dave, "dave")
        assert not read


async def test_an_observers_long_messages_are_dropped_before_they_are_read(tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard")
    bob = yard.membership("bob")
    settings = bob.settings()
    del settings["low_pass_filter"]
    with yard.open("pelican.main") as main, new_session(bob.node(), settings) as session:
        asked = "pelican/ci/ask/bob"
        main.subscribe("pelican/ci/ask/*", lambda _: None)

        def put(data: bytes) -> None:
            session.put(asked, data, congestion_control=CongestionControl.BLOCK)

        def is_read() -> bool:
            put(b"short")
            return f"damaged {asked}" in main.problems()

        await until(is_read)
        before = main.problems()[f"damaged {asked}"]
        put(bytes(MESSAGE_BYTES + 2 * ENVELOPE_BYTES))
        put(b"short")
        await until(lambda: main.problems()[f"damaged {asked}"] > before)
        assert set(main.problems()) == {f"damaged {asked}"}
