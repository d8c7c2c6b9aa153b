"""Attacks on a vehicle's network in flight, over network namespaces: what is read, what is obeyed, what stands still."""

import asyncio
import tempfile
from pathlib import Path
from typing import Final

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.hostile_network import (
    ADDRESS,
    SPACES,
    STRANGER,
    Phase,
    Result,
    attacks_on,
    fly_and_attack,
    made_yard,
    spaces,
)
from tests.onboard.hosts.namespaces import missing

STILL_S: Final = 0.1
"""So long the vehicle's loop may publish nothing that is due, s."""
JOINED_S: Final = 2.0
GROWN_MB: Final = 100.0
STRANGERS: Final = (
    "without encryption",
    "without a certificate",
    "operator's name, other authority",
    "operator's certificate, expired",
    "operator's certificate, not yet valid",
    "scouting by multicast",
    "a member that was revoked by a pushed list",
)
"""Who may read nothing."""
BUSY: Final = 4.0
"""Load from which the figures are disturbed by other programs on a computer of two cores."""


def _fly() -> Result:
    if lack := missing():
        raise RuntimeError(lack)
    with tempfile.TemporaryDirectory() as name, spaces():
        folder = Path(name)
        yard = made_yard(folder)
        return fly_and_attack(folder, yard, asyncio.run(attacks_on(yard, folder)))


def hostile(progress: Progress) -> list[Figure]:
    """All attacks, and the flight."""
    found = msgspec.convert(progress.part("flight", _fly), Result)
    figures = [_figure(phase) for phase in found.phases]
    accepted = ", ".join(f"{author}: {number}" for author, number in found.accepted.items())
    load = max(phase.load for phase in found.phases)
    return [
        *figures,
        Figure("accepted commands, by member", accepted, "alice alone", set(found.accepted) == {"alice"}),
        Figure("commands of others that a component carried out", str(found.set_rates), "0", found.set_rates == 0),
        Figure("the operator's mission at the end", found.mission, "running", found.mission == "running"),
        Figure("contacts that the operator's station has lost", str(found.lost), "0", found.lost == 0),
        Figure(
            "open sockets of the onboard process",
            ", ".join(found.open_sockets),
            f"tcp {ADDRESS}",
            found.open_sockets == [f"tcp {ADDRESS}"],
        ),
        Figure(
            "the vehicle's events about what came too often",
            "; ".join(found.refused),
            f"one names {SPACES[STRANGER]}",
            any(text.startswith(f"refused {SPACES[STRANGER]}: ") for text in found.refused),
        ),
        Figure(
            "load of the computer (two cores)",
            f"{load:.1f}{': disturbed by other programs' if load > BUSY else ''}",
        ),
    ]


def _figure(phase: Phase) -> Figure:
    outcome, still = phase.outcome, phase.stalled_s <= STILL_S
    if phase.name.startswith("…"):
        is_met = outcome.read > 0 and outcome.note.endswith(" s") and float(outcome.note.split()[0]) <= JOINED_S
        return Figure(phase.name, f"hears the vehicle after {outcome.note}", f"≤ {JOINED_S:.0f} s", is_met and still)
    parts = [f"stands still for {phase.stalled_s:.3f} s (a bare loop: {phase.bare_s:.3f} s)", f"sent: {outcome.sent:,}"]
    wanted = f"≤ {STILL_S} s"
    is_met = still
    if phase.name in STRANGERS:
        parts.append(f"read: {outcome.read}")
        wanted += ", reads nothing"
        is_met = is_met and outcome.read == 0
    if outcome.note:
        parts.append(outcome.note)
    if phase.grown_mb >= 1.0:
        parts.append(f"memory + {phase.grown_mb:.0f} MB")
        is_met = is_met and phase.grown_mb <= GROWN_MB
    return Figure(phase.name, "; ".join(parts), wanted, is_met)


BARS: Final = (
    Bar(
        "network-hostile",
        "No attack on the network stops a vehicle in flight",
        "A vehicle is in flight in a network namespace of its own; an operator flies it from a second one. Strangers attack "
        "from a third, members that have turned against it from the second, one after the other: each with real links, "
        "keys and bytes. Nobody but the operator is obeyed, and the vehicle's loop publishes its setpoints (every 0.05 s) "
        "at most 0.1 s late. How late a loop that does nothing was on the computer in the same time is beside it. [docs/network.md](../network.md#new-connections) describes how connections are accepted.",
        hostile,
    ),
)
