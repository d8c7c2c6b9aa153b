"""The in-memory link does what its conditions say, the same for the same seed."""

import asyncio
import random

import pytest

from gloc3.clock import VirtualLoop
from gloc3.mavlink.transport.memory import Conditions, MemoryLink

from .queue_loop import QueueLoop


def arrivals(
    conditions: Conditions, count: int = 1000, *, seed: int = 1, every_s: float = 0.01
) -> list[tuple[float, int]]:
    loop = QueueLoop()
    link = MemoryLink(loop, random.Random(seed), conditions)
    received: list[tuple[float, int]] = []
    link.b.on_data = lambda data: received.append((loop.time(), int.from_bytes(data[:2], "big")))
    for number in range(count):
        loop.call_at(number * every_s, link.a.send, number.to_bytes(2, "big") + bytes(8))
    loop.run(1e6)
    return received


def test_a_perfect_link_delivers_everything_in_order_at_once() -> None:
    assert [number for _, number in arrivals(Conditions())] == list(range(1000))


def test_latency_and_jitter_delay_without_reordering() -> None:
    received = arrivals(Conditions(latency_s=0.3, jitter_s=0.05))
    assert [number for _, number in received] == list(range(1000))
    delays = [t - number * 0.01 for t, number in received]
    assert min(delays) >= 0.3 - 1e-9
    assert max(delays) <= 0.36
    assert max(delays) - min(delays) > 0.02


def test_loss_is_as_likely_as_it_says_and_the_same_for_the_same_seed() -> None:
    received = arrivals(Conditions(loss=0.2))
    assert 740 < len(received) < 860
    assert received == arrivals(Conditions(loss=0.2))
    assert received != arrivals(Conditions(loss=0.2), seed=2)


def test_duplicates_and_reordering_happen() -> None:
    received = [number for _, number in arrivals(Conditions(duplicate=0.1, reorder=0.1, reorder_s=0.035))]
    assert 1050 < len(received) < 1150
    assert received != sorted(received)
    assert set(received) == set(range(1000))


def test_bandwidth_serialises_and_a_full_queue_drops() -> None:
    serial = Conditions(bandwidth_bit_s=57_600, bits_per_byte=10, latency_s=0.1, queue_bytes=576)
    received = arrivals(serial, count=100, every_s=0.0)
    assert [number for _, number in received] == list(range(57))
    assert received[0][0] == pytest.approx(0.1 + 10 / 5760)
    assert received[56][0] == pytest.approx(0.1 + 570 / 5760)


def test_half_duplex_shares_one_line() -> None:
    loop = QueueLoop()
    link = MemoryLink(loop, random.Random(1), Conditions(bandwidth_bit_s=8000), is_half_duplex=True)
    received: list[float] = []
    link.a.on_data = link.b.on_data = lambda data: received.append(loop.time())
    link.a.send(bytes(1000))
    link.b.send(bytes(1000))
    loop.run(10)
    assert received == pytest.approx([1.0, 2.0])


def test_conditions_may_change_and_what_is_lost_or_dropped_is_counted() -> None:
    loop = QueueLoop()
    link = MemoryLink(loop, random.Random(1))
    link.set_conditions(Conditions(loss=1.0))
    link.a.send(b"gone")
    link.a.conditions = Conditions(bandwidth_bit_s=8, queue_bytes=4)
    link.a.send(b"fits")
    link.a.send(b"over")
    loop.run(100)
    assert (link.a.sent, link.a.lost, link.a.dropped, link.b.received) == (2, 1, 1, 1)


def test_a_closed_end_hears_nothing_more() -> None:
    loop = QueueLoop()
    link = MemoryLink(loop, random.Random(1), Conditions(latency_s=1.0))
    received: list[bytes] = []
    link.b.on_data = received.append
    link.a.send(b"late")
    link.a.on_data = received.append
    asyncio.run(link.b.close())
    link.a.send(b"later")
    loop.run(10)
    assert received == []
    assert not link.a.is_connected


def test_it_runs_on_the_virtual_event_loop() -> None:
    loop = VirtualLoop()
    link = MemoryLink(loop, random.Random(1), Conditions(latency_s=5.0))
    received: list[float] = []

    def receive(data: bytes) -> None:
        received.append(loop.time())
        loop.stop()

    link.b.on_data = receive
    link.a.send(b"hello")
    loop.run_forever()
    loop.close()
    assert received == [5.0]
