"""What the exchanger costs beside Zenoh itself, and what shared memory saves."""

from tests.benchmarks import network
from tests.benchmarks.network import LOOP, OURS, RAW, SHARED, TCP, TOPIC_RATE_HZ, TOPICS, Round
from tests.benchmarks.parts import best_us, deliveries
from tests.evidence.page import Bar, Figure, Progress

ROUNDS = 9


def run(progress: Progress) -> list[Figure]:
    """Everything that is compared, in turn, several times."""
    rows = progress.part("rounds", lambda: network.measure(ROUNDS))
    found = [Round(*row) for row in rows]
    local_us = progress.part("local", lambda: best_us(deliveries))
    figures = [Figure("rounds, everything in each", str(ROUNDS))]
    for text, of, unit in (
        ("pose: delay p50", lambda r: r.delay_us, "µs"),
        ("pose: delay p99", lambda r: r.delay_p99_us, "µs"),
        ("poses in a burst", lambda r: r.rate_hz, "a second"),
    ):
        values = ", ".join(f"{way} {network.typical(found, of, way):,.0f}" for way in (OURS, LOOP, RAW))
        figures.append(Figure(f"{text}, {unit}", values))
    delay = network.ratio(found, lambda r: r.delay_us, OURS, LOOP)
    rate = network.ratio(found, lambda r: r.rate_hz, OURS, LOOP)
    figures += [
        Figure(f"… delay p50, of {LOOP}", f"{delay:.2f}", "≤ 1.3", delay <= 1.3),
        Figure(f"… of {RAW} in its own thread", f"{network.ratio(found, lambda r: r.delay_us, OURS, RAW):.2f}"),
        Figure(f"… rate, of {LOOP}", f"{rate:.2f}", "≥ 0.7", rate >= 0.7),
        Figure(f"… of {RAW} in its own thread", f"{network.ratio(found, lambda r: r.rate_hz, OURS, RAW):.2f}"),
        Figure("local delivery, in µs", f"{local_us:.2f}", "≤ 1", local_us <= 1.0),
    ]
    for text, of, unit in (
        ("picture of 640 x 480: delay p50", lambda r: r.picture_us, "µs"),
        ("pictures, as fast as they go", lambda r: r.picture_rate_hz, "a second"),
    ):
        values = ", ".join(f"{way} {network.typical(found, of, way):,.0f}" for way in (SHARED, TCP))
        figures.append(Figure(f"{text}, {unit}", values))
    delay = network.ratio(found, lambda r: r.picture_us, SHARED, TCP)
    rate = network.ratio(found, lambda r: r.picture_rate_hz, SHARED, TCP)
    figures += [
        Figure(f"… delay, {SHARED} in {TCP}", f"{delay:.2f}", "≤ 0.5", delay <= 0.5),
        Figure(f"… rate, {SHARED} in {TCP}", f"{rate:.1f}", "≥ 3", rate >= 3.0),
    ]
    shares = ", ".join(f"{way} {network.typical(found, lambda r: r.share, way):.1%}" for way in (OURS, LOOP, RAW))
    figures.append(Figure(f"{TOPICS} topics at {TOPIC_RATE_HZ} Hz, both processes, of one processor", shares))
    return figures


BARS = (
    Bar(
        "network-cost",
        "The network adds at most 30 % to the delay of Zenoh itself",
        "Between two processes the exchanger's delay is at most 1.3 times that of Zenoh itself when the message is "
        "handed to the loop, and its rate is at least 0.7 of that. Figures of Zenoh in its own thread, where no "
        "component runs, are beside it. Inside a process a delivery takes at most 1 µs. Pictures between processes of "
        "one computer go by shared memory, in half the time and at three times the rate of TCP, both through the "
        "exchanger. All variants are open between the same two processes and take turns in each round; the figures "
        "are medians of the rounds.",
        run,
    ),
)
