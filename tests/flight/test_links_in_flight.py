"""The links of the onboard process in virtual time: routed between autopilot and stations, as those of `gloc3 onboard` are."""

from typing import Any

from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.exchange.acoustic import AcousticCode, AcousticOrder, AcousticVerb
from gloc3.mavlink.codec import Encoder, MavlinkMessage, Parser, message

STATION = Encoder(250, 190)
SET_MESSAGE_INTERVAL = 511


def listen(flight: Card) -> list[MavlinkMessage]:
    """What a station of somebody else receives on a link of its own."""
    received: list[MavlinkMessage] = []
    parser, end = Parser(is_datagram=True), flight.flight.process.add_radio().a

    def receive(data: bytes) -> None:
        received.extend(filter(None, (frame.decode() for frame in parser.receive(data))))

    end.on_data = receive
    return received


@ONE_STYLE
def test_a_station_hears_the_autopilot_and_the_companion_s_warnings_on_its_link(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    received = listen(flight)
    flight.wait(2.0)
    assert "ATTITUDE" in {each.name for each in received} or "LOCAL_POSITION_NED" in {each.name for each in received}
    flight.fault("crash:take_off", for_s=5.0)
    flight.wait(3.0)
    texts = [each.text for each in received if each.name == "STATUSTEXT"]
    assert any(text.startswith("take_off: ") for text in texts)


@ONE_STYLE
def test_what_another_station_asks_of_the_autopilot_reaches_it_and_our_rates_follow(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    end: Any = flight.flight.process.add_radio().a
    flight.wait(1.0)
    flight.to_autopilot.clear()
    end.send(STATION.encode(message("REQUEST_DATA_STREAM", target_system=1, target_component=1, req_message_rate=2)))
    flight.wait(0.5)
    names = [each.name for _, each in flight.to_autopilot]
    assert "REQUEST_DATA_STREAM" in names
    wanted = [each for _, each in flight.to_autopilot if getattr(each, "command", 0) == SET_MESSAGE_INTERVAL]
    assert len(wanted) > 3, "what we need of the autopilot is asked for again"


@ONE_STYLE
def test_an_order_by_sound_to_a_dead_process_is_lost(flight: Card) -> None:
    flight.begin(mission(), is_started=False, modem_period_s=15.0)
    flight.wait(1.0)
    flight.flight.process.kill()
    begin_s = flight.now_s
    flight.flight.links.modem.a.conditions = flight.flight.links.cable.a.conditions
    flight.flight.links.modem.a.send(AcousticCode("pelican").encode(AcousticOrder(9, AcousticVerb.HOLD)))
    flight.wait(3.0)
    assert not flight.since(begin_s, "ci/request")
