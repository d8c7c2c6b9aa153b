"""Heartbeats are sent while the loop turns; who falls silent is noticed."""

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.heartbeat import MOST_PEERS, Heartbeat, MavlinkPeers, PeerChange
from gloc3.mavlink.transport.memory import Conditions

from .pair import STATION, VEHICLE, Pair


def changes(peers: MavlinkPeers) -> list[tuple[str, Address]]:
    return [(event.change, event.peer.address) for event in peers.events()]


def autopilot_heartbeat() -> Heartbeat:
    return Heartbeat(VEHICLE, vehicle_type=2, autopilot=12)


def test_both_ends_see_each_other_and_the_autopilot_is_recognised() -> None:
    pair = Pair()
    heartbeat, peers = autopilot_heartbeat(), MavlinkPeers(STATION)
    heartbeat.system_status = 4
    pair.add([heartbeat], [peers])
    pair.run(2.5)
    assert changes(peers) == [(PeerChange.APPEARED, VEHICLE)]
    assert peers[VEHICLE].is_autopilot
    assert peers[VEHICLE].heartbeat.system_status == 4
    assert peers.autopilot(pair.now_s) is None, "it has not been there alone for long enough"
    pair.run(1.0)
    latched = peers.autopilot(pair.now_s)
    assert latched is not None
    assert latched.address == VEHICLE


def test_a_silent_peer_is_gone_and_may_return() -> None:
    pair = Pair()
    peers = MavlinkPeers(STATION)
    pair.add([autopilot_heartbeat()], [peers])
    pair.run(3.2)
    pair.link.a.conditions = Conditions(loss=1.0)
    pair.run(5.0)
    assert changes(peers) == [(PeerChange.APPEARED, VEHICLE), (PeerChange.LOST, VEHICLE)]
    assert peers.alive == []
    pair.link.a.conditions = Conditions()
    pair.run(1.5)
    assert changes(peers) == [(PeerChange.RETURNED, VEHICLE)]


def test_three_lost_heartbeats_are_not_yet_a_lost_peer() -> None:
    peers = MavlinkPeers(STATION)
    peers.receive(message("HEARTBEAT", autopilot=3), VEHICLE, 0.0)
    peers.tick(4.1)
    assert len(peers.alive) == 1
    next_s = peers.next_tick_s()
    assert next_s is not None
    peers.tick(next_s)
    assert peers.alive == []


def test_a_stuck_loop_sends_no_heartbeat_and_makes_up_for_none() -> None:
    heartbeat = autopilot_heartbeat()
    heartbeat.tick(0.0)
    heartbeat.tick(0.5)
    assert len(heartbeat.outgoing()) == 1
    heartbeat.tick(10.0)
    heartbeat.tick(10.1)
    assert len(heartbeat.outgoing()) == 1
    heartbeat.send_now()
    heartbeat.tick(10.2)
    assert len(heartbeat.outgoing()) == 1


def test_two_autopilots_are_a_choice_for_a_person() -> None:
    peers = MavlinkPeers(STATION)
    for system in (1, 2):
        peers.receive(message("HEARTBEAT", autopilot=3), Address(system, 1), 0.0)
    assert peers.autopilot(4.0) is None
    peers.receive(message("HEARTBEAT", autopilot=8), Address(1, 191), 0.0)
    assert [peer.address for peer in peers.autopilots] == [(1, 1), (2, 1)]


def test_a_restart_is_told_by_the_time_since_boot() -> None:
    peers = MavlinkPeers(STATION)
    peers.receive(message("HEARTBEAT", autopilot=3), VEHICLE, 0.0)
    for boot_ms in (50_000, 49_990, 51_000, 300):
        peers.receive(message("SYSTEM_TIME", time_boot_ms=boot_ms), VEHICLE, 1.0)
    assert changes(peers) == [(PeerChange.APPEARED, VEHICLE), (PeerChange.RESTARTED, VEHICLE)]


def test_a_flood_of_strangers_is_bounded_and_the_gone_make_room() -> None:
    peers = MavlinkPeers(STATION)
    for number in range(1000):
        peers.receive(message("HEARTBEAT"), Address(1 + number % 250, number // 250), 0.0)
    assert len(peers.alive) == MOST_PEERS
    assert peers.refused == 1000 - MOST_PEERS
    peers.tick(10.0)
    peers.receive(message("HEARTBEAT"), Address(251, 1), 11.0)
    assert Address(251, 1) in peers
