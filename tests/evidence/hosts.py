"""One vehicle on three hosts: flown with the stereo odometer on one, then on another, with what networks do to it."""

import asyncio
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.nodes.three_hosts import BASE, BASE_FAULTS, FAULTS, NETS, VISION, Fault, fly, missing

BOUND_S = 0.01
HEALED_S = 5.0
RATE_HZ = 10.0


def flight(odometer: str, faults: tuple[Fault, ...], progress: Progress) -> dict[str, Any]:
    """One flight."""
    with tempfile.TemporaryDirectory() as folder:
        return dict(msgspec.to_builtins(asyncio.run(fly(Path(folder), odometer, faults, progress.say))))


def hosts(progress: Progress) -> list[Figure]:
    """Both flights."""
    lack = missing()
    if lack:
        return [Figure("hosts", lack, "three", False)]
    figures: list[Figure] = []
    for odometer, faults, holds in ((VISION, FAULTS, 0), (BASE, BASE_FAULTS, 1)):
        found = progress.part(odometer, partial(flight, odometer, faults, progress))
        rate, bounds = found["rate_hz"], found["clock_bounds_s"]
        end, told = found["mission"], found["holds"]
        figures += [
            Figure(f"stereo odometer on {odometer}: the mission's end", end, "done", end == "done"),
            Figure("… odometry as it comes to the vehicle, in Hz", str(rate), f"≥ {RATE_HZ:g}", rate >= RATE_HZ),
            Figure("… from the exposure to there, median, in s", str(found["delay_s"])),
            *(
                Figure(
                    f"… how well {host} knows the time, in ms",
                    f"{bounds[host] * 1e3:.1f}",
                    "≤ 10",
                    bounds[host] <= BOUND_S,
                )
                for host in NETS
            ),
        ]
        for fault in faults:
            took_s = found["faults"].get(fault.name, -1.0)
            was_lost = took_s >= 0.0
            text = f"lost, and here again {took_s} s after" if was_lost else "not lost"
            bar = f"lost, here again within {HEALED_S:g} s" if fault.is_loss else ""
            is_met = not fault.is_loss or (was_lost and took_s <= HEALED_S)
            figures.append(Figure(f"… {fault.name}: {fault.host}", text, bar, is_met))
        figures.append(Figure("… times that the loss of a host has it hold", str(told), str(holds), told == holds))
        figures.append(
            Figure("… what did not heal", "; ".join(found["wrong"]) or "nothing", "nothing", not found["wrong"])
        )
    return figures


BARS = (
    Bar(
        "hosts",
        "One vehicle on three hosts",
        "A vehicle, a vision computer and a base station, each a network namespace with a clock of its own, joined by "
        "lines with certificates. The stereo odometer moves from the second to the third by one word. What goes wrong "
        "on the lines and in the processes is told, has the vehicle do what the policy says, and heals.",
        hosts,
    ),
)
