"""Converts a log to a file of another program, by the name of its format."""

from collections.abc import Callable, Mapping
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import Final

from gloc3.cli.counting import counted
from gloc3.errors import Gloc3Error, Refused
from gloc3.log.convert.flight import RecordedFlight, read_flight
from gloc3.log.convert.maps import geojson, gpx, kml
from gloc3.log.convert.rosbag2 import write_bag
from gloc3.log.convert.tables import flight_rows, to_csv, to_parquet, topic_rows
from gloc3.log.info import require_topic
from gloc3.log.reader import LogReader
from gloc3.messages.frames import GeoPoint
from gloc3.messages.perception import OccupancyMap
from gloc3.terrain import write_map


class LogFormat(StrEnum):
    """What a log can be converted to."""

    KML = "kml"
    GPX = "gpx"
    GEOJSON = "geojson"
    CSV = "csv"
    PARQUET = "parquet"
    ROSBAG2 = "rosbag2"
    MAP = "map"


MAPS: Final[Mapping[LogFormat, Callable[[RecordedFlight, str], bytes]]] = {
    LogFormat.KML: kml,
    LogFormat.GPX: gpx,
    LogFormat.GEOJSON: geojson,
}


def convert(
    reader: LogReader, to: LogFormat, out: Path | None = None, topic: str = "", origin: GeoPoint | None = None
) -> str:
    """Writes a log in another format; returns a line that says what was written.

    Args:
        reader: the log.
        to: the format.
        out: the file, the folder of a bag, or the YAML file of a map; by default beside the log, under its name.
        topic: for tables: its fields, instead of the flight.
        origin: the origin of the log's NED frame, where the log has none.

    Raises:
        Gloc3Error: a library is missing, or the file cannot be written.
        Refused: the log lacks what the format needs, or the file exists already.
    """
    if topic and to not in (LogFormat.CSV, LogFormat.PARQUET):
        raise Refused(f"--topic is for tables (csv, parquet), not for {to}")
    if to is LogFormat.ROSBAG2:
        target = out or reader.path.with_name(f"{reader.path.stem}-ros2")
        try:
            return f"{target}: {write_bag(reader, target):,} messages"
        except OSError as error:
            raise Gloc3Error(f"cannot write {target}: {error.strerror}") from error
    if to is LogFormat.MAP:
        target = out or reader.path.with_name(f"{reader.path.stem}-map.yaml")
        return f"{target}: {_save_map(reader, target)}"
    if to in MAPS:
        data, what = _map(reader, to, origin)
    else:
        data, what = _table(reader, to, topic, origin)
    name = f"{reader.path.stem}-{topic.strip('/').replace('/', '-')}" if topic else reader.path.stem
    target = out or reader.path.with_name(f"{name}.{to}")
    try:
        with target.open("xb") as stream:
            stream.write(data)
    except FileExistsError:
        raise Refused(f"{target} exists already; choose another --out") from None
    except OSError as error:
        raise Gloc3Error(f"cannot write {target}: {error.strerror}") from error
    return f"{target}: {what}"


def _save_map(reader: LogReader, target: Path) -> str:
    """Writes the last map of a flight, of what is free and what is occupied; says how large it is."""
    reader.require_ours("map of obstacles")
    last: OccupancyMap | None = None
    for _, envelope in reader.entries("map"):
        last = envelope.payload if isinstance(envelope.payload, OccupancyMap) else last
    if last is None or not last.levels:
        raise Refused(
            f"{reader.path}: no map was recorded; a platform with the component map, such as pelican, builds one"
        )
    try:
        files = write_map(target, last)
    except ValueError as error:
        raise Refused(f"{reader.path}: {error}") from error
    sides = f"{last.rows * last.cell_m:.1f} x {last.columns * last.cell_m:.1f} m"
    return f"{sides}, {counted(len(files) - 1, 'layer')} of {last.layer_m:g} m"


def _map(reader: LogReader, to: LogFormat, origin: GeoPoint | None) -> tuple[bytes, str]:
    flight = read_flight(reader, origin)
    return MAPS[to](flight, str(reader.path)), f"{len(flight.samples):,} poses"


def _table(reader: LogReader, to: LogFormat, topic: str, origin: GeoPoint | None) -> tuple[bytes, str]:
    rows = topic_rows(reader, require_topic(reader, topic)) if topic else flight_rows(read_flight(reader, origin))
    return to_csv(rows) if to is LogFormat.CSV else to_parquet(rows), f"{len(rows):,} rows"


def read_origin(text: str) -> GeoPoint:
    """Reads an origin `LATITUDE,LONGITUDE,ALTITUDE`.

    Raises:
        Refused: it cannot be read, or lies outside the ranges.
    """
    try:
        latitude, longitude, altitude = map(float, text.split(","))
    except ValueError:
        raise Refused(f"--origin {text!r} cannot be read; its form is LATITUDE,LONGITUDE,ALTITUDE, deg and m") from None
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and isfinite(altitude)):
        raise Refused(f"--origin {text}: the latitude is -90 to 90, the longitude -180 to 180 deg")
    return GeoPoint(latitude, longitude, altitude)
