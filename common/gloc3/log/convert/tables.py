"""A log as a table: the flight with one row a pose, or all fields of one topic with one row a message."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from typing import Any

from gloc3.errors import Gloc3Error
from gloc3.log.convert.flight import RecordedFlight
from gloc3.log.fields import flatten
from gloc3.log.reader import LogReader
from gloc3.messages.frames import to_euler

Row = Mapping[str, Any]


def flight_rows(flight: RecordedFlight) -> list[Row]:
    """One row a pose: SI units, angles in degrees, empty cells where something is not known."""
    return [dict(_flight_cells(flight, index)) for index in range(len(flight.samples))]


def _flight_cells(flight: RecordedFlight, index: int) -> Iterator[tuple[str, Any]]:
    sample = flight.samples[index]
    yield "t_s", sample.t_s
    yield "utc_s", None if flight.utc_offset_s is None else sample.t_s + flight.utc_offset_s
    yield from zip(("north_m", "east_m", "down_m"), sample.position_ned_m, strict=True)
    yield from zip(("latitude_deg", "longitude_deg", "altitude_m"), sample.geo or (None, None, None), strict=True)
    yield from zip(("north_m_s", "east_m_s", "down_m_s"), sample.velocity_ned_m_s, strict=True)
    yield from zip(("roll_deg", "pitch_deg", "yaw_deg"), map(degrees, to_euler(sample.ned_from_frd)), strict=True)
    yield "is_valid", sample.is_valid
    state = sample.autopilot
    yield "is_armed", None if state is None else state.is_armed
    yield "mode", None if state is None else state.mode_name
    yield "battery_v", None if state is None else state.battery_v
    yield "battery_remaining", None if state is None or state.battery_remaining < 0.0 else state.battery_remaining


def topic_rows(reader: LogReader, topic: str) -> list[Row]:
    """One row a message: its time and publisher, and each field by its path, such as `position_ned_m[0]`."""
    return [
        {"t_s": t_s, "publisher": publisher, **flatten(message)} for publisher, t_s, message in reader.values(topic)
    ]


def _columns(rows: Sequence[Row]) -> list[str]:
    """The names of all rows' cells, in the order of their first appearance."""
    return list(dict.fromkeys(name for row in rows for name in row))


def to_csv(rows: Sequence[Row]) -> bytes:
    """Comma-separated values with a line of names (RFC 4180); `true` and `false` in lower case."""
    text = io.StringIO()
    writer = csv.DictWriter(text, _columns(rows))
    writer.writeheader()
    for row in rows:
        writer.writerow({name: str(value).lower() if isinstance(value, bool) else value for name, value in row.items()})
    return text.getvalue().encode()


def to_parquet(rows: Sequence[Row]) -> bytes:
    """An Apache Parquet file, compressed with zstd; a column whose values are of several types becomes text.

    Raises:
        Gloc3Error: pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        from pyarrow.parquet import write_table
    except ModuleNotFoundError as error:
        raise Gloc3Error('Parquet needs pyarrow; install it with: pip install "gloc3[logs]"') from error
    columns = {name: _column([row.get(name) for row in rows]) for name in _columns(rows)}
    out = io.BytesIO()
    write_table(pa.table(columns), out, compression="zstd")
    return out.getvalue()


def _column(values: list[Any]) -> list[Any]:
    """Values of one type: numbers as floats where any is one, text where they are of several types."""
    kinds = {type(value) for value in values if value is not None}
    if kinds == {int, float}:
        return [None if value is None else float(value) for value in values]
    if len(kinds) > 1:
        return [None if value is None else str(value) for value in values]
    return values
