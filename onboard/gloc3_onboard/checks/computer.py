"""Checks of the onboard computer: disk, log, clocks and ports."""

from collections.abc import Iterator
from typing import Final

from gloc3.cli.port_advice import port_advice
from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.readiness import ComputerState, LinkCondition
from gloc3_onboard.checks.readings import Readings

GROUP = Group.COMPUTER
LEAST_FREE_MB: Final = 200.0
"""Below this a flight's log and pictures may not fit."""
LITTLE_FREE_MB: Final = 2_000.0
LEAST_WRITE_MB_S: Final = 1.0
"""Write speed below which the log falls behind: it needs some 0.1 MB/s, plus pictures."""
LITTLE_WRITE_MB_S: Final = 5.0
LEAST_LOG_MIN: Final = 10.0
"""The disk is full sooner than a flight ends."""
LITTLE_LOG_MIN: Final = 60.0
CLOCKS_AGREE_S: Final = 1.0


def computer_checks(readings: Readings) -> Iterator[Check]:
    """The lines about the computer."""
    computer = readings.computer
    if computer is None:
        advice = "add a component of gloc3_onboard.components.samplers.computer to the platform file"
        yield Check(GROUP, "disk", Verdict.UNKNOWN, "no component of this platform checks it", advice)
        return
    if computer.is_simulated:
        yield Check(GROUP, "disk", Verdict.OK, "none: simulated")
    else:
        yield from _disk(computer)
    yield _clock(readings, computer)
    for number, link in enumerate(computer.links, start=1):
        yield _port("port" if number == 1 else f"port {number}", link)


def _disk(computer: ComputerState) -> Iterator[Check]:
    free_mb, speed = computer.disk_free_mb, computer.disk_write_mb_s
    free = f"{free_mb / 1000.0:.1f} GB free" if free_mb >= 1000.0 else f"{free_mb:.0f} MB free"
    if computer.disk_problem:
        advice = "give this user the right to write there, or name another folder with --out"
        yield Check(GROUP, "disk", Verdict.RED, computer.disk_problem, advice)
    elif free_mb < LEAST_FREE_MB:
        yield Check(GROUP, "disk", Verdict.RED, free, "move old logs elsewhere")
    elif free_mb < LITTLE_FREE_MB:
        yield Check(GROUP, "disk", Verdict.WARNING, free, "move old logs elsewhere before long flights")
    else:
        yield Check(GROUP, "disk", Verdict.OK, free)
    if not computer.disk_problem:
        found = f"writes {speed:.1f} MB/s" if speed > 0.0 else "its speed could not be measured"
        advice = "pictures may be lost: take a faster card or disk"
        verdict = Verdict.UNKNOWN if speed <= 0.0 else Verdict.OK
        if 0.0 < speed < LITTLE_WRITE_MB_S:
            verdict = Verdict.RED if speed < LEAST_WRITE_MB_S else Verdict.WARNING
        is_slow = verdict in (Verdict.RED, Verdict.WARNING)
        yield Check(GROUP, "disk speed", verdict, found, advice if is_slow else "")
    if computer.log_problem:
        advice = "free disk space, then restart gloc3 onboard: this flight would not be recorded"
        yield Check(GROUP, "log", Verdict.RED, computer.log_problem, advice)
    else:
        yield _log(computer)


def _log(computer: ComputerState) -> Check:
    """How fast the log grows, and how long the disk has room for it."""
    mb_per_min = computer.log_mb_per_min
    if mb_per_min <= 0.0:
        return Check(GROUP, "log", Verdict.OK, "is being written")
    minutes = computer.disk_free_mb / mb_per_min
    room = f"{minutes:.0f} min" if minutes < 120.0 else f"{minutes / 60.0:.0f} h"
    finding = f"is being written: {mb_per_min:.1f} MB/min, room for {room}"
    if minutes >= LITTLE_LOG_MIN:
        return Check(GROUP, "log", Verdict.OK, finding)
    advice = "free disk space, or record fewer topics (`log:` of the platform file)"
    return Check(GROUP, "log", Verdict.RED if minutes < LEAST_LOG_MIN else Verdict.WARNING, finding, advice)


def _clock(readings: Readings, computer: ComputerState) -> Check:
    """The computer's clock against the autopilot's, which has it from GPS."""
    theirs = readings.setup.utc_minus_t_s if readings.setup is not None else None
    ours = computer.utc_minus_t_s
    if theirs is None or ours is None:
        return Check(GROUP, "clock", Verdict.UNKNOWN, "the autopilot has sent no time of day to compare with")
    offset_s = ours - theirs
    if abs(offset_s) > CLOCKS_AGREE_S:
        finding = f"{abs(offset_s):.1f} s {'ahead of' if offset_s > 0.0 else 'behind'} the autopilot's"
        return Check(GROUP, "clock", Verdict.WARNING, finding, "set it (timedatectl), or logs cannot be compared")
    return Check(GROUP, "clock", Verdict.OK, f"agrees with the autopilot's within {abs(offset_s):.1f} s")


def _port(name: str, link: LinkCondition) -> Check:
    if link.intruder:
        finding, _, advice = link.intruder.partition("; ")
        return Check(GROUP, name, Verdict.RED, f"{link.url}: {finding}", advice)
    if not link.problem:
        return Check(GROUP, name, Verdict.OK, f"{link.url} is open")
    return Check(GROUP, name, Verdict.WARNING, f"{link.url}: {link.problem}", port_advice(link.problem))
