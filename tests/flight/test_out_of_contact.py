"""A vehicle out of contact: silent as planned, a summary by sound, an order by sound, and at contact all that happened."""

import contextlib
import hmac

from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.errors import Gloc3Error
from gloc3.exchange.acoustic import MOST_BYTES, AcousticCode, AcousticOrder, AcousticSummary, AcousticVerb, Receipt
from gloc3.messages.command_interface import EmergencyVerb
from gloc3_groundstation.station import wording

SWEEP = "{out: {follow_waypoints: {waypoints_m: [[8, 0, 1.5], [0, 0, 1.5], [8, 0, 1.5]], speed_m_s: 0.1}}}"


def shown(flight: Card, since: int) -> list[str]:
    """What the station has shown since its event of that number."""
    return [event.text for event in flight.flight.station.fleet.events_after(since)]


@ONE_STYLE
def test_the_summary_comes_first_and_then_every_event_once_and_in_order(flight: Card) -> None:
    flight.begin(mission(SWEEP, options="silence: {expected_s: 90}, ", on_link_loss="land"))
    flight.await_state("sweep", "running")
    flight.wait(1.0)
    silence = flight.fault("link_loss")
    flight.wait(20.0)
    flight.fault("crash:computer")
    flight.wait(50.0)
    assert flight.mission.policy == "", "the silence is planned"
    platform = flight.flight.station.fleet.platforms["pelican"]
    assert wording.silence(platform, flight.now_s).startswith("silent as planned (sweep), due 00:01:")
    since, contact_s = flight.flight.station.fleet.event_count, flight.now_s
    silence.end()
    flight.until(lambda: any("contact after" in text for text in shown(flight, since)), 2.0, "the summary")
    flight.wait(5.0)
    reported = shown(flight, since)
    summary = next(at for at, text in enumerate(reported) if text.startswith("contact after"))
    assert "is heard again" in reported[0]
    assert summary == 1, reported
    below = [event.text for event in flight.events if contact_s - 69.0 < event.t_s < contact_s]
    assert len(below) >= 3, "what happened below"
    after = [text.partition(" (")[0] for text in reported[2:]]
    assert after[: len(below)] == [text.partition(" (")[0] for text in below]
    flight.wait(20.0)
    assert flight.mission.policy == "", "contact was made in time"


@ONE_STYLE
def test_nothing_but_summaries_goes_by_sound_and_an_order_brings_the_vehicle_down(flight: Card) -> None:
    flight.begin(mission(SWEEP, options="silence: {expected_s: 900}, ", on_link_loss="land"), modem_period_s=15.0)
    modem, code, received = flight.flight.links.modem, AcousticCode("pelican"), list[tuple[float, bytes]]()
    for end in (modem.a, modem.b):
        receive = end.on_data
        assert receive is not None

        def listen(data: bytes, receive: object = receive) -> None:
            received.append((flight.now_s, data))
            receive(data)  # type: ignore[operator]

        end.on_data = listen
    flight.await_state("sweep", "running")
    flight.wait(17.0)
    assert not received, "while a station is heard otherwise nothing is told by sound"
    flight.fault("link_loss")
    flight.wait(50.0)
    frames = [code.decode(data) for _, data in received]
    assert 1 <= len(frames) <= 3
    assert all(isinstance(frame, AcousticSummary) for frame in frames)
    assert all(len(data) <= MOST_BYTES for _, data in received)
    platform = flight.flight.station.fleet.platforms["pelican"]
    assert platform.acoustic is not None
    x_m, _, height_m = platform.acoustic.value.position_m
    assert abs(height_m - 1.5) < 0.3
    assert 0.0 < x_m < 8.2
    assert "acoustic" in wording.silence(platform, flight.now_s)
    assert "sweep.out" in wording.silence(platform, flight.now_s)
    received.clear()
    flight.run(_press(flight))
    flight.await_policy("land", 60.0)
    flight.await_landed(60.0)
    flight.wait(30.0)
    kinds = [type(code.decode(data)) for _, data in received]
    assert set(kinds) <= {AcousticOrder, Receipt, AcousticSummary}
    assert kinds.count(AcousticOrder) >= 1
    assert flight.was_told("emergency land by an operator, by acoustic modem")
    assert any("has accepted command surface (acoustic)" in text for text in shown(flight, 0))


async def _press(flight: Card) -> None:
    """The emergency key; the radio cannot tell what became of it."""
    with contextlib.suppress(Gloc3Error):
        await flight.flight.station.client.emergency("pelican", EmergencyVerb.LAND)


def test_frames_that_are_damaged_old_or_of_somebody_else_are_not_taken() -> None:
    code, other = AcousticCode("auv", b"key"), AcousticCode("auv", b"another key")
    data = code.encode(AcousticOrder(3, AcousticVerb.SURFACE))
    assert AcousticCode("auv", b"key").decode(data) == AcousticOrder(3, AcousticVerb.SURFACE)
    assert other.decode(data) is None
    assert AcousticCode("rov", b"key").decode(data) is None
    assert all(code.decode(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]) is None for at in range(len(data)))
    assert all(code.decode(data[:size]) is None for size in range(len(data)))
    long = b"\x12" + data[1:4] + bytes(MOST_BYTES)
    assert code.decode(long + hmac.digest(b"key", long, "sha256")[:4]) is None
