"""One vehicle on three hosts: flown with the stereo odometer on one, then on another, with what networks do to it."""

import asyncio
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.hosts.namespaces import BASE, NETS, VISION, has_netem, missing, namespaces
from tests.onboard.hosts.three_hosts import fly
from tests.onboard.hosts.three_hosts_faults import EITHER, HOLDS, LANDS, Fault, emulated
from tests.onboard.hosts.three_hosts_told import Report, Trial

CALM_S = 15.0
BOUND_S = 0.01
RATE_HZ = 13.0
USED = 0.5
"""The voting among the sources sets one aside for some seconds where it differs from the others, as the stereo odometer does
where the vehicle turns round, on whatever host it is."""
HEALED_S = 4.0
"""An end that was cut off is forgotten after 2 s, the other tries again at least every second, and a handshake has its
time: so long where no process begins anew; else as long more as it took at the start of the flight."""
LANDED_S = 20.0
"""From 1.5 m, with 0.5 m/s; some seconds until the autopilot takes itself to be landed, and the companion's start."""
AWAY_M = 0.7
TOUCH_DOWN_M_S = 1.0
STANDING_M_S = 0.2
STALL_S = 0.5


def flight(odometer: str, faults: tuple[Fault, ...], progress: Progress) -> dict[str, Any]:
    """One flight."""
    with tempfile.TemporaryDirectory() as folder:
        return dict(msgspec.to_builtins(asyncio.run(fly(Path(folder), odometer, faults, progress.report, CALM_S))))


def hosts(progress: Progress) -> list[Figure]:
    """Both flights."""
    lack = missing()
    if lack:
        return [Figure("hosts", lack, "three", False)]
    with namespaces():
        faults = emulated(has_netem())
    figures: list[Figure] = []
    for odometer in (VISION, BASE):
        part = partial(flight, odometer, faults[odometer], progress)
        found = msgspec.convert(progress.part(odometer, part), Report)
        figures += _calm(found)
        for fault, trial in zip(faults[odometer], found.trials, strict=True):
            figures += _fault(fault, trial, found.start_s)
        figures += _whole(found)
    return figures


def _calm(found: Report) -> Iterator[Figure]:
    end = found.mission
    yield Figure(f"stereo odometer on {found.odometer}: the flight's end", end, "landed", end == "landed")
    rate_hz = found.rate_hz
    yield Figure(
        "… odometry as it comes to the vehicle, in Hz; of 15 pictures, fewer where this computer has no time",
        str(rate_hz),
        f"≥ {RATE_HZ:g}",
        rate_hz >= RATE_HZ,
    )
    yield Figure("… lost in transit while nothing is wrong", str(found.missed), "0", found.missed == 0)
    yield Figure("… from the exposure to there, median, in s", str(found.delay_s))
    used = f"{100.0 * found.used_share:.1f}"
    yield Figure(
        "… poses that rest on it and that the vehicle flies by, in %",
        used,
        f"≥ {100.0 * USED:g}",
        found.used_share >= USED,
    )
    for host in NETS:
        bound_s = found.clock_bounds_s[host]
        yield Figure(f"… how well {host} knows the time, in ms", f"{bound_s * 1e3:.1f}", "≤ 10", bound_s <= BOUND_S)


def _fault(fault: Fault, trial: Trial, start_s: float) -> Iterator[Figure]:
    """What was stated of a fault, and what was seen."""
    name = f"… {fault.host}, {fault.name}" + (f", {fault.for_s:g} s" if fault.for_s else "")
    wanted = ["lost" if fault.is_lost else "not lost"] if fault.is_lost is not None else []
    wanted.append(f"the mission {fault.mission}: {fault.policy}")
    has_held = trial.held_at_s > 0.0
    seen = ["lost" if trial.is_lost else "not lost"] if fault.is_lost is not None else []
    seen.append("it was paused" if has_held else "it landed" if fault.mission == LANDS else "it went on")
    is_to_hold = trial.is_lost if fault.mission == EITHER else fault.mission == HOLDS
    is_as_stated = (fault.is_lost is None or trial.is_lost == fault.is_lost) and has_held == is_to_hold
    yield Figure(name, "; ".join((*seen, *trial.wrong)), "; ".join(wanted), is_as_stated and not trial.wrong)
    if fault.mission == LANDS:
        yield Figure(
            "… … until it stands, in s", str(trial.healed_s), f"≤ {LANDED_S:g}", 0.0 <= trial.healed_s <= LANDED_S
        )
        return
    bound_s = HEALED_S + (start_s if fault.name == "SIGKILL" else 0.0)
    yield Figure(
        "… … until all is as before, in s",
        str(trial.healed_s),
        f"≤ {bound_s:.1f}",
        0.0 <= trial.healed_s <= bound_s,
    )
    yield Figure("… … until the pose rests on the stereo odometry again, in s", str(trial.used_s))
    if trial.commands:
        outcomes = ", ".join(sorted({command.outcome for command in trial.commands}))
        yield Figure(f"… … {len(trial.commands)} commands meanwhile", outcomes)


def _whole(found: Report) -> Iterator[Figure]:
    away_m, speed = found.farthest_m, found.moving_m_s
    yield Figure("… commands on the lossy radio that were not executed just once", "; ".join(found.twice) or "none", "none", not found.twice)  # fmt: skip
    yield Figure("… farthest from the way, in m", str(away_m), f"< {AWAY_M:g}", away_m < AWAY_M)
    yield Figure("… touches down with, in m/s", str(found.touch_down_m_s), f"< {TOUCH_DOWN_M_S:g}", found.touch_down_m_s < TOUCH_DOWN_M_S)  # fmt: skip
    yield Figure("… fastest while it holds, in m/s", str(speed), f"< {STANDING_M_S:g}", speed < STANDING_M_S)
    yield Figure(
        "… longest that the process that looks on overslept, in s: this computer had no time",
        str(found.stall_s),
        f"< {STALL_S:g}",
        found.stall_s < STALL_S,
    )


BARS = (
    Bar(
        "hosts",
        "One vehicle flies on three computers, and survives slow, cut and lost links",
        "A vehicle, a vision computer and a base station are network namespaces with clocks of their own, connected "
        "by links with certificates: TLS to the second, QUIC to the third. The Pelican flies in the hold without "
        "satellites, by its fused pose. The stereo odometer moves from the second computer to the third by one word "
        "in a file. Each fault of a link or a process is reported, the vehicle reacts as stated before (third "
        "column), and everything recovers.",
        hosts,
    ),
)
