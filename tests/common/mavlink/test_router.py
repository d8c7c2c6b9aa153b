"""The router: who gets a frame, who does not, and what it knows of the links."""

from typing import Any

import pytest

from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.router import (
    FORGOTTEN_AFTER_S,
    LASTING_S,
    MOST_ADDRESSES,
    MOVED_AFTER_S,
    REPEAT_S,
    Router,
    RouterLink,
)

COMPANION = Address(1, 191)
AUTOPILOT, CAMERA, STATION, OTHER_STATION, OTHER_VEHICLE = (
    Encoder(1, 1),
    Encoder(1, 100),
    Encoder(255, 190),
    Encoder(254, 190),
    Encoder(2, 1),
)


class Net:
    """A router with links on which real frames come in and out."""

    def __init__(self, *names: str) -> None:
        self.restarted: list[int] = []
        self.router = Router(COMPANION, self.restarted.append)
        self.out: dict[str, list[Frame]] = {name: [] for name in names}
        self.links: dict[str, RouterLink] = {name: self.router.attach(name, self.out[name].extend) for name in names}
        self.now_s = 0.0

    def receive(self, name: str, raw: bytes) -> dict[str, int]:
        """A frame comes in; by link, how many went out because of it."""
        before = {each: len(frames) for each, frames in self.out.items()}
        self.router.route(self.links[name], Parser(is_datagram=True).receive(raw), self.now_s)
        return {each: more for each, frames in self.out.items() if (more := len(frames) - before[each])}

    def report(self, name: str, who: Encoder, what: str = "HEARTBEAT", **fields: Any) -> dict[str, int]:
        return self.receive(name, who.encode(message(what, **fields)))


@pytest.fixture
def net() -> Net:
    """An autopilot with a camera on a serial line, a station on each of two links."""
    net = Net("serial", "radio", "wifi")
    net.report("serial", AUTOPILOT)
    net.report("serial", CAMERA)
    net.report("radio", STATION)
    net.report("wifi", OTHER_STATION)
    return net


def command(net: Net, name: str, who: Encoder, system: int, component: int) -> dict[str, int]:
    return net.report(name, who, "COMMAND_LONG", target_system=system, target_component=component, command=400)


def test_what_is_for_all_goes_everywhere_but_back(net: Net) -> None:
    assert net.report("serial", AUTOPILOT, "ATTITUDE", roll=0.1) == {"radio": 1, "wifi": 1}
    assert net.report("radio", STATION) == {"serial": 1, "wifi": 1}


def test_what_has_an_address_goes_only_where_it_lives(net: Net) -> None:
    assert command(net, "radio", STATION, 1, 1) == {"serial": 1}
    assert command(net, "radio", STATION, 1, 100) == {"serial": 1}
    assert command(net, "serial", AUTOPILOT, 255, 190) == {"radio": 1}
    assert command(net, "serial", AUTOPILOT, 255, 0) == {"radio": 1}, "all components of a system"
    assert command(net, "radio", STATION, 254, 0) == {"wifi": 1}, "a station to a station"


def test_what_is_for_nobody_known_goes_nowhere_and_is_counted(net: Net) -> None:
    assert command(net, "radio", STATION, 7, 1) == {}
    assert command(net, "radio", STATION, 1, 55) == {}, "the system is known, the component is not"
    assert net.links["radio"].counts.unroutable == 2


def test_what_is_for_this_process_is_not_passed_on(net: Net) -> None:
    assert command(net, "radio", STATION, 1, 191) == {}
    assert command(net, "radio", STATION, 1, 0) == {"serial": 1}, "for all of the vehicle is for the autopilot too"
    assert net.links["radio"].counts.unroutable == 0


def test_further_components_of_this_process_are_treated_alike(net: Net) -> None:
    net.router.add_own(Address(1, 103))
    assert command(net, "radio", STATION, 1, 103) == {}
    assert net.links["radio"].counts.unroutable == 0
    assert net.report("wifi", Encoder(1, 103)) == {}, "our own, come back"
    assert net.links["wifi"].counts.returned == 1


def test_frames_pass_byte_for_byte_signed_unknown_and_old_ones_too(net: Net) -> None:
    unknown = b"\xfd\x03\x00\x00\x09\x01\x01\x39\x30\x00abc\x12\x34"
    known = AUTOPILOT.encode(message("ATTITUDE", pitch=0.2))
    signed = known[:2] + b"\x01" + known[3:-2]
    shape = message("ATTITUDE").shape
    from fastcrc.crc16 import mcrf4xx

    signed += mcrf4xx(shape.crc_extra, mcrf4xx(signed[1:])).to_bytes(2, "little") + bytes(range(13))
    for raw in (unknown, signed):
        net.receive("serial", raw)
        assert net.out["radio"][-1].raw == raw
        assert net.out["wifi"][-1].raw == raw


def test_a_signing_key_is_passed_on_to_nobody(net: Net) -> None:
    setup = {"target_system": 1, "target_component": 1, "secret_key": bytes(range(32)), "initial_timestamp": 1}
    assert net.report("radio", STATION, "SETUP_SIGNING", **setup) == {}
    assert net.links["radio"].counts.refused == 1


def test_a_frame_that_comes_back_by_another_link_goes_nowhere(net: Net) -> None:
    raw = AUTOPILOT.encode(message("ATTITUDE", yaw=1.0))
    assert net.receive("serial", raw) == {"radio": 1, "wifi": 1}
    assert net.receive("wifi", raw) == {}, "two links lead to the same other router"
    assert not net.links["wifi"].has(1, 1), "the autopilot does not live there"
    assert net.receive("serial", raw) == {"radio": 1, "wifi": 1}, "said twice on its own link is said twice"
    net.now_s += 2.1 * REPEAT_S
    net.report("serial", CAMERA)
    net.now_s += 1.1 * REPEAT_S
    net.report("serial", CAMERA)
    assert net.receive("radio", raw) != {}, "the numbers of frames come round again: later it is another one"


def test_our_own_frames_that_come_back_go_nowhere(net: Net) -> None:
    assert net.report("wifi", Encoder(*COMPANION)) == {}
    assert net.links["wifi"].counts.returned == 1


def test_two_routers_in_a_ring_do_not_circle_a_frame() -> None:
    here, there = Net("vehicle", "a", "b"), Net("a", "b", "station")
    circled = 0
    pending = [(here, "vehicle", AUTOPILOT.encode(message("HEARTBEAT")))]
    seen_by_station = 0
    while pending and circled < 100:
        circled += 1
        net, name, raw = pending.pop(0)
        other = there if net is here else here
        for went in net.receive(name, raw):
            if went in ("a", "b"):
                pending.append((other, went, raw))
            seen_by_station += went == "station"
    assert circled < 10
    assert seen_by_station == 1


def test_one_who_is_heard_on_two_links_is_reached_on_both_and_hears_nothing_of_itself(net: Net) -> None:
    net.report("wifi", AUTOPILOT)
    assert command(net, "radio", STATION, 1, 1) == {"serial": 1, "wifi": 1}
    assert net.report("serial", AUTOPILOT, "ATTITUDE") == {"radio": 1}


def test_one_who_has_moved_is_no_longer_sent_to_where_it_was(net: Net) -> None:
    net.now_s = MOVED_AFTER_S + 1.0
    net.report("radio", OTHER_STATION)
    assert command(net, "serial", AUTOPILOT, 254, 190) == {"radio": 1}
    assert net.report("radio", OTHER_STATION) == {"serial": 1, "wifi": 1}


def test_a_restart_forgets_the_routes_of_that_system(net: Net) -> None:
    net.report("serial", AUTOPILOT, "SYSTEM_TIME", time_boot_ms=600_000)
    assert net.links["serial"].has(1, 100)
    net.report("serial", AUTOPILOT, "SYSTEM_TIME", time_boot_ms=599_500)
    assert net.restarted == [], "a frame that was overtaken is no restart"
    net.report("serial", AUTOPILOT, "SYSTEM_TIME", time_boot_ms=1_000)
    assert net.restarted == [1]
    assert not net.links["serial"].has(1, 100), "until it is heard again"
    assert net.links["serial"].has(1, 1)
    assert net.links["radio"].has(255, 190), "others keep theirs"


def test_gaps_in_the_numbers_are_counted_as_lost_frames(net: Net) -> None:
    lost_before = net.links["serial"].counts.lost
    for number in range(300):
        raw = AUTOPILOT.encode(message("ATTITUDE", time_boot_ms=number))
        if number % 10:
            net.receive("serial", raw)
    assert net.links["serial"].counts.lost - lost_before == 30
    assert net.links["serial"].counts.frames_in == 2 + 270


@pytest.mark.thorough
def test_invented_systems_in_the_thousands_fill_no_memory_and_keep_nobody_out(net: Net) -> None:
    for system in range(3, 250):
        for component in range(1, 30):
            net.report("wifi", Encoder(system, component))
    wifi = net.links["wifi"]
    assert len(wifi.senders) == MOST_ADDRESSES
    assert command(net, "wifi", OTHER_STATION, 1, 1) == {"serial": 1}, "who was there before is still served"
    assert command(net, "radio", STATION, 1, 1) == {"serial": 1}
    net.now_s = FORGOTTEN_AFTER_S + 1.0
    assert net.report("wifi", OTHER_VEHICLE) == {"serial": 1, "radio": 1}, "the silent make room"
    assert len(wifi.senders) == 1


def test_a_flood_behind_one_peer_keeps_out_nobody_behind_another(net: Net) -> None:
    wifi, peer = net.links["wifi"], "10.0.0.66"
    wifi.origin = lambda: peer
    for number in range(2 * MOST_ADDRESSES):
        net.report("wifi", Encoder(3 + number // 200, 1 + number % 200))
    assert len(wifi.senders) == MOST_ADDRESSES
    peer = "10.0.0.2"
    assert net.report("wifi", OTHER_VEHICLE) == {"serial": 1, "radio": 1}, "a newcomer behind another peer"
    assert len(wifi.senders) == MOST_ADDRESSES
    assert command(net, "serial", AUTOPILOT, 2, 1) == {"wifi": 1}
    assert command(net, "serial", AUTOPILOT, 254, 190) == {"wifi": 1}, "who was there before"
    peer = "10.0.0.66"
    for number in range(MOST_ADDRESSES):
        net.report("wifi", Encoder(9 + number // 200, 1 + number % 200))
    assert command(net, "serial", AUTOPILOT, 2, 1) == {"wifi": 1}, "the flood does not take its room back"


def test_a_flood_behind_one_radio_keeps_out_no_newcomer_behind_the_same(net: Net) -> None:
    net.report("radio", CAMERA)
    net.now_s = LASTING_S
    for who in (STATION, CAMERA):
        net.report("radio", who)
    for number in range(2 * MOST_ADDRESSES):
        net.report("radio", Encoder(3 + number // 200, 1 + number % 200))
    assert len(net.links["radio"].senders) == MOST_ADDRESSES
    assert net.report("radio", OTHER_VEHICLE) == {"serial": 1, "wifi": 1}
    for number in range(MOST_ADDRESSES // 2):
        net.report("radio", Encoder(9, 1 + number))
    assert command(net, "serial", AUTOPILOT, 2, 1) == {"radio": 1}, "the next ones take the room of the flood"
    net.now_s += LASTING_S
    net.report("radio", OTHER_VEHICLE)
    for number in range(2 * MOST_ADDRESSES):
        net.report("radio", Encoder(13 + number // 200, 1 + number % 200))
    assert command(net, "serial", AUTOPILOT, 2, 1) == {"radio": 1}, "it has come to stay"
    assert command(net, "serial", AUTOPILOT, 255, 190) == {"radio": 1}, "who was there before"


def test_senders_that_keep_sending_keep_their_room(net: Net) -> None:
    invented = [Encoder(3 + number // 200, 1 + number % 200) for number in range(MOST_ADDRESSES)]
    for net.now_s in (0.0, LASTING_S):
        for who in invented:
            net.report("radio", who)
    assert net.report("radio", OTHER_VEHICLE) == {}, "what is left: it needs a signed link"
    assert net.links["radio"].counts.refused > 0


def test_our_autopilot_is_never_learned_from_a_link_to_stations(net: Net) -> None:
    net.links["radio"].is_to_stations = True
    net.report("serial", AUTOPILOT, "SYSTEM_TIME", time_boot_ms=600_000)
    assert net.report("radio", Encoder(1, 1), "SYSTEM_TIME", time_boot_ms=700_000) == {}
    assert net.report("radio", Encoder(1, 1), "SYSTEM_TIME", time_boot_ms=1_000) == {}
    assert net.links["radio"].counts.refused == 2
    assert net.restarted == []
    assert command(net, "wifi", OTHER_STATION, 1, 1) == {"serial": 1}
    assert net.report("serial", AUTOPILOT, "ATTITUDE") == {"radio": 1, "wifi": 1}


def test_a_restart_that_one_link_tells_of_wipes_no_route_of_another(net: Net) -> None:
    for boot_ms in (600_000, 1_000):
        net.report("radio", Encoder(1, 55), "SYSTEM_TIME", time_boot_ms=boot_ms)
    assert net.restarted == [1]
    assert net.links["serial"].has(1, 1)
    assert net.links["serial"].has(1, 100)
