"""The list of revoked members: signed, numbered, kept, passed on from member to member, and limiting once it has ended."""

import asyncio
from collections.abc import Callable
from contextlib import ExitStack, suppress
from datetime import timedelta
from pathlib import Path
from random import Random

import pytest
from tests.common.exchange.middlewares import until
from tests.common.network.test_rights import BODIES, FILE, STATIONS
from tests.common.network.test_rights import Yard as RightsYard
from tests.common.network.test_routers import add, joined_yard
from tests.common.network.yard import LONG, NOW, Yard, free_port

from gloc3.clock import run_virtual
from gloc3.errors import InputError, Refused
from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.base import Exchange
from gloc3.messages.command_interface import AnyBody, Emergency, EmergencyVerb, RequestAction, Steer, Verb
from gloc3.messages.envelope import Revocations
from gloc3.messages.summaries import Health, Summary
from gloc3.messages.topics import TopicTable
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.authority import read_certificate
from gloc3.network.file import Membership
from gloc3.network.revocations import MOST_BYTES, REVOCATIONS, RevocationList, read_list, sign_list, verify_list
from gloc3.network.rights import ITSELF, ListValidity, Rights
from gloc3.network.rights_file import Right
from gloc3.network.spreading import LONGEST_S, RevocationSpreader, push, topic_of
from gloc3_groundstation.links.network_route import NetworkRoute
from gloc3_groundstation.links.station_routes import StationRoutes

DAY = timedelta(days=1)


def of(yard: Yard) -> RevocationList:
    """The list in the network's folder."""
    return read_list(yard.folder / REVOCATIONS, read_certificate(yard.folder / "authority.pem"))


def test_each_list_has_all_that_were_revoked_and_the_next_number(tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard")
    bob = yard.membership("bob").file.own.certificate
    assert (of(yard).number, of(yard).certificates) == (1, frozenset())
    assert of(yard).end_s == pytest.approx(
        read_certificate(yard.folder / "authority.pem").not_valid_after_utc.timestamp()
    )
    register.revoke(yard.folder, "bob", NOW)
    yard.add("bob", MemberRole.OBSERVER)
    register.revoke(yard.folder, "alice", NOW)
    found = of(yard)
    assert (found.number, len(found.certificates)) == (3, 2)
    assert bob in found.certificates
    assert yard.membership("bob").file.own.certificate not in found.certificates, "a member that came back"
    register.confirm(yard.folder, NOW, 7)
    assert (of(yard).number, of(yard).end_s - of(yard).signed_s) == (4, 7 * DAY.total_seconds())
    assert of(yard).certificates == found.certificates


def test_a_network_of_before_there_were_lists_gets_one_with_all_that_were_revoked(tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard")
    bob = yard.membership("bob").file.own.certificate
    register.revoke(yard.folder, "bob", NOW)
    for path in yard.folder.rglob(REVOCATIONS):
        path.unlink()
    yard.add("carol", MemberRole.OPERATOR)
    assert yard.membership("carol").revocations is None
    register.confirm(yard.folder, NOW)
    assert (of(yard).number, of(yard).certificates) == (1, frozenset({bob}))
    assert yard.membership("carol").revocations == of(yard)


def test_a_list_that_the_authority_has_not_signed_is_refused(tmp_path: Path) -> None:
    yard, other = Yard(tmp_path / "yard"), Yard(tmp_path / "other")
    authority, good = read_certificate(yard.folder / "authority.pem"), of(yard).data
    assert verify_list(good, authority).number == 1
    changed = bytearray(good)
    changed[-1] ^= 1
    for data in (of(other).data, bytes(changed), good[:-1], b"", b"x" * 100):
        with pytest.raises(Refused, match="is not signed by this network's authority"):
            verify_list(data, authority)
    with pytest.raises(Refused, match="has 64001 bytes, at most 64000"):
        verify_list(b"x" * (MOST_BYTES + 1), authority)
    with pytest.raises(InputError, match=r"authority\.pem: not a list of revoked certificates"):
        read_list(yard.folder / "authority.pem", authority)


def test_the_list_in_a_members_folder_counts_at_its_start(tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard")
    before = (yard.folder / "pelican.main" / "network.yaml").read_text()
    bob, first = yard.membership("bob"), of(yard)
    register.revoke(yard.folder, "bob", NOW)
    (yard.folder / "pelican.main" / "network.yaml").write_text(before)  # the new list alone was copied
    membership = yard.membership("pelican.main")
    assert "bob" not in membership.file.roles
    assert "bob" not in [one["id"] for one in membership.settings()["access_control"]["subjects"]]
    assert {"alice", "pelican.vision"} < set(membership.file.roles)
    (yard.folder / "pelican.main" / REVOCATIONS).write_bytes((yard.folder / "alice" / REVOCATIONS).read_bytes())
    with pytest.raises(InputError, match=r":4:9: bob is revoked by list 2 of revoked members, signed on 20.* UTC"):
        read_again(bob, of(yard))
    assert read_again(membership, first).revocations == of(yard), "an older one is nothing new"
    (yard.folder / "pelican.main" / REVOCATIONS).unlink()
    with pytest.raises(InputError, match=r"revocations\.pem is not there, so nobody knows who is revoked"):
        yard.membership("pelican.main")


def read_again(membership: Membership, newest: RevocationList) -> Membership:
    from gloc3.network.file import read_network

    return read_network(membership.path, NOW, newest)


class Member:
    """A member's part in spreading, without connections to open again."""

    def __init__(self, name: str, yard: Yard, exchange: Exchange, membership: Membership | None = None) -> None:
        self.adopted: list[tuple[int, bool]] = []
        self.reported: list[str] = []
        loop = asyncio.get_running_loop()
        self.spreader = RevocationSpreader(
            exchange, loop, Random(name), membership or yard.membership(name), self._adopt, self.reported.append
        )

    def _adopt(self, membership: Membership, *, is_anyone_out: bool) -> None:
        assert membership.revocations is not None
        self.adopted.append((membership.revocations.number, is_anyone_out))


def keeping_files(yard: Yard, change: Callable[[], object]) -> None:
    """Changes the network, and not the folders of its members, which are on other computers."""
    kept = {path: path.read_bytes() for path in yard.folder.glob("*/*") if path.is_file()}
    change()
    for path, data in kept.items():
        path.write_bytes(data)


@pytest.mark.sockets
async def test_a_pushed_list_passes_two_routers_and_is_kept_by_every_member(tmp_path: Path) -> None:
    yard = joined_yard(tmp_path / "yard")
    add(yard, "office", MemberRole.OBSERVER, to=["root"])
    with ExitStack() as stack:
        members = {
            name: Member(name, yard, stack.enter_context(yard.open(name)))
            for name in ("root", "coast", "pelican.main", "pelican.vision", "alice")
        }
        keeping_files(yard, lambda: register.revoke(yard.folder, "bob", NOW))
        found = of(yard)
        reached = await push(read_again(yard.membership("office"), found), 15.0)
        assert reached == dict.fromkeys(members, 2)
        for name, member in members.items():
            knows_bob = name != "alice"
            assert member.adopted == [(2, knows_bob)], name
            assert member.spreader.newest == found
            assert member.reported == [f"{found}: it revokes {'bob' if knows_bob else 'nobody who is known here'}"]
        authority = read_certificate(yard.folder / "authority.pem")
        await until(lambda: all(read_list(yard.folder / one / REVOCATIONS, authority) == found for one in members))
        late = Member("bob", yard, stack.enter_context(yard.open("bob")))  # the routers here still let it in
        await until(lambda: late.spreader.number == 2, 5.0)
        assert late.reported == [f"{found}: it revokes bob"]
        for member in (*members.values(), late):
            member.spreader.close()


@pytest.mark.sockets
async def test_forged_and_older_lists_change_nothing_and_an_older_one_is_answered(tmp_path: Path) -> None:
    yard, other = Yard(tmp_path / "yard"), Yard(tmp_path / "other")
    exchange = LocalExchange(TopicTable.installed())
    first = of(yard)
    register.revoke(yard.folder, "bob", NOW)
    member, said = Member("pelican.main", yard, exchange), list[int]()
    exchange.subscribe(topic_of("pelican.main"), lambda one: said.append(one.payload.number))
    register.revoke(other.folder, "bob", NOW)
    register.revoke(other.folder, "alice", NOW)
    stranger = Publisher(exchange, "members", "mallory", 1)
    for number, data in ((3, of(other).data), (9, of(yard).data), (4, b""), (1, first.data)):
        stranger.publish(topic_of("mallory"), Revocations(number=number, data=data), 0.0)
        await asyncio.sleep(0.15)
    assert member.adopted == []
    assert member.spreader.number == 2
    assert member.reported == [
        "a list of revoked members is not signed by this network's authority",
        "a list of revoked members has another number than 9",
        "a list of revoked members is not signed by this network's authority",
    ]
    await until(lambda: bool(said))
    assert set(said) == {2}
    member.spreader.close()


def test_many_members_that_agree_say_little_and_a_newcomer_with_news_is_heard_at_once(tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard")
    names = [f"s{number:02d}" for number in range(20)]
    for name in names:
        yard.add(name, MemberRole.OBSERVER)

    async def gossip() -> tuple[int, float]:
        exchange = LocalExchange(TopicTable.installed())
        said: list[str] = []
        exchange.subscribe(topic_of("*"), lambda one: said.append(one.topic))
        members = [Member(name, yard, exchange) for name in names]
        await asyncio.sleep(4 * LONGEST_S)
        said.clear()
        await asyncio.sleep(10 * LONGEST_S)
        quiet, loop = len(said), asyncio.get_running_loop()
        keeping_files(yard, lambda: register.revoke(yard.folder, "bob", NOW))
        begin_s = loop.time()
        newcomer = Member("alice", yard, exchange, yard.membership("alice").under(of(yard)))
        with suppress(TimeoutError):
            async with asyncio.timeout(LONGEST_S):
                while any(member.spreader.number < 2 for member in members):
                    await asyncio.sleep(0.01)
        spread_s = loop.time() - begin_s
        for member in (*members, newcomer):
            member.spreader.close()
        return quiet, spread_s

    quiet, spread_s = run_virtual(gossip())
    assert quiet <= 10 * 6, "a few messages an interval, of twenty members together"
    assert spread_s <= 1.0


def rights(folder: Path, end_s: float) -> tuple[Rights, Rights]:
    """Of a platform with and without a rights file, whose list ends then."""
    yard = RightsYard(folder, FILE)
    utc_s = yard.utc_s
    validity = ListValidity(7, utc_s + end_s)
    return tuple(Rights("pelican", lambda: utc_s, lambda: 1.0, file, STATIONS, validity) for file in (yard.file, None))  # type: ignore[return-value]


def refusal(some: Rights, member: str, body: AnyBody) -> str:
    """Why a request is refused; empty where it is not."""
    try:
        some.check(member, body)
    except Refused as error:
        return str(error)
    return ""


SAFE = {"look", "control", "hold"}


@pytest.mark.parametrize("member", ["alice", "carol"])
def test_after_the_lists_end_stations_may_only_do_what_is_safe(tmp_path: Path, member: str) -> None:
    more: dict[str, AnyBody] = {
        "land": Emergency(verb=EmergencyVerb.LAND),
        "pause": Steer(verb=Verb.PAUSE),
        "abort": Steer(verb=Verb.ABORT),
        "resume": Steer(verb=Verb.RESUME),
        "land as an action": RequestAction(capability="land"),
        "land in spite of red checks": RequestAction(capability="land", override="it must"),
        "take off": RequestAction(capability="take_off"),
        "start on red": Steer(verb=Verb.START, override="it must"),
    }
    for some in rights(tmp_path, -1.0):
        found = {name: refusal(some, member, body) for name, body in {**BODIES, **more}.items()}
        assert {name for name, text in found.items() if not text} == {
            *SAFE,
            "land",
            "pause",
            "abort",
            "land as an action",
        }
        ended = "list 7 of revoked members has ended on 2026-11-28 11:59 UTC, so that "
        assert all(text.startswith(ended) for text in found.values() if text)
        assert some.may(member, Right.CONTROL), "it keeps control, and the contact that goes with it"
        assert not some.may(member, Right.LOGS)
        assert not some.may_alone(member, {Right.FLY})
        with pytest.raises(Refused, match="has ended"):
            some.check_demand(member)
        for other in (ITSELF, ""):  # the vehicle's own mission goes on; links without a member are as they were
            assert some.may(other, Right.FLY) is (other == ITSELF or some.is_open)
    for some in rights(tmp_path, 1.0):
        some.check(member, Steer(verb=Verb.START))
        some.check_demand(member)


def test_a_radios_key_of_a_member_that_was_revoked_has_no_rights(tmp_path: Path) -> None:
    for some in rights(tmp_path, 1.0):
        some.check("alice", Steer(verb=Verb.START))
        some.adopt(RightsYard(tmp_path).file if not some.is_open else None, ["carol"])
        with pytest.raises(Refused, match="alice is no operator of the network, or was revoked"):
            some.check("alice", Steer(verb=Verb.START))
        assert not some.may("alice", Right.CONTROL)
        assert not some.may_alone("alice", {Right.CONTROL})
        some.check("carol", Steer(verb=Verb.START))
    Rights("pelican").check("alice", Steer(verb=Verb.START))


def test_signing_needs_the_authoritys_key(tmp_path: Path) -> None:
    yard = Yard(tmp_path / "yard")
    (yard.folder / "authority.key").unlink()
    with pytest.raises(InputError, match=r"authority\.key: cannot be read"):
        sign_list(yard.folder, [], NOW)


@pytest.mark.sockets
async def test_a_station_closes_its_connection_to_a_vehicle_that_is_revoked(tmp_path: Path) -> None:
    yard, topics, loop = Yard(tmp_path / "yard"), TopicTable.installed(), asyncio.get_running_loop()
    heron = register.NetworkMember(
        role=MemberRole.PLATFORM, certificate="", until="", listen=[f"127.0.0.1:{free_port()}"]
    )
    register.add(yard.folder, "heron.main", heron, NOW, LONG, is_renewed=False)
    inside, heard, reported = LocalExchange(topics), list[str](), list[str]()
    inside.subscribe("*/ci/summary", lambda one: heard.append(one.topic.partition("/")[0]))
    route = NetworkRoute(yard.membership("alice"), StationRoutes(), reported.append)
    with ExitStack() as stack:
        networks = {name: stack.enter_context(yard.open(f"{name}.main")) for name in ("pelican", "heron")}
        member = Member("pelican.main", yard, networks["pelican"])
        publishers = {name: Publisher(network, name, "ci", 1) for name, network in networks.items()}

        def is_heard(*wanted: str) -> bool:
            for name, publisher in publishers.items():
                publisher.publish(f"{name}/ci/summary", Summary(table=0, health=Health.WORKING, lines=[]), loop.time())
            return set(wanted) <= set(heard)

        route.open(loop, inside, topics)
        stack.callback(route.close)
        await until(lambda: is_heard("pelican", "heron"))
        keeping_files(yard, lambda: register.revoke(yard.folder, "heron.main", NOW))
        member.spreader.renew(yard.membership("pelican.main").under(of(yard)))
        await until(lambda: any("it revokes heron.main" in text for text in reported))
        await asyncio.sleep(2.0)
        heard.clear()
        await until(lambda: is_heard("pelican"))
        assert "heron" not in heard
        member.spreader.close()
