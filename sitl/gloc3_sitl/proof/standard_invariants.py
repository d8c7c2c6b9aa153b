"""The stack's own invariants, in the order in which they are reported."""

from collections.abc import Iterable
from typing import Final

from gloc3.errors import Refused, nearest
from gloc3_sitl.proof.command import (
    CommandsAtMostOnce,
    HoldIsObeyed,
    MotionHasOneOwner,
    NothingArmsByItself,
    SetpointOrHold,
)
from gloc3_sitl.proof.course import GoesOn, ItEnds, OnlyTableTransitions
from gloc3_sitl.proof.invariant import Invariant, load_invariants
from gloc3_sitl.proof.record import LogComplete, NoTraceback, OnlyNumbers
from gloc3_sitl.proof.space import AboveFloor, DoneTrulyPassed, InsideFence, PoseHonest

STANDARD: Final[tuple[type[Invariant], ...]] = (
    InsideFence,
    AboveFloor,
    SetpointOrHold,
    HoldIsObeyed,
    MotionHasOneOwner,
    NothingArmsByItself,
    CommandsAtMostOnce,
    OnlyTableTransitions,
    ItEnds,
    GoesOn,
    DoneTrulyPassed,
    PoseHonest,
    OnlyNumbers,
    NoTraceback,
    LogComplete,
)


def all_invariants() -> tuple[type[Invariant], ...]:
    """Returns these and those of installed packages.

    Raises:
        Gloc3Error: a package names something that is no invariant.
    """
    return load_invariants(STANDARD)


def invariants_but(names: Iterable[str]) -> tuple[type[Invariant], ...]:
    """Returns all invariants without those of these names.

    Raises:
        Refused: there is none of a name.
    """
    names = tuple(names)
    known = [kind.name for kind in all_invariants()]
    for name in names:
        if name not in known:
            raise Refused(f"no invariant {name!r}; {nearest(name, known)}")
    return tuple(kind for kind in all_invariants() if kind.name not in names)
