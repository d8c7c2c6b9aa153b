"""The packages that an installation of GLOC3 brings: those it requires, and theirs, from installed metadata."""

import re
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from tests.house.notice import ROOT

LOCK: Final = ROOT / "requirements.txt"
VEHICLE: Final = ("gpio", "groundstation", "laser")
"""Extras of the packages for vehicles: all that have wheels for aarch64 and need no screen."""


def closure(extras: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Each package that `gloc3[extras]` brings here, itself included, with those that it requires.

    Packages whose markers do not hold for this Python and computer, or that are not installed, are left out.

    Args:
        extras: of GLOC3.
    """
    found: dict[str, tuple[str, ...]] = {}
    open_ones = [("gloc3", frozenset(extras))]
    done = set[tuple[str, frozenset[str]]]()
    while open_ones:
        name, wanted = open_ones.pop()
        if (name, wanted) in done:
            continue
        done.add((name, wanted))
        try:
            stated = requires(name) or []
        except PackageNotFoundError:
            continue
        needed = [one for one in map(Requirement, stated) if _holds(one, wanted)]
        found[name] = tuple(sorted({*found.get(name, ()), *(canonicalize_name(one.name) for one in needed)}))
        open_ones += [(canonicalize_name(one.name), frozenset(one.extras)) for one in needed]
    return {name: tuple(one for one in needs if one in found) for name, needs in found.items()}


def _holds(requirement: Requirement, extras: Iterable[str]) -> bool:
    marker = requirement.marker
    return marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *extras))


def locked(names: Iterable[str], lock: Path = LOCK) -> str:
    """The part of the lock for some packages, with every version, marker and hash.

    Args:
        names: of packages, in their canonical form.
        lock: the whole.
    """
    wanted, entries = set(names), re.split(r"^(?=[a-z0-9])", lock.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return "".join(entry for entry in entries if entry.partition("==")[0].partition("[")[0] in wanted)
