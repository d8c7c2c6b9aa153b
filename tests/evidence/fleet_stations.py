"""Several stations and several vehicles: in virtual time over many seeds, as processes, and a hundred at once."""

import tempfile
from functools import partial
from pathlib import Path

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.flight.fleet_processes import ProcessesFound, run_processes
from tests.flight.fleet_trial import Found, run_trial
from tests.flight.many_vehicles import Cost, measure

PLATFORMS, STATIONS = 5, 3
SEEDS = 20
RUNS = 4
FULL_S = 5.0
MANY, COMPONENTS = 100, 20
SPAN_S = 30.0


def _processes(seed: int) -> ProcessesFound:
    with tempfile.TemporaryDirectory() as name:
        return run_processes(seed, Path(name), PLATFORMS)


def fleet_stations(progress: Progress) -> list[Figure]:
    """Figures of the three."""
    trials = []
    for seed in range(SEEDS):
        progress.report(f"seed {seed}")
        trials.append(
            msgspec.convert(progress.part(f"trial {seed}", partial(run_trial, seed, PLATFORMS, STATIONS)), Found)
        )
    runs = [
        msgspec.convert(progress.part(f"processes {seed}", partial(_processes, seed)), ProcessesFound)
        for seed in range(RUNS)
    ]
    cost = msgspec.convert(progress.part("cost", partial(measure, MANY, STATIONS, SPAN_S)), Cost)
    figures = []
    for what, found in ((f"virtual time, {SEEDS} seeds", trials), (f"processes, {RUNS} runs", runs)):
        wrong = [text for one in found for text in one.wrong]
        late_s = [one.late_full_s for one in found]
        ends = [one.mission for one in found]
        hands = {way: sum(one.hand_overs[way] for one in found) for way in found[0].hand_overs}
        figures += [
            Figure(
                f"{what}: commands",
                f"{sum(one.commands for one in found)}: {sum(one.accepted for one in found)} accepted, "
                f"{sum(one.refused for one in found)} refused, {sum(one.unknown for one in found)} not known to the sender",
            ),
            Figure(
                f"{what}: control changed hands",
                ", ".join(f"{number} {way}" for way, number in hands.items()),
                "granted and taken over",
                all(hands[way] for way in ("granted by its holder", "taken over")),
            ),
            Figure(
                f"{what}: vehicles whose holder died, and that somebody else had after it",
                f"{sum(one.crashed_holding for one in found)}, at least {min(one.crashed_holding for one in found)} in each",
                "at least 1 in each",
                all(one.crashed_holding for one in found),
            ),
            Figure(
                f"{what}: a mission across two of the vehicles meanwhile",
                ", ".join(f"{ends.count(end)} {end}" for end in sorted(set(ends))),
                "done in each",
                set(ends) == {"done"},
            ),
            Figure(
                f"{what}: executed twice, by the wrong vehicle, or for who had no control",
                "; ".join(wrong[:3]) or "none",
                "none",
                not wrong,
            ),
            Figure(
                f"{what}: a station that comes late knows everything after",
                f"{max(late_s):.1f} s at most" if min(late_s) >= 0.0 else "never",
                f"under {FULL_S:g} s",
                min(late_s) >= 0.0 and max(late_s) < FULL_S,
            ),
        ]
    figures += [
        Figure(
            f"{MANY} vehicles of {cost.components} components and {STATIONS} stations on one clock: each vehicle, with its "
            "physics and autopilot, costs",
            f"{cost.per_platform_ms:.0f} ms of processor time a second of its own",
            f"{COMPONENTS} components",
            cost.components >= COMPONENTS,
        ),
        Figure(
            "platforms that each station knows everything of, at the end",
            ", ".join(str(count) for count in cost.known),
            f"{MANY} each",
            all(count == MANY for count in cost.known),
        ),
        Figure("memory of all together", f"{cost.memory_mb:.0f} MB"),
    ]
    return figures


BARS = (
    Bar(
        "fleet-stations",
        "Three stations command five vehicles: no command runs twice, or without control",
        "Three stations command five vehicles at once. Each command has a number by which it is recognized where it "
        "arrives. For three of the vehicles the stations request, grant, refuse, release and take over control at "
        "random, while a fourth station flies the other two by one mission. Their radios lose one frame in ten, "
        "repeat and reorder (in virtual time; as processes, over UDP on loopback). A station dies while it holds "
        "control (as a process, by SIGKILL), another joins late, and the computer of one vehicle dies and comes back "
        "(in virtual time). The records of the vehicles are compared with what the stations received. The last rows "
        "run a hundred whole vehicles on one virtual clock.",
        fleet_stations,
        seeds=f"0 to {SEEDS - 1}, 0 to {RUNS - 1}",
    ),
)
