"""Message rates: measured from what comes, and asked for."""

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3.mavlink.transport.memory import Conditions
from gloc3_groundstation.services.rates import FrameRateMeter, RateRow

from .scripted_vehicle import Scene, over


def row(scene: Scene, name: str) -> RateRow:
    (found,) = scene.services.rates.table.find(name)
    return found


def test_rates_are_measured_and_a_message_that_stays_away_is_seen() -> None:
    async def play(scene: Scene) -> None:
        await scene.pass_s(6.0)
        assert row(scene, "attitude").rate_hz == pytest.approx(4.0, rel=0.1)
        assert row(scene, "HEARTBEAT").rate_hz == pytest.approx(1.0, rel=0.2)
        assert scene.services.rates.table.total_bytes_s > 50.0
        scene.cut()
        await scene.pass_s(2.0)
        assert row(scene, "ATTITUDE").rate_hz < 3.5
        await scene.pass_s(6.0)
        assert row(scene, "ATTITUDE").rate_hz == 0.0
        assert row(scene, "ATTITUDE").age_s == pytest.approx(8.0, abs=0.5)

    over(play)


def test_a_message_is_asked_for_more_often_not_at_all_and_as_usual() -> None:
    async def play(scene: Scene) -> None:
        rates = scene.services.rates
        await scene.pass_s(1.0)
        await rates.request("attitude", 20.0)
        await rates.request("VFR_HUD", 10.0)
        await scene.pass_s(6.0)
        assert row(scene, "ATTITUDE").rate_hz == pytest.approx(20.0, rel=0.2)
        assert row(scene, "ATTITUDE").wanted_hz == 20.0
        assert row(scene, "VFR_HUD").rate_hz == pytest.approx(10.0, rel=0.2)
        await rates.request("ATTITUDE", 0.0)
        await rates.request("74", None)
        await scene.pass_s(6.0)
        assert row(scene, "ATTITUDE").rate_hz == row(scene, "VFR_HUD").rate_hz == 0.0
        assert row(scene, "VFR_HUD").wanted_hz is None

    over(play, Conditions(latency_s=0.05, loss=0.05))


def test_refusals_are_in_words() -> None:
    async def play(scene: Scene) -> None:
        rates = scene.services.rates
        for name, rate_hz, words in (
            ("ATTITUDEE", 1.0, "did you mean 'ATTITUDE'"),
            ("RAW_IMU", 1.0, "RAW_IMU: denied"),
            ("ATTITUDE", 1000.0, "a rate is from 0 to 250 Hz"),
            ("ATTITUDE", float("nan"), "a rate is from 0 to 250 Hz"),
        ):
            with pytest.raises(Refused, match=words):
                await rates.request(name, rate_hz)
        scene.cut()
        with pytest.raises(Refused, match="ATTITUDE: not answered"):
            await rates.request("ATTITUDE", 5.0)

    over(play)


def test_a_burst_is_no_rate_and_strangers_cannot_fill_the_table() -> None:
    meter, parser = FrameRateMeter(), Parser(is_datagram=True)
    for number in range(600):
        (frame,) = parser.receive(Encoder(1 + number % 200, 1 + number // 200).encode(message("ATTITUDE")))
        meter.count(frame, 0.0)
    assert len(meter.table(1.0).rows) == 512
    assert meter.table(1.0).total_hz == 0.0
