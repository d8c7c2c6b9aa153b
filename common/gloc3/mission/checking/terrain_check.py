"""Checks how high above the ground a mission's path is, by terrain tiles."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import ceil, dist
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.amounts import beside, excess
from gloc3.documents.document import Document
from gloc3.errors import Finding
from gloc3.messages.frames import TangentPlane, Vector3
from gloc3.mission.checking.space_check import PlacedLeg, name_of, place_of
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.model.arguments import LandOrder
from gloc3.mission.model.fence import TOLERANCE_M
from gloc3.mission.model.model import Mission, where_of
from gloc3.mission.reading.mission_site import MissionSite
from gloc3.terrain import tile_at

Floats = NDArray[np.float64]

STEP_M: Final = 5.0
"""Distance at which the ground below a path is read."""
STEPS_MAX: Final = 5_000
"""On one leg: a longer one is read less often."""
SHORT_M: Final = 1.0
"""A leg that is shorter is straight up, straight down, or a stay."""

_NO_LIMIT: Final = ", or state limits.ground_clearance_m in the platform file to have it refused"


class GroundProfile(NamedTuple):
    """Heights along the known part of a path."""

    along_m: Floats
    """Distance flown, shape (n,)."""
    path_m: Floats
    """Height of the path above the origin of NED, shape (n,)."""
    clearance_m: Floats
    """Height of the path above the ground, shape (n,); NaN where the ground is not known."""
    legs: Floats
    """Index of the leg that each place belongs to, shape (n,)."""
    places: Sequence[tuple[float, float]]
    """Latitude and longitude of each."""
    placed: Sequence[PlacedLeg]
    """The legs."""

    def lowest(self, document: Document) -> str:
        """Where the path is lowest above the ground, in words; the ground must be known somewhere."""
        index = int(np.nanargmin(self.clearance_m))
        placed = self.placed[int(self.legs[index])]
        place = place_of((*where_of(placed.target), placed.action.capability), placed.action, placed.leg, document)
        return f"{self.clearance_m[index]:.1f} m above it, on the way to {name_of(place)} of {placed.target}"


def ground_profile(path: Sequence[PlacedLeg], site: MissionSite | None) -> GroundProfile | None:
    """Heights along the path; None without terrain tiles or a place on Earth.

    Legs with an unknown end, departures, and landings are left out, and plans whose heights the autopilot keeps above the
    ground.
    """
    if site is None or site.ground is None or site.origin is None:
        return None
    plane = TangentPlane(site.origin)
    points: list[Vector3] = []
    legs: list[int] = []
    along_m: list[float] = []
    placed = [one for one in path if _is_judged(one)]
    total_m = 0.0
    for number, one in enumerate(placed):
        start = one.leg.start if one.is_start_known else one.leg.end
        count = min(STEPS_MAX, ceil(dist(start[:2], one.leg.end[:2]) / STEP_M))
        sampled = np.linspace(start, one.leg.end, count + 1 if count else 1).tolist()
        total_m += dist(points[-1], sampled[0]) if points else 0.0
        for point in sampled:
            total_m += dist(point, points[-1]) if points and legs[-1] == number else 0.0
            points.append((point[0], point[1], point[2]))
            legs.append(number)
            along_m.append(total_m)
    clearances_m, geo = site.ground.clearances_m(plane, points)
    return GroundProfile(
        np.array(along_m),
        -np.array([point[2] for point in points]),
        clearances_m,
        np.array(legs, np.float64),
        [place[:2] for place in geo],
        placed,
    )


def _is_judged(placed: PlacedLeg) -> bool:
    order, leg = placed.action.order, placed.leg
    if not placed.is_end_known or (isinstance(order, FlyFileOrder) and order.follows_ground):
        return False
    is_vertical = dist(leg.start[:2], leg.end[:2]) < SHORT_M
    lands = isinstance(order, LandOrder) or order.ends_flight
    return leg.waypoint is not None or not (is_vertical and (lands or order.begins_flight or leg.length_m == 0.0))


def terrain_findings(
    mission: Mission, profile: GroundProfile | None, site: MissionSite | None, least_m: float | None
) -> Iterator[Finding]:
    """Legs that come too near to the ground, each with its lowest place; and tiles that are missing.

    Args:
        mission: that is checked.
        profile: of its path.
        site: its place.
        least_m: the least height above the ground; None: what is below the ground is warned of.
    """
    document = mission.document
    if document is None or site is None:
        return
    if site.gap:
        message = f"heights above the ground are not checked: {site.gap}"
        yield document.finding(("tasks",), message, at_key=True, is_warning=True)
    if profile is None or site.ground is None:
        return
    missing: set[str] = set()
    starts = np.flatnonzero(np.diff(profile.legs, prepend=-1.0)).tolist()
    for placed, (begin, end) in zip(profile.placed, pairwise([*starts, len(profile.legs)]), strict=True):
        action = placed.action
        place = place_of((*where_of(placed.target), action.capability), action, placed.leg, document)
        heights_m = profile.clearance_m[begin:end]
        for index in np.flatnonzero(np.isnan(heights_m)).tolist():
            where = profile.places[begin + index]
            if (tile := tile_at(*where)) not in missing:
                missing.add(tile)
                message = f"heights above the ground are not checked there: {site.ground.terrain.gap(*where)}"
                yield document.finding(place, message, is_warning=True)
        if np.isnan(heights_m).all():
            continue
        lowest = int(np.nanargmin(heights_m))
        height_m = float(heights_m[lowest])
        missing_m = (least_m or 0.0) - height_m
        if missing_m <= TOLERANCE_M:
            continue
        message = name_of(place) if lowest == len(heights_m) - 1 else f"the path to {name_of(place)}"
        if height_m >= 0.0:
            message += f" is {beside(height_m, least_m or 0.0)} m above the ground"
        else:
            message += f" is {excess(-height_m)} m below the ground"
        if lowest < len(heights_m) - 1:
            message += f" at {profile.places[begin + lowest][0]:.6f}, {profile.places[begin + lowest][1]:.6f}"
        message += f"; the limit is {least_m:g} m" if least_m else ""
        hint = f"raise it by {excess(missing_m, is_enough=True)} m or more" + ("" if least_m is not None else _NO_LIMIT)
        yield document.finding(place, message, hint, is_warning=least_m is None)
