"""Forwarding to another station: one way or both, without loops, over memory and over real sockets."""

import asyncio
import socket
from typing import Any

import pytest
from pymavlink import mavutil
from tests.groundstation.services.test_services_with_sitl import simulated, until

from gloc3.errors import Refused
from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3.mavlink.message import Address
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.cli.station import app
from gloc3_groundstation.links.forwarding import REPEAT_S, Forwarding, ForwardLink, RecentFrames, Senders, check_forward
from gloc3_groundstation.store.configuration import ConfigurationFile

OWN, OTHER, VEHICLE, TWIN = Address(255, 190), Address(254, 190), Address(1, 1), Address(2, 1)


class Line:
    """A link of vehicles."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def forward(self, raw: bytes) -> None:
        self.sent.append(raw)


class Away:
    """An endpoint of a link to another station."""

    url = "udpout://there:14550"

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def send(self, data: bytes) -> None:
        self.sent.append(data)


class Rig:
    def __init__(self, *, is_both: bool = False) -> None:
        self.lines = [Line(), Line()]
        self.reported: list[str] = []
        self.forwarding = Forwarding(OWN, lambda: list(self.lines), self.reported.append)
        self.link, self.away = ForwardLink(is_both=is_both), Away()
        self.link.endpoint = self.away  # type: ignore[assignment] # the part that is used
        self.forwarding.links.append(self.link)
        self.encoders = {one: Encoder(*one) for one in (OWN, OTHER, VEHICLE, TWIN)}
        self.now_s = 100.0

    def raw(self, sender: Address, name: str = "HEARTBEAT", **fields: Any) -> bytes:
        return self.encoders[sender].encode(message(name, **fields))

    def heard(self, raw: bytes, line: int = 0) -> None:
        for frame in Parser().receive(raw):
            self.forwarding.from_vehicle(self.lines[line], frame, self.now_s)

    def comes(self, raw: bytes) -> None:
        self.forwarding.from_station(self.link, raw, self.now_s)


def command(target: Address) -> dict[str, Any]:
    return {"target_system": target.system, "target_component": target.component, "command": 400}


def test_frames_of_vehicles_go_out_as_they_came_and_commands_do_not_come_in() -> None:
    rig = Rig()
    frames = [rig.raw(VEHICLE), rig.raw(VEHICLE, "ATTITUDE", roll=1.0), rig.raw(TWIN)]
    for raw in frames:
        rig.heard(raw)
    rig.heard(rig.raw(OWN))
    rig.heard(rig.raw(VEHICLE, "SETUP_SIGNING"))
    assert rig.away.sent == frames
    rig.comes(rig.raw(OTHER))
    rig.comes(rig.raw(OTHER, "COMMAND_LONG", **command(VEHICLE)))
    rig.comes(rig.raw(OTHER, "COMMAND_LONG", **command(VEHICLE)))
    assert [line.sent for line in rig.lines] == [[], []]
    assert rig.link.withheld == 3
    assert rig.link.describe() == "to a station, one way, 3 frames withheld"
    [text] = rig.reported
    assert text.startswith("254/190 behind udpout://there:14550 sends commands, which are not passed to the vehicles")


def test_both_ways_a_command_goes_to_its_vehicle_alone_and_the_answer_to_its_station() -> None:
    rig = Rig(is_both=True)
    rig.heard(rig.raw(VEHICLE), line=0)
    rig.heard(rig.raw(TWIN), line=1)
    beat, order, lost, key = (
        rig.raw(OTHER),
        rig.raw(OTHER, "COMMAND_LONG", **command(TWIN)),
        rig.raw(OTHER, "COMMAND_LONG", **command(Address(9, 1))),
        rig.raw(OTHER, "SETUP_SIGNING", target_system=2),
    )
    for raw in (beat, order, lost, key, rig.raw(OTHER, "COMMAND_LONG", **command(OWN))):
        rig.comes(raw)
    assert [line.sent for line in rig.lines] == [[beat], [beat, order]]
    rig.away.sent.clear()
    theirs = rig.raw(TWIN, "COMMAND_ACK", command=400, target_system=OTHER.system, target_component=OTHER.component)
    ours = rig.raw(TWIN, "COMMAND_ACK", command=400, target_system=OWN.system, target_component=OWN.component)
    someone = rig.raw(TWIN, "COMMAND_ACK", command=400, target_system=77)
    for raw in (theirs, ours, someone):
        rig.heard(raw, line=1)
    assert rig.away.sent == [theirs]


def test_what_comes_back_is_not_sent_again() -> None:
    rig = Rig(is_both=True)
    raw = rig.raw(VEHICLE)
    rig.heard(raw)
    rig.heard(raw, line=1)  # another station forwards it back to one of our links
    rig.comes(raw)  # or by the same link
    rig.comes(rig.raw(OWN))
    beat = rig.raw(OTHER)
    rig.comes(beat)
    rig.heard(beat, line=1)  # the vehicle's router passes it on to us
    assert rig.away.sent == [raw]
    assert [line.sent for line in rig.lines] == [[beat], [beat]]
    assert rig.forwarding.looped == 4
    second, away = ForwardLink(is_both=False), Away()
    second.endpoint = away  # type: ignore[assignment] # the part that is used
    rig.forwarding.links.append(second)
    rig.heard(rig.raw(OTHER), line=1)
    assert len(away.sent) == 1, "a third station gets it"
    rig.now_s += REPEAT_S + 0.1
    rig.heard(raw)
    assert rig.away.sent == [raw, raw], "after so long it is another one"


def test_what_is_remembered_is_bounded() -> None:
    recent, senders = RecentFrames(), Senders[int]()
    for number in range(45_000):
        assert recent.is_new(number.to_bytes(4, "big"), 1.0)
        senders.receive(Address(number % 255, number // 255 % 255), 0, 1.0)
    assert len(recent._now) + len(recent._before) <= 40_000
    assert len(senders._known) <= 256
    senders.receive(Address(0, 0), 0, 60.0)
    senders.receive(OTHER, 0, 100.0)
    assert senders.has(OTHER, 100.0), "lost ones make room"
    assert senders.has(Address(0, 0), 100.0), "those that are received do not"


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("serial:///dev/ttyUSB0:57600", "over a network"),
        ("udpout://there:14550?rate=57600", "over a network"),
        ("udpout://there:14550?key=x", "omit ?key="),
        ("there:14550", "has no scheme"),
    ],
)
def test_a_link_that_cannot_be_forwarded_to_is_refused(url: str, reason: str) -> None:
    with pytest.raises(Refused, match=reason.replace("?", r"\?")):
        check_forward(url)
    with pytest.raises(Refused):
        app(["--headless", "--forward", url], exit_on_error=False, print_error=False)


def test_the_configuration_file_names_them(tmp_path: Any) -> None:
    file = tmp_path / "station.toml"
    file.write_text('forward = ["udpout://a:1"]\nforward_both = ["udpout://b:2"]\n')
    found = ConfigurationFile(file).read()
    assert (found.forward, found.forward_both) == (("udpout://a:1",), ("udpout://b:2",))


# --- with real peers ---


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.sockets
@pytest.mark.flight
async def test_a_second_station_sees_the_vehicle_and_commands_it_only_both_ways() -> None:
    there = free_port()
    first, second = GroundStation(StationSetup(boot=1)), GroundStation(StationSetup(boot=2, system=254))
    try:
        with simulated("px4") as port:
            await second.open([f"udpin://127.0.0.1:{there}"])
            await first.open([f"udpout://127.0.0.1:{port}"])
            await first.links.forward(f"udpout://127.0.0.1:{there}", is_both=False)
            await until(lambda: second.station.fleet.get("px4-1") is not None)
            await until(lambda: bool(first.links._forwarded[0].link.withheld))
            *_, shown = first.links.snapshots(())
            assert shown.forwards.startswith("to a station, one way, ")
            assert shown.frames_out > 10
            answered = asyncio.ensure_future(second.services.vehicle("px4-1").services.parameters.fetch(lambda _: None))
            await until(lambda: any("--forward-both" in event.text for event in first.station.fleet.events))
            assert not answered.done()
            answered.cancel()
            await asyncio.wait([answered])
            await first.links.remove(f"udpout://127.0.0.1:{there}")
            await first.links.forward(f"udpout://127.0.0.1:{there}", is_both=True)
            table = await second.services.vehicle("px4-1").services.parameters.fetch(lambda _: None)
            assert len(table) > 60
    finally:
        await first.close()
        await second.close()


@pytest.mark.sockets
@pytest.mark.flight
async def test_two_stations_that_forward_to_each_other_do_not_loop_and_pymavlink_reads_it() -> None:
    here, there, watched = free_port(), free_port(), free_port()
    first, second = GroundStation(StationSetup(boot=1)), GroundStation(StationSetup(boot=2, system=254))
    peer = mavutil.mavlink_connection(f"udpin:127.0.0.1:{watched}", source_system=250)
    try:
        with simulated("px4") as port:
            await first.open([f"udpout://127.0.0.1:{port}", f"udpin://127.0.0.1:{here}"])
            await second.open([f"udpin://127.0.0.1:{there}"])
            await first.links.forward(f"udpout://127.0.0.1:{there}", is_both=True)
            await second.links.forward(f"udpout://127.0.0.1:{here}", is_both=True)
            await second.links.forward(f"udpout://127.0.0.1:{watched}", is_both=False)
            await until(lambda: second.station.fleet.get("px4-1") is not None)
            await asyncio.sleep(3.0)
            vehicle, back = first.links.routes()
            assert back[1].frames_received > 0, "it comes back"
            sent = first.links._forwarded[0].link.sent
            assert 20 < sent <= vehicle[1].frames_received, "but is not sent again"
            beat = peer.recv_match(type="HEARTBEAT", blocking=True, timeout=5.0)
            assert (beat.get_srcSystem(), beat.autopilot) == (1, 12)
    finally:
        peer.close()
        await first.close()
        await second.close()
