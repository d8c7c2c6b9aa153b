"""The path flown and the path requested, from a log."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, Final

import msgspec

from gloc3.errors import UNREADABLE
from gloc3.log.reader import LoggedMessage, LogReader
from gloc3.log.record import MISSION, REQUESTED_PATH
from gloc3.messages.frames import Vector3
from gloc3.mission.model.fence import Fence

TRUTH: Final = "sim/truth"
"""What a simulated vehicle really did; where it is recorded, it is the path flown."""
POSE: Final = "pose"
POSITIONS: Final = (TRUTH, POSE)
"""The topics that a path may be read from."""
LOOK_AHEAD_M: Final = 2.0
"""How much of the requested path a sample may advance at once."""


class FlightPath(msgspec.Struct, frozen=True):
    """One flight, in metres north, east and down of the origin of the platform's frame."""

    flown: list[Vector3]
    source: str
    """The topic that `flown` is from."""
    requested: list[Vector3]
    """Empty where no mission was flown."""
    home: Vector3 | None = None
    """Where the vehicle stood when it was armed first; without word of that, where the flight began."""
    fence: Fence | None = None
    mission: str = ""
    """The mission's name."""


def read_flight_path(reader: LogReader) -> FlightPath:
    """Collects the data for a plot of the flight."""
    source = TRUTH if any(topic.partition("/")[2] == TRUTH for topic in reader.topics) else POSE
    flown: list[Vector3] = []
    home: Vector3 | None = None
    fence: Fence | None = None
    for entry in reader.entries(source, "motion/home", "motion/limits"):
        payload = entry.envelope.payload
        match entry.envelope.topic.partition("/")[2]:
            case "motion/home":
                home = home or next(_positions(entry), None)
            case "motion/limits":
                fence = _fence(payload) or fence
            case _:
                flown += _positions(entry)
    return FlightPath(
        flown=flown,
        source=source,
        requested=_requested(reader),
        home=home or (flown[0] if flown else None),
        fence=fence,
        mission=(reader.metadata(MISSION) or {}).get("name", ""),
    )


def value_of(payload: Any, name: str) -> Any:
    """A field of a message, or of the dictionary that represents a message of unknown type."""
    return payload.get(name) if isinstance(payload, dict) else getattr(payload, name, None)


def _positions(entry: LoggedMessage) -> Iterator[Vector3]:
    position = value_of(entry.envelope.payload, "position_ned_m")
    if position is not None and value_of(entry.envelope.payload, "is_valid") is not False:
        yield tuple(position)


def _fence(limits: Any) -> Fence | None:
    fence = value_of(limits, "fence")
    try:
        return msgspec.convert(fence, Fence | None, from_attributes=True)
    except msgspec.ValidationError:
        return None


def _requested(reader: LogReader) -> list[Vector3]:
    text = (reader.metadata(REQUESTED_PATH) or {}).get("points_ned_m", "[]")
    try:
        return msgspec.json.decode(text, type=list[Vector3])
    except UNREADABLE:
        return []


def distances_along(path: Sequence[Vector3], requested: Sequence[Vector3]) -> list[float]:
    """How far along the requested path each point of a flight is, in metres; it never goes back.

    Without a requested path it is the distance flown.
    """
    if len(requested) < 2:
        flown = [0.0]
        for a, b in pairwise(path):
            flown.append(flown[-1] + math.dist(a, b))
        return flown[: len(path)]
    starts = [0.0]
    for a, b in pairwise(requested):
        starts.append(starts[-1] + math.dist(a, b))
    found: list[float] = []
    reached = 0.0
    for point in path:
        reached = _nearest(point, requested, starts, reached)
        found.append(reached)
    return found


def _nearest(point: Vector3, path: Sequence[Vector3], starts: Sequence[float], reached: float) -> float:
    """Nearest position on the path, not before `reached` and not far after it."""
    best, at = math.inf, reached
    limit = reached + LOOK_AHEAD_M
    for index in range(len(path) - 1):
        begin, end = starts[index], starts[index + 1]
        if end < reached or begin > limit or end == begin:
            continue
        a, b, length = path[index], path[index + 1], end - begin
        dot = sum((p - q) * (r - q) for p, q, r in zip(point, a, b, strict=True))
        along = min(max(dot / length, reached - begin, 0.0), limit - begin, length)
        place = tuple(q + (r - q) * along / length for q, r in zip(a, b, strict=True))
        distance = math.dist(point, place)
        if distance < best - 1e-9:
            best, at = distance, begin + along
    return at
