"""The router beside others', a bad radio behind it, and somebody without the key."""

from functools import partial
from statistics import median
from typing import Any

from tests.benchmarks import router
from tests.benchmarks.router import DIRECT, FAST, OURS, QUIET, STEADY, STREAMS, TOGETHER, Passed, Stream
from tests.evidence.page import Bar, Figure, Progress

ROUNDS = 5
RADIOS = 20
ATTACKS = 5_000

Round = dict[str, dict[Stream, Passed]]


def one_round() -> dict[str, list[list[float]]]:
    """A round as it can be kept: by router, of each stream the figures."""
    (found,) = router.measure(1)
    return {name: [list(found[name][stream]) for stream in STREAMS] for name in found}


def beside_others(progress: Progress) -> list[Figure]:
    """Our router, MAVProxy, and mavlink-router where it is installed, in turn, several times."""
    rounds: list[Round] = []
    for number in range(ROUNDS):
        kept = progress.part(f"round {number}", one_round)
        rounds.append({name: dict(zip(STREAMS, (Passed(*row) for row in kept[name]), strict=True)) for name in kept})
        progress.report(f"{number + 1} of {ROUNDS} rounds")
    known = router.typical(rounds)
    figures = [Figure("rounds, each router in each", str(ROUNDS))]
    if router.PYTHON_PEER not in known:
        return [*figures, Figure(router.PYTHON_PEER, "not here", "here", False)]
    for stream in (STEADY, TOGETHER, FAST):
        for name in known:
            if name != DIRECT:
                cost_us = known[name][stream].cpu_us
                figures.append(Figure(f"{stream.text}: processor of a frame, {name}, in µs", f"{cost_us:.1f}"))
        ratio = median(each[router.PYTHON_PEER][stream].cpu_us / each[OURS][stream].cpu_us for each in rounds)
        figures.append(Figure("… MAVProxy's in ours", f"{ratio:.1f}", "≥ 5", ratio >= 5.0))
    for stream in (QUIET, STEADY, TOGETHER):
        for name in known:
            if name != router.PYTHON_PEER:
                delay = known[name][stream]
                text = f"p50 {delay.p50_us:.0f}, p99 {delay.p99_us:.0f}"
                figures.append(Figure(f"{stream.text}: delay, {name}, in µs", text))
        added_us = median(each[OURS][stream].p99_us - each[DIRECT][stream].p99_us for each in rounds)
        figures.append(Figure("… added at p99 by ours, in µs", f"{added_us:.0f}", "≤ 1000", added_us <= 1000.0))
    fast = known[OURS][FAST]
    figures.append(
        Figure(f"{FAST.text}: lost in the worst round", str(fast.sent - fast.received), "0", fast.received == fast.sent)
    )
    return figures


def radios(first: int, count: int) -> list[dict[str, Any]]:
    """Some runs of the radio scenario."""
    import msgspec
    from tests.onboard.radio_scenario import scenario

    return [msgspec.to_builtins(scenario(seed)) for seed in range(first, first + count)]


def radio(progress: Progress) -> list[Figure]:
    """The radio that loses one frame in ten."""
    rows: list[dict[str, Any]] = []
    for first in range(0, RADIOS, 5):
        rows += progress.part(f"runs from {first}", partial(radios, first, 5))
        progress.report(f"{len(rows)} of {RADIOS} runs")

    def worst(name: str, *, is_least: bool = False) -> float:
        return float((min if is_least else max)(row[name] for row in rows))

    unequal = sum(not row["is_equal"] for row in rows)
    unanswered, twice = sum(row["unanswered"] for row in rows), sum(row["ran_twice"] for row in rows)
    slowest, gap = worst("slowest_stream_hz", is_least=True), worst("heartbeat_gap_s")
    reports, silence = worst("slowest_report_hz", is_least=True), worst("report_gap_s")
    answer, overfilled = worst("slowest_answer_s"), sum(row["overfilled"] for row in rows)
    gives_up = worst("command_gives_up_s", is_least=True), worst("command_gives_up_s")
    return [
        Figure("runs of 100 s", str(len(rows))),
        Figure("of the line that was used, median", f"{median(row['used'] for row in rows):.0%}"),
        Figure("the autopilot's slowest stream, Hz", f"{slowest:.1f}", "≥ 1", slowest >= 1.0),
        Figure("longest time without a heartbeat, in seconds", f"{gap:.1f}", "≤ 4.5", gap <= 4.5),
        Figure("reports of the least lucky of 20 components, Hz", f"{reports:.2f}", "≥ 1", reports >= 1.0),
        Figure("longest time without one, in seconds", f"{silence:.1f}", "≤ 5", silence <= 5.0),
        Figure(
            "a mission of 8 kB to the companion, worst in seconds",
            f"{worst('mission_s'):.1f}",
            "≤ 15",
            worst("mission_s") <= 15,
        ),
        Figure(
            "a plan of 50 items to the autopilot, worst in seconds",
            f"{worst('plan_s'):.1f}",
            "≤ 45",
            worst("plan_s") <= 45,
        ),
        Figure("runs in which either came otherwise than it was sent", str(unequal), "0", unequal == 0),
        Figure("commands, unanswered", f"{unanswered} of {sum(row['commands'] for row in rows)}", "0", unanswered == 0),
        Figure("… run twice", str(twice), "0", twice == 0),
        Figure("… slowest answer in seconds", f"{answer:.1f}", "≤ 4", answer <= 4.0),
        Figure("frames that the radio had no room for", str(overfilled), "0", overfilled == 0),
        Figure(
            "radio cut: a command is given up after, in seconds",
            f"{gives_up[0]:.1f} to {gives_up[1]:.1f}",
            "4 to 5",
            gives_up[0] >= 4.0 and gives_up[1] <= 5.0,
        ),
        Figure(
            "… a plan, worst in seconds", f"{worst('plan_gives_up_s'):.1f}", "≤ 15", worst("plan_gives_up_s") <= 15.0
        ),
        Figure(
            "… mended: heartbeats and an answer after, worst in seconds",
            f"{worst('back_s'):.1f}",
            "≤ 5",
            worst("back_s") <= 5.0,
        ),
    ]


def attacked() -> dict[str, Any]:
    """The hostile scenario."""
    import msgspec
    from tests.onboard.hostile_scenario import scenario

    return dict(msgspec.to_builtins(scenario(ATTACKS, rounds=6)))


def hostile(progress: Progress) -> list[Figure]:
    """The link on which somebody without the key tries everything."""
    found = progress.part("attacks", attacked)
    refused, none_through = (
        sum(found["refused"].values()),
        not (found["reached_autopilot"] or found["reached_companion"]),
    )
    return [
        Figure("frames without the key on a signed link", str(found["attacks"])),
        Figure("… refused and counted", str(refused), "all", refused == found["attacks"]),
        *(Figure(f"… {reason}", str(count)) for reason, count in found["refused"].items()),
        Figure("… that reached the autopilot", str(found["reached_autopilot"]), "0", none_through),
        Figure("… that reached the command interface", str(found["reached_companion"]), "0", none_through),
        Figure("events about them, one of a reason a minute", str(found["told"]), "≤ 6", found["told"] <= 6),
        Figure(
            "the true station is served before, after, and after all of it six more times",
            "yes" if found["still_served"] else "no",
            "yes",
            found["still_served"],
        ),
        Figure("frames of somebody with the key whose clock is a year fast", str(found["from_future"])),
        Figure(
            "… refused and counted",
            str(found["from_future_refused"]),
            "all",
            found["from_future_refused"] == found["from_future"],
        ),
        Figure("… seconds by which they move our signing time", f"{found['moved_s']:.0f}", "0", not found["moved_s"]),
        Figure(
            "frames of the last minute, sent once more after the onboard process was killed", str(found["replayed"])
        ),
        Figure("… taken", str(found["taken_again"]), "0", not found["taken_again"]),
        Figure("frames of invented systems on a link without a key", str(found["invented"])),
        Figure("… senders that are remembered", str(found["senders"]), "≤ 256", found["senders"] <= 256),
        Figure(
            "… a station that was there before still reaches the autopilot",
            "yes" if found["flood_still_served"] else "no",
            "yes",
            found["flood_still_served"],
        ),
        Figure(
            "memory that the last two of these times keep, in bytes",
            str(found["growth_bytes"]),
            "< 20000",
            found["growth_bytes"] < 20_000,
        ),
    ]


BARS = (
    Bar(
        "router",
        "The router needs at most a fifth of MAVProxy's processor time and loses nothing",
        "The router needs at most a fifth of MAVProxy's processor time for a forwarded message, adds at most 1 ms to "
        "the delay at p99, and loses nothing at 10,000 messages a second. All routers run on the same machine, in "
        "turn; each figure is the median of the rounds.",
        beside_others,
    ),
    Bar(
        "radio",
        "Reports, commands, missions and plans all pass a radio that loses one frame in ten",
        "A 57,600 baud radio loses 10 % both ways while the autopilot sends several times more than the radio "
        "carries. Reports, commands, a mission and a plan all get their share. What is lost for good is given up when "
        "the protocol says so.",
        radio,
        seeds=f"0 to {RADIOS - 1}",
    ),
    Bar(
        "hostile-link",
        "Frames from a sender without the key are refused, and the real station is still served",
        "On a signed link, unsigned, forged, repeated, late, future-dated and unknown frames are refused and counted, "
        "and so is a second station that takes over in the name of the first; the real station is still served. A "
        "sender with the key and a wrong clock does not set ours, and no frame is accepted again after a restart. "
        "Thousands of invented systems on an open link get no room and keep no other out. Memory does not grow.",
        hostile,
        seeds="1 to 7",
    ),
)
