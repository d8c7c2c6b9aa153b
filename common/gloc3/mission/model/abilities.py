"""Abilities of a platform: the capabilities that its file declares, and those that follow from them.

A pattern such as `survey` is flown by whatever follows waypoints; `depart` is whichever way of setting off the platform
has. So a mission that says only these is the same for a multirotor, a boat, a rover and a submarine.
"""

from collections.abc import Mapping
from typing import Final

import msgspec

from gloc3.component.deployment import ComponentRow
from gloc3.errors import Gloc3Error
from gloc3.mission.model.arguments import argument_kinds
from gloc3.mission.model.model import FLY_FILE, FLY_PLAN
from gloc3.mission.model.patterns import ARRIVE, Depart, Pattern
from gloc3.platform.platform import Capability, Platform

WAIT: Final[Mapping[str, Capability]] = {"wait": Capability(arguments="wait", performed_by="")}
"""What the executor does itself."""
_DEPARTURES: Final = ("take_off", "dive", "drive_off")
"""Kinds of setting off; the first that a platform has, and that leads to its survey height, is how it departs."""
ARMING: Final = frozenset((*_DEPARTURES, "depart"))
"""Kinds of actions that arm the vehicle where it is not."""


def abilities(platform: Platform) -> Mapping[str, Capability]:
    """The rows by name: declared ones go before those that follow from others."""
    declared = platform.capabilities
    found = dict(WAIT)
    by_kind = {row.arguments: name for name, row in reversed(declared.items())}
    for name, kind in argument_kinds().items():
        if issubclass(kind, Pattern) and "follow_waypoints" in by_kind:
            found[name] = _as(declared, by_kind["follow_waypoints"], name)
        elif issubclass(kind, Depart) and (setting_off := departure(platform)) in by_kind:
            found[name] = _as(declared, by_kind[setting_off], name)
    if {"return_home", "land"} <= by_kind.keys():
        found[ARRIVE] = _as(declared, by_kind["land"], ARRIVE)
    if FLY_PLAN in declared:
        found[FLY_FILE] = msgspec.structs.replace(declared[FLY_PLAN], arguments=FLY_FILE, performed_as=FLY_FILE)
    return found | declared


def nameable(rows: Mapping[str, Capability]) -> dict[str, Capability]:
    """The rows that an action of a mission can name; plans of other programs are named by their task."""
    return {name: row for name, row in rows.items() if name != FLY_FILE}


def departure(platform: Platform) -> str:
    """The kind of setting off by which a platform departs; empty where it has none."""
    kinds = {row.arguments for row in platform.capabilities.values()}
    height_m = platform.limits.survey_height_m
    if height_m is not None and height_m <= 0.0:
        fitting = ("dive", "drive_off") if height_m < 0.0 else ("drive_off", "dive")
        return next((kind for kind in fitting if kind in kinds), "")
    return next((kind for kind in _DEPARTURES if kind in kinds), "")


def _as(declared: Mapping[str, Capability], name: str, kind: str) -> Capability:
    row = declared[name]
    return msgspec.structs.replace(row, arguments=kind, performed_as=row.performed_as or name)


def chooses_heading(row: ComponentRow) -> bool:
    """Whether what a component flies may point elsewhere than along its path; so where its class is not installed."""
    try:
        return bool(getattr(row.load_class(), "chooses_heading", True))
    except Gloc3Error:
        return True
