"""The search for the rate of a serial line."""

import random

import pytest

from gloc3.mavlink.codec import Encoder, message
from gloc3.mavlink.transport.serial_line import RATES, TRY_S, BaudSearch


def search(right: int, seed: int, talks_hz: float = 10.0, for_s: float = 60.0) -> tuple[BaudSearch, float]:
    """A search on a line on which an autopilot talks at a rate; when it ended."""
    noise, encoder, now_s = random.Random(seed), Encoder(1, 1), 0.0
    found = BaudSearch(now_s)
    next_s = noise.random() / talks_hz
    while not found.is_found and now_s < for_s:
        now_s += 0.05
        data = b""
        while next_s <= now_s:
            next_s += 1.0 / talks_hz
            frame = encoder.encode(message("HEARTBEAT", type=2, autopilot=3))
            data += frame if found.rate == right else noise.randbytes(len(frame))
        found.receive(data, now_s)
    return found, now_s


@pytest.mark.parametrize("right", RATES)
@pytest.mark.parametrize("talks_hz", [1.0, 10.0])
def test_every_rate_is_found_even_by_heartbeats_alone(right: int, talks_hz: float) -> None:
    for seed in range(5):
        found, at_s = search(right, seed, talks_hz)
        assert (found.is_found, found.rate) == (True, right)
        assert at_s < (RATES.index(right) + 3) * TRY_S + 1.0


@pytest.mark.thorough
def test_noise_is_never_taken_for_an_autopilot() -> None:
    found, _ = search(1, 0, talks_hz=400.0)
    assert not found.is_found


def test_once_found_it_stays() -> None:
    found, at_s = search(115_200, 0)
    found.receive(b"", at_s + 100.0)
    assert (found.is_found, found.rate) == (True, 115_200)
