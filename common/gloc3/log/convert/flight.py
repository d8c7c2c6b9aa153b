"""The flight in a log, pose by pose, with its geographic position and what the autopilot reported then."""

from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.log.reader import LogReader
from gloc3.log.report.flight_path import POSE, TRUTH, read_flight_path, value_of
from gloc3.messages.frames import IDENTITY, GeoPoint, Quaternion, TangentPlane, Vector3
from gloc3.messages.vehicle import AutopilotState, ImageRecorded

SOURCES: Final = (POSE, TRUTH)
"""The topics that a flight may be read from; the first that is recorded is taken."""


class FlightSample(msgspec.Struct, frozen=True, kw_only=True):
    """The vehicle at one time."""

    t_s: float
    """Since boot of the clock host."""
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    ned_from_frd: Quaternion
    is_valid: bool
    geo: GeoPoint | None
    """None where the frame has no origin on Earth."""
    autopilot: AutopilotState | None
    """Its last state until then."""


class FlightMark(msgspec.Struct, frozen=True):
    """A named place of the flight."""

    name: str
    t_s: float | None
    position_ned_m: Vector3
    geo: GeoPoint | None


class RecordedFlight(msgspec.Struct, frozen=True):
    """One flight."""

    platform: str
    mission: str
    topic: str
    """The topic that the samples are from."""
    samples: list[FlightSample]
    requested: list[FlightMark]
    """Corners of the path requested by the mission."""
    marks: list[FlightMark]
    """Home, and where pictures were taken."""
    utc_offset_s: float | None
    """From the log's times to UTC, in seconds since 1970; None where the log does not say."""

    @property
    def stretches(self) -> list[list[FlightSample]]:
        """The samples with a valid pose, parted where it was not valid."""
        found: list[list[FlightSample]] = [[]]
        for sample in self.samples:
            if sample.is_valid:
                found[-1].append(sample)
            elif found[-1]:
                found.append([])
        return [stretch for stretch in found if stretch]


def read_flight(reader: LogReader, origin: GeoPoint | None = None) -> RecordedFlight:
    """Reads the flight of a log.

    Args:
        reader: the log.
        origin: the origin of its NED frame, where the log has none.

    Raises:
        Refused: no pose is recorded in it.
    """
    reader.require_ours("position", *SOURCES)
    recorded = {topic.partition("/")[2] for topic in reader.topics}
    topic = next(topic for topic in SOURCES if topic in recorded)
    samples: list[FlightSample] = []
    pictures: list[tuple[str, float, Vector3]] = []
    planes: dict[GeoPoint, TangentPlane] = {}
    plane: TangentPlane | None = planes.setdefault(origin, TangentPlane(origin)) if origin is not None else None
    autopilot: AutopilotState | None = None
    for _, envelope in reader.entries(topic, "autopilot", "image_recorded"):
        message = envelope.payload
        if isinstance(message, AutopilotState):
            autopilot = message
        elif isinstance(message, ImageRecorded):
            pictures.append((message.file, envelope.t_s, message.position_ned_m))
        elif (position := value_of(message, "position_ned_m")) is not None:
            known = value_of(message, "origin_geo")
            if known is not None:
                point = GeoPoint(*known)
                plane = planes.get(point) or planes.setdefault(point, TangentPlane(point))
            samples.append(
                FlightSample(
                    t_s=envelope.t_s,
                    position_ned_m=tuple(position),
                    velocity_ned_m_s=tuple(value_of(message, "velocity_ned_m_s") or (0.0, 0.0, 0.0)),
                    ned_from_frd=tuple(value_of(message, "ned_from_frd") or IDENTITY),
                    is_valid=value_of(message, "is_valid") is not False,
                    geo=plane.geo_from_ned(tuple(position)) if plane is not None else None,
                    autopilot=autopilot,
                )
            )
    if not samples:
        raise Refused(f"{reader.path}: no position was recorded")
    path = read_flight_path(reader)

    def mark(name: str, t_s: float | None, position_ned_m: Vector3) -> FlightMark:
        return FlightMark(name, t_s, position_ned_m, plane.geo_from_ned(position_ned_m) if plane is not None else None)

    home = [mark("home", None, path.home)] if path.home is not None else []
    return RecordedFlight(
        platform=reader.platform,
        mission=path.mission,
        topic=topic,
        samples=samples,
        requested=[mark(str(index), None, point) for index, point in enumerate(path.requested, start=1)],
        marks=home + [mark(*picture) for picture in pictures],
        utc_offset_s=reader.utc_offset_ns / 1e9 if reader.utc_offset_ns else None,
    )
