"""Checks that the ways of several vehicles keep the platforms' separation, in space or in time.

Every leg is taken as a whole for its time window: where two vehicles may be on two legs at the same time, the legs
themselves have to keep the separation. Windows are the estimate's, widened for what an estimate cannot know. So a mission
without findings keeps the separation as long as the estimate holds within that width; a finding need not come true.
Vehicles on the ground are left out.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final, NamedTuple

from msgspec import structs

from gloc3.errors import Finding
from gloc3.messages.frames import Vector3
from gloc3.mission.checking.estimate import MissionEstimate
from gloc3.mission.model.model import EACH, Mission, where_of
from gloc3.mission.model.structure import PartialOrder
from gloc3.platform.limits import Limits

SPREAD: Final = 0.25
"""Share by which a time of the estimate may be wrong, either way."""
START_S: Final = 10.0
"""Vehicles may start so much earlier or later than each other."""


@dataclass(frozen=True, slots=True)
class VehiclePath:
    """A vehicle's part of a mission with its estimate; positions of all vehicles are in one NED."""

    name: str
    mission: Mission
    estimate: MissionEstimate
    limits: Limits
    home_ned_m: Vector3 | None = None
    """None where it is not known: ways from and to home are then left out."""


class _TimedLeg(NamedTuple):
    target: str
    start: Vector3
    end: Vector3
    from_s: float
    until_s: float


class _Conflict(NamedTuple):
    names: tuple[str, str]
    first: _TimedLeg
    second: _TimedLeg
    distance_m: float


def separation_findings(paths: Sequence[VehiclePath], whole: Mission) -> Iterator[Finding]:
    """Where two vehicles may come nearer to each other than the larger separation of their platforms.

    Args:
        paths: of all vehicles.
        whole: the mission of all, for the order between tasks of different vehicles.
    """
    order = _order_of(whole)
    legs = {path.name: list(_timed_legs(path, order, whole)) for path in paths}
    for one, other in combinations(paths, 2):
        separation_m = max(one.limits.separation_m, other.limits.separation_m)
        if separation_m <= 0.0:
            continue
        up_m = max(path.limits.separation_up_m for path in (one, other) if path.limits.separation_m > 0.0)
        nearest: dict[tuple[str, str], _Conflict] = {}
        for first in legs[one.name]:
            for second in legs[other.name]:
                is_apart = first.until_s < second.from_s or second.until_s < first.from_s
                if is_apart or _is_ordered(order, first.target, second.target):
                    continue
                found = _Conflict(
                    (one.name, other.name), first, second, _distance_m(first, second, separation_m / up_m)
                )
                known = nearest.get((first.target, second.target))
                if found.distance_m < separation_m and (known is None or found.distance_m < known.distance_m):
                    nearest[first.target, second.target] = found
        for found in nearest.values():
            yield from _finding(found, separation_m, up_m, whole)


def _finding(found: _Conflict, separation_m: float, up_m: float, whole: Mission) -> Iterator[Finding]:
    if whole.document is None:
        return
    (one, other), first, second, found_m = found
    begin_s, end_s = max(first.from_s, second.from_s, 0.0), min(first.until_s, second.until_s)
    when = f"between {begin_s:.0f} and {end_s:.0f} s" if end_s < math.inf else f"from {begin_s:.0f} s on"
    at = "" if math.isclose(up_m, separation_m) else f" ({up_m:g} m up and down)"
    message = (
        f"{one} ({first.target}) and {other} ({second.target}) may come within {found_m:.1f} m of each other {when}; "
        f"the separation is {separation_m:g} m{at}"
    )
    higher_m = max(-first.start[2], -first.end[2]) - min(-second.start[2], -second.end[2]) + up_m
    hints = [f"fly {second.target} {math.ceil(10.0 * higher_m) / 10.0:g} m higher"]
    if first.until_s < math.inf:
        hints.insert(0, f"start {second.target} {math.ceil((first.until_s - second.from_s) / (1.0 - SPREAD))} s later")
    hints.append(f"put it after {first.target.partition('.')[0]}")
    yield whole.document.finding(where_of(second.target), message, ", or ".join(hints), at_key=True)


def _order_of(whole: Mission) -> PartialOrder:
    """The order between tasks of different vehicles; what each vehicle does for itself orders nobody else."""
    tasks = {name: task for name, task in whole.tasks.items() if task.options.platform != EACH}
    kept = {
        name: replace(
            task,
            options=structs.replace(task.options, after=tuple(one for one in task.options.after if one in tasks)),
        )
        for name, task in tasks.items()
    }
    return PartialOrder.of(replace(whole, tasks=kept))


def _is_ordered(order: PartialOrder, one: str, other: str) -> bool:
    return one in order.ended and other in order.ended and not order.may_overlap(one, other)


def _timed_legs(path: VehiclePath, order: PartialOrder, whole: Mission) -> Iterator[_TimedLeg]:
    """The legs of a vehicle, and its stays in the air between them, with their windows.

    A time for which it waits for another vehicle is not in its estimate: from there on its windows have no end.
    """
    actions, least = path.mission.actions(), (path.estimate.least or path.estimate).actions
    found: list[tuple[float, float, str, Vector3, Vector3, bool]] = []
    moving = [(target, part) for target, part in path.estimate.actions.items() if part.legs]
    for target, part in sorted(moving, key=lambda one: one[1].start_s):
        at_s, is_repeated = part.start_s, part.once_s < 0.99 * (part.end_s - part.start_s)
        for index, leg in enumerate(part.legs):
            until_s = part.end_s if is_repeated or index == len(part.legs) - 1 else at_s + leg.duration_s
            is_last = actions[target].order.ends_flight and index == len(part.legs) - 1
            found.append((part.start_s if is_repeated else at_s, until_s, target, leg.start, leg.end, is_last))
            at_s += leg.duration_s
    if path.home_ned_m is None:
        found = [one for one in found if not (_is_at_home(one[3]) or _is_at_home(one[4]))]
    waits_s = min(
        (part.start_s for target, part in path.estimate.actions.items() if _awaits_another(target, order, whole, path)),
        default=math.inf,
    )
    earlier_s = {
        target: max(0.0, path.estimate.actions[target].start_s - least[target].start_s) for target, *_ in moving
    }
    for index, (from_s, until_s, target, start, end, is_last) in enumerate(found):
        stays_s = until_s
        if not is_last and index + 1 < len(found):
            stays_s = max(until_s, found[index + 1][0])
        low_s = (from_s - earlier_s[target]) * (1.0 - SPREAD) - START_S
        high_s = math.inf if stays_s >= waits_s else stays_s * (1.0 + SPREAD) + START_S
        yield _TimedLeg(target, start, end, low_s, high_s)


def _is_at_home(place_ned_m: Vector3) -> bool:
    """Whether a place is where the estimate puts a home that is not known."""
    return math.hypot(*place_ned_m[:2]) < 1e-6


def _awaits_another(target: str, order: PartialOrder, whole: Mission, path: VehiclePath) -> bool:
    """Whether an action begins only when another vehicle's has ended."""
    earlier: frozenset[str] = order.ended.get(target, frozenset())
    performers = {whole.tasks[one.partition(".")[0]].options.performer for one in earlier}
    return bool(performers - {path.name})


def _distance_m(one: _TimedLeg, other: _TimedLeg, scale: float) -> float:
    """Least distance of two legs, heights counted `scale` times."""
    ends = [(north, east, down * scale) for north, east, down in (one.start, one.end, other.start, other.end)]
    return segments_m(*ends)


def segments_m(a: Vector3, b: Vector3, c: Vector3, d: Vector3) -> float:
    """Least distance of the segments a to b and c to d (Ericson, Real-Time Collision Detection, 5.1.9)."""
    u, v, w = _minus(b, a), _minus(d, c), _minus(a, c)
    uu, vv, uv, uw, vw = _dot(u, u), _dot(v, v), _dot(u, v), _dot(u, w), _dot(v, w)
    if uu < 1e-12 and vv < 1e-12:
        return math.dist(a, c)
    if uu < 1e-12:
        s, t = 0.0, _clamped(vw / vv)
    elif vv < 1e-12:
        s, t = _clamped(-uw / uu), 0.0
    else:
        area = uu * vv - uv * uv
        s = _clamped((uv * vw - uw * vv) / area) if area > 1e-12 else 0.0
        t = (uv * s + vw) / vv
        if not 0.0 <= t <= 1.0:
            t = _clamped(t)
            s = _clamped((uv * t - uw) / uu)
    near = (a[0] + s * u[0], a[1] + s * u[1], a[2] + s * u[2])
    return math.dist(near, (c[0] + t * v[0], c[1] + t * v[1], c[2] + t * v[2]))


def _minus(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _clamped(share: float) -> float:
    return min(max(share, 0.0), 1.0)
