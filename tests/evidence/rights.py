"""Who may what: each role tries each kind of request at a real onboard process in flight, over two routers."""

import asyncio
import tempfile
from pathlib import Path
from typing import Final

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.rights_trial import ROLES, Cell, run

ALL: Final = tuple(ROLES)
FLYING: Final = ("alice", "erin", "carol")
PERMITTED: Final = {
    "look": ALL,
    "hold control": (*FLYING, "mike"),
    "load a mission that flies somewhere": ("alice", "carol"),
    "load a mission that lands": FLYING,
    "load a mission without a geofence": FLYING,
    "emergency hold": FLYING,
    "disarm in flight (not confirmed)": FLYING,
    "change a component's rate": ("mike",),
    "end the log": (*FLYING, "mike"),
    "take over": ("carol",),
    "give a role": ("carol",),
    "take a role back": ("carol",),
}
"""By request: the members who have the right to it."""
SHOWN: Final = (("alice", "take over"), ("erin", "load a mission that flies somewhere"), ("bob", "emergency hold"))


def _try() -> list[Cell]:
    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(run(Path(folder)))


def rights(progress: Progress) -> list[Figure]:
    """All cells of the table."""
    cells = msgspec.convert(progress.part("trial", _try), list[Cell])
    answers = {(cell.member, cell.what): cell.answer for cell in cells}
    figures = [Figure("member: role", "; ".join(f"{member}: {role}" for member, role in ROLES.items()))]
    for what, wanted in PERMITTED.items():
        found = tuple(cell.member for cell in cells if cell.what == what and cell.is_permitted)
        figures.append(Figure(what, _names(found), _names(wanted), found == wanted))
    figures.append(Figure("requests", str(len(cells)), str(len(ROLES) * len(PERMITTED)), len(answers) == len(cells)))
    return [*figures, *(Figure(f"{member}, {what}: the answer", answers[member, what]) for member, what in SHOWN)]


def _names(members: tuple[str, ...]) -> str:
    return "everyone" if members == ALL else ", ".join(members) or "nobody"


BARS: Final = (
    Bar(
        "rights",
        "Each role can do what it has the right to, and nothing else",
        "A vehicle is in flight. Its onboard process is connected to one router process, its stations to another "
        "below it. Each member of the network tries each kind of request, with our own client and its own "
        "certificate. A request counts as permitted if it is accepted, or refused for a reason other than rights (a "
        "disarming that is not confirmed). An observer's commands stop at the first router and get no answer.",
        rights,
    ),
)
