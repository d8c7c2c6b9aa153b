"""The mission protocol, both ends ours: whole plans or none, over links that lose, double and cut."""

import math

import pytest

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.mission_client import CurrentItem, ItemReached, MissionClient, Transfer
from gloc3.mavlink.services.mission_server import MOST_ITEMS, MissionDialect, MissionServer
from gloc3.mavlink.services.mission_transfers import PlanOffered, PlanReceived, SetCurrentRequested
from gloc3.mavlink.services.plan import Plan, PlanItem, PlanResult, PlanType
from gloc3.mavlink.transport.memory import Conditions

from .mission_transfer import plan, transfer
from .pair import STATION, VEHICLE, Pair

pytestmark = pytest.mark.thorough

OTHER_STATION = Address(254, 190)


def wired(
    seed: int = 1, conditions: Conditions | None = None, server: MissionServer | None = None
) -> tuple[Pair, MissionServer, MissionClient]:
    pair = Pair(seed, conditions or Conditions(latency_s=0.02))
    server, client = server or MissionServer(VEHICLE), MissionClient(STATION)
    pair.add([server], [client])
    return pair, server, client


def finish(pair: Pair, wanted: Transfer, for_s: float = 600.0) -> PlanResult | None:
    pair.run(for_s, lambda: wanted.result is not None)
    return wanted.result


def to_vehicle(name: str, **fields: float) -> MavlinkMessage:
    return message(name, target_system=1, target_component=1, **fields)


def names(messages: list[MavlinkMessage]) -> list[str]:
    return [m.name for m in messages]


@pytest.mark.parametrize("seed", range(8))
def test_eight_hundred_items_cross_a_link_that_loses_a_tenth_each_way(seed: int) -> None:
    result = transfer(seed, items=800, loss=0.1)
    assert result.is_good, result
    assert result.upload_s < 120.0


@pytest.mark.parametrize("kind", PlanType)
def test_small_plans_of_each_type_cross_a_very_bad_link(kind: PlanType) -> None:
    for seed in range(10):
        assert transfer(seed, items=3, loss=0.3, kind=kind).is_good
        assert transfer(seed, items=0, loss=0.3, kind=kind).is_good


def test_a_slow_radio_with_doubled_and_overtaking_frames_is_no_harm() -> None:
    radio = Conditions(
        latency_s=0.3, loss=0.05, duplicate=0.05, reorder=0.05, reorder_s=0.4, bandwidth_bit_s=57_600, bits_per_byte=10
    )
    pair, server, client = wired(3, radio)
    sent = plan(3, 60)
    assert finish(pair, client.upload(VEHICLE, sent, now_s=0.0)) is PlanResult.ACCEPTED
    assert server.plans[PlanType.MISSION] == sent
    pair.run(30.0)
    assert finish(pair, download := client.download(VEHICLE, now_s=pair.now_s)) is PlanResult.ACCEPTED
    assert download.items == sent
    assert download.progress == 1.0


def test_each_type_of_plan_is_kept_apart_and_what_waits_has_its_turn() -> None:
    pair, server, client = wired()
    wanted = {kind: plan(kind + 10, 5 + kind) for kind in PlanType}
    transfers = [client.upload(VEHICLE, items, kind=kind, now_s=0.0) for kind, items in wanted.items()]
    assert finish(pair, transfers[-1]) is PlanResult.ACCEPTED
    assert server.plans == wanted
    received = [event for event in server.events() if isinstance(event, PlanReceived)]
    assert [(event.kind, event.items, event.sender) for event in received] == [
        (k, v, STATION) for k, v in wanted.items()
    ]
    assert finish(pair, client.clear(VEHICLE, kind=PlanType.FENCE, now_s=pair.now_s)) is PlanResult.ACCEPTED
    assert server.plans[PlanType.FENCE] == ()
    assert server.plans[PlanType.RALLY] == wanted[PlanType.RALLY]
    assert finish(pair, client.clear(VEHICLE, now_s=pair.now_s)) is PlanResult.ACCEPTED
    assert set(server.plans.values()) == {()}


def test_no_number_survives_the_way() -> None:
    pair, server, client = wired()
    item = PlanItem(command=16, frame=3, param4=math.nan, x=1, y=-1, z=2.5, is_current=True)
    assert finish(pair, client.upload(VEHICLE, [item], now_s=0.0)) is PlanResult.ACCEPTED
    (got,) = server.plans[PlanType.MISSION]
    assert math.isnan(got.param4)
    assert (got.x, got.y, got.z, got.is_current) == (1, -1, 2.5, True)


@pytest.mark.parametrize("after_items", [0, 1, 20])
def test_a_dead_vehicle_is_noticed_within_ten_seconds(after_items: int) -> None:
    pair, server, client = wired(conditions=Conditions(latency_s=0.02, loss=0.05))
    upload = client.upload(VEHICLE, plan(1, 40), now_s=0.0)
    pair.run(60.0, lambda: upload.progress * 41 >= after_items)
    died_s = pair.now_s
    pair.link.set_conditions(Conditions(loss=1.0))
    assert finish(pair, upload) is PlanResult.NO_ANSWER
    assert pair.now_s - died_s <= 10.0
    download = client.download(VEHICLE, now_s=pair.now_s)
    died_s = pair.now_s
    assert finish(pair, download) is PlanResult.NO_ANSWER
    assert pair.now_s - died_s <= 10.0
    assert server.plans[PlanType.MISSION] == ()


def test_a_dead_station_leaves_the_old_plan_and_makes_room_for_another_within_ten_seconds() -> None:
    pair, server, client = wired()
    previous = plan(1, 5)
    server.set_plan(PlanType.MISSION, previous)
    client.upload(VEHICLE, plan(2, 500), now_s=0.0)
    pair.run(5.0)
    pair.link.set_conditions(Conditions(loss=1.0))
    server.receive(to_vehicle("MISSION_COUNT", count=1), OTHER_STATION, pair.now_s)
    assert server.outgoing()[-1].type == PlanResult.DENIED
    pair.run(9.5)
    assert server.plans[PlanType.MISSION] == previous
    server.receive(to_vehicle("MISSION_COUNT", count=1), OTHER_STATION, pair.now_s)
    assert server.outgoing()[-1].name == "MISSION_REQUEST_INT"


def test_a_restarted_vehicle_gets_the_plan_from_the_beginning() -> None:
    pair, server, client = wired()
    upload = client.upload(VEHICLE, sent := plan(1, 60), now_s=0.0)
    pair.run(1.0)
    server._uploads.clear()  # all that a restart forgets
    assert finish(pair, upload) is PlanResult.ACCEPTED
    assert server.plans[PlanType.MISSION] == sent


def test_a_plan_that_is_refused_leaves_the_old_one() -> None:
    def check(kind: PlanType, items: Plan) -> PlanResult:
        return PlanResult.INVALID_PARAM7_Z if any(item.z > 100 for item in items) else PlanResult.ACCEPTED

    pair, server, client = wired(conditions=Conditions(loss=0.1), server=MissionServer(VEHICLE, check=check))
    good = [PlanItem(command=16, z=50.0)] * 3
    assert finish(pair, client.upload(VEHICLE, good, now_s=0.0)) is PlanResult.ACCEPTED
    bad = [*good, PlanItem(command=16, z=200.0)]
    assert finish(pair, client.upload(VEHICLE, bad, now_s=pair.now_s)) is PlanResult.INVALID_PARAM7_Z
    assert server.plans[PlanType.MISSION] == tuple(good)


def test_cancelling_leaves_the_old_plan_and_frees_the_vehicle() -> None:
    pair, server, client = wired()
    first, second = (client.upload(VEHICLE, plan(seed, 50), now_s=0.0) for seed in (1, 2))
    pair.run(0.5)
    client.cancel(second, pair.now_s)
    client.cancel(first, pair.now_s)
    assert (first.result, second.result) == (PlanResult.CANCELLED, PlanResult.CANCELLED)
    pair.run(0.5)
    assert server.plans[PlanType.MISSION] == ()
    assert finish(pair, client.upload(VEHICLE, plan(3, 5), now_s=pair.now_s)) is PlanResult.ACCEPTED


def test_what_a_server_cannot_take_is_refused_with_the_reason() -> None:
    server = MissionServer(VEHICLE, kinds=[PlanType.MISSION])
    for name, fields, expected in [
        ("MISSION_COUNT", {"count": MOST_ITEMS + 1}, PlanResult.NO_SPACE),
        ("MISSION_COUNT", {"count": 2, "mission_type": 1}, PlanResult.UNSUPPORTED),
        ("MISSION_REQUEST_LIST", {"mission_type": 7}, PlanResult.UNSUPPORTED),
        ("MISSION_WRITE_PARTIAL_LIST", {}, PlanResult.UNSUPPORTED),
    ]:
        server.receive(to_vehicle(name, **fields), STATION, 0.0)
        (answer,) = server.outgoing()
        assert (answer.name, answer.type) == ("MISSION_ACK", expected)
    assert all(result.words for result in PlanResult)
    assert PlanResult.read(99) is PlanResult.OTHER


def test_the_old_requests_and_items_are_still_understood() -> None:
    server = MissionServer(VEHICLE, dialect=MissionDialect(tells_current=False))
    server.receive(to_vehicle("MISSION_COUNT", count=2), STATION, 0.0)
    for number, frame, x in ((0, 3, 47.5), (1, 1, 12.25)):
        previous = to_vehicle("MISSION_ITEM", seq=number, frame=frame, command=16, x=x, y=8.0, z=5.0)
        server.receive(previous, STATION, 0.1)
    items = server.plans[PlanType.MISSION]
    assert [item.x for item in items] == [475_000_000, 122_500]
    assert names(server.outgoing()) == ["MISSION_REQUEST_INT", "MISSION_REQUEST_INT", "MISSION_ACK"]
    server.receive(to_vehicle("MISSION_REQUEST_LIST"), STATION, 1.0)
    server.outgoing()
    for _ in range(3):
        server.receive(to_vehicle("MISSION_REQUEST", seq=0), STATION, 1.0)
    server.receive(to_vehicle("MISSION_REQUEST", seq=1), STATION, 1.0)
    answers = server.outgoing()
    assert names(answers) == ["MISSION_ITEM_INT", "MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_ITEM"]
    assert answers[2].x == 47.5
    server.receive(to_vehicle("MISSION_REQUEST_INT", seq=2), STATION, 1.0)
    assert server.outgoing()[0].type == PlanResult.INVALID_SEQUENCE


def test_absurd_coordinates_of_the_old_items_do_no_harm() -> None:
    server = MissionServer(VEHICLE, dialect=MissionDialect(tells_current=False))
    for x in (1e38, -1e38, math.nan, math.inf):
        server.receive(to_vehicle("MISSION_COUNT", count=1), STATION, 0.0)
        server.receive(to_vehicle("MISSION_ITEM", command=16, x=x, frame=3), STATION, 0.1)
        (item,) = server.plans[PlanType.MISSION]
        again = item.message(0, 0, STATION)
        assert again.shape.encode(again)


def test_a_plan_that_changes_while_it_is_read_is_read_as_it_was() -> None:
    pair, server, client = wired()
    server.set_plan(PlanType.MISSION, before := plan(1, 30))
    download = client.download(VEHICLE, now_s=0.0)
    pair.run(0.5)
    server.set_plan(PlanType.MISSION, plan(2, 3))
    assert finish(pair, download) is PlanResult.ACCEPTED
    assert download.items == before


def test_requests_of_an_earlier_transfer_are_not_answered() -> None:
    client = MissionClient(STATION)
    upload = client.upload(VEHICLE, plan(1, 10), now_s=0.0)
    client.outgoing()
    client.receive(message("MISSION_REQUEST_INT", seq=4, target_system=255, target_component=190), VEHICLE, 0.1)
    client.receive(message("MISSION_ACK", target_system=255, target_component=190), VEHICLE, 0.1)
    client.receive(message("MISSION_REQUEST_INT", seq=0, mission_type=1, target_system=255), VEHICLE, 0.1)
    assert client.outgoing() == []
    assert upload.result is None
    client.receive(message("MISSION_ACK", type=4, target_system=255, target_component=190), VEHICLE, 0.2)
    assert upload.result is PlanResult.NO_SPACE


def test_the_end_of_an_upload_is_not_told_to_another_one() -> None:
    server = MissionServer(VEHICLE, dialect=MissionDialect(tells_current=False))
    first, second = (PlanItem(command=16, z=z, param1=math.nan) for z in (1.0, 2.0))
    server.receive(to_vehicle("MISSION_COUNT", count=1), STATION, 0.0)
    server.receive(first.message(0, 0, VEHICLE), STATION, 0.1)
    server.outgoing()
    server.receive(first.message(0, 0, VEHICLE), STATION, 0.5)
    assert names(server.outgoing()) == ["MISSION_ACK"]
    server.receive(second.message(0, 0, VEHICLE), STATION, 0.6)
    assert server.outgoing() == []


def test_a_peer_that_never_comes_to_an_end_is_given_up() -> None:
    client = MissionClient(STATION)
    upload = client.upload(VEHICLE, plan(1, 10), now_s=0.0)
    for step in range(1000):
        client.receive(message("MISSION_REQUEST_INT", target_system=255, target_component=190), VEHICLE, step * 0.1)
    assert upload.result is PlanResult.TOO_MANY_LOSSES


def test_the_current_item_is_told_set_and_reached() -> None:
    pair, server, client = wired(conditions=Conditions(loss=0.1, latency_s=0.02))
    server.set_plan(PlanType.MISSION, plan(1, 5))

    def after(now_s: float) -> None:
        for event in server.events():
            if isinstance(event, SetCurrentRequested):
                server.set_current(event.number)

    pair.vehicle.after = after
    assert finish(pair, client.set_current(VEHICLE, 3, now_s=0.0)) is PlanResult.ACCEPTED
    assert (server.current, client.current[VEHICLE]) == (3, 3)
    pair.link.set_conditions(Conditions())
    assert finish(pair, client.set_current(VEHICLE, 9, now_s=pair.now_s)) is PlanResult.DENIED
    client.events()
    server.reached(3)
    server.set_current(4)
    pair.run(0.5)
    assert client.events() == [ItemReached(VEHICLE, 3), CurrentItem(VEHICLE, 4)]


def test_who_is_not_served_is_not_answered() -> None:
    server = MissionServer(
        VEHICLE, serves=lambda sender: sender == STATION, dialect=MissionDialect(tells_current=False)
    )
    server.receive(to_vehicle("MISSION_COUNT", count=3), OTHER_STATION, 0.0)
    server.receive(message("MISSION_COUNT", count=3, target_system=7), STATION, 0.0)
    assert server.outgoing() == []
    assert server.next_tick_s() is None


def offering() -> tuple[Pair, MissionServer, MissionClient]:
    return wired(server=MissionServer(VEHICLE, check=lambda kind, items: None, dialect=MissionDialect(tells_ids=True)))


def offers(server: MissionServer) -> list[PlanOffered]:
    return [event for event in server.events() if isinstance(event, PlanOffered)]


def test_a_plan_that_is_left_to_the_owner_is_in_force_when_he_says_so() -> None:
    pair, server, client = offering()
    sent = plan(5, 8)
    uploading = client.upload(VEHICLE, sent, now_s=0.0)
    pair.run(1.0)
    (offered,) = offers(server)
    assert (offered.kind, offered.items, offered.sender, uploading.result) == (PlanType.MISSION, sent, STATION, None)
    assert server.plans[PlanType.MISSION] == ()
    server.conclude(offered, PlanResult.ACCEPTED, pair.now_s)
    server.conclude(offered, PlanResult.DENIED, pair.now_s)
    assert finish(pair, uploading) is PlanResult.ACCEPTED
    assert server.plans[PlanType.MISSION] == sent


def test_a_plan_that_its_owner_refuses_leaves_the_old_one() -> None:
    pair, server, client = offering()
    server.set_plan(PlanType.MISSION, previous := plan(1, 3))
    uploading = client.upload(VEHICLE, plan(5, 8), now_s=0.0)
    pair.run(15.0)
    assert uploading.result is None, "the client goes on waiting, since it is asked for its last item again"
    server.conclude(offers(server)[0], PlanResult.INVALID_PARAM1, pair.now_s)
    assert finish(pair, uploading) is PlanResult.INVALID_PARAM1
    assert server.plans[PlanType.MISSION] == previous


def test_while_the_owner_decides_others_are_denied_and_who_begins_anew_is_heard() -> None:
    server = MissionServer(VEHICLE, check=lambda kind, items: None)
    server.receive(to_vehicle("MISSION_COUNT", count=0), STATION, 0.0)
    (first,) = offers(server)
    for hostile in ("MISSION_COUNT", "MISSION_CLEAR_ALL"):
        server.receive(to_vehicle(hostile), OTHER_STATION, 0.1)
    assert [reported.type for reported in server.outgoing()] == [PlanResult.DENIED] * 2
    server.receive(to_vehicle("MISSION_COUNT", count=0), STATION, 0.2)
    (second,) = offers(server)
    server.conclude(first, PlanResult.DENIED, 0.3)
    assert server.outgoing() == []
    server.conclude(second, PlanResult.ACCEPTED, 0.4)
    assert [reported.type for reported in server.outgoing()] == [PlanResult.ACCEPTED]
    server.receive(to_vehicle("MISSION_COUNT", count=0), STATION, 0.5)
    server.receive(to_vehicle("MISSION_ACK", type=PlanResult.CANCELLED), STATION, 0.6)
    server.conclude(offers(server)[0], PlanResult.ACCEPTED, 0.7)
    assert server.outgoing() == [], "cancelled by its sender"


def test_all_plans_are_cleared_with_one_answer_that_tells_the_worst() -> None:
    server = MissionServer(
        VEHICLE, check=lambda kind, items: None if kind is not PlanType.RALLY else PlanResult.ACCEPTED
    )
    for _ in range(2):  # asked again while it is being decided
        server.receive(to_vehicle("MISSION_CLEAR_ALL", mission_type=255), STATION, 0.0)
    offered = offers(server)
    assert [one.kind for one in offered] == [PlanType.MISSION, PlanType.FENCE]
    server.conclude(offered[0], PlanResult.DENIED, 0.1)
    assert server.outgoing() == []
    server.conclude(offered[1], PlanResult.ACCEPTED, 0.2)
    (answer,) = server.outgoing()
    assert (answer.type, answer.mission_type) == (PlanResult.DENIED, 255)


def test_a_plan_has_an_id_that_changes_with_it() -> None:
    server = MissionServer(VEHICLE, dialect=MissionDialect(tells_ids=True))
    ids = []
    for items in ((), plan(1, 3), plan(1, 3), plan(2, 3)):
        server.set_plan(PlanType.MISSION, items)
        server.receive(to_vehicle("MISSION_REQUEST_LIST"), STATION, 0.0)
        (count,) = server.outgoing()
        assert count.opaque_id == server.current_message().mission_id
        ids.append(count.opaque_id)
    assert ids[0] == 0
    assert ids[1] == ids[2] != ids[3]
    assert 0 not in ids[1:]
