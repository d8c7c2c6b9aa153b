"""Logs of autopilots, PX4's ULog and ArduPilot's DataFlash, on the time axis of ours.

An autopilot counts from its own start. By how much that is off is found from the motion that both logs have; the
libraries of the autopilots' projects (pyulog, pymavlink's DFReader) read the files.
"""

import struct
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gloc3.errors import Finding, Gloc3Error, InputError, Refused, nearest

Floats = NDArray[np.float64]
GRID_S: Final = 0.05
"""Step with which motions are compared."""
LEAST_OVERLAP_S: Final = 5.0
LEAST_SPEED_M_S: Final = 0.05
"""Standard deviation of the speed below which a motion says nothing of its time."""
LEAST_CORRELATION: Final = 0.6
ULOG_MAGIC: Final = b"ULog\x01\x12\x35"
DATAFLASH_MAGIC: Final = b"\xa3\x95"
POSITIONS: Final[Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "vehicle_local_position": (("x", "y", "z"), ("vx", "vy", "vz")),
    "XKF1": (("PN", "PE", "PD"), ("VN", "VE", "VD")),
    "NKF1": (("PN", "PE", "PD"), ("VN", "VE", "VD")),
}
"""Messages with an estimator's position and velocity, north, east and down; the first that is there is taken."""


class MotionTrack(NamedTuple):
    """A motion: times in s, positions in m and velocities in m/s, north, east, down, one row a time."""

    t_s: Floats
    position_ned_m: Floats
    """Shape (n, 3)."""
    velocity_ned_m_s: Floats
    """Shape (n, 3)."""


class AutopilotLog(Protocol):
    """A log of an autopilot; times are seconds of its own clock."""

    form: str
    """What kind of file it is, for people."""

    @property
    def columns(self) -> Mapping[str, list[str]]:
        """The fields of each message."""

    def values(self, message: str, field: str) -> tuple[Floats, Floats]:
        """Times and values of a field that there is."""


class UlogFile:
    """A ULog of PX4."""

    form = "ULog of PX4"

    def __init__(self, path: Path) -> None:
        try:
            from pyulog import ULog
            from pyulog.exceptions import ULogException
        except ModuleNotFoundError as error:
            raise Gloc3Error('ULog files need pyulog; install it with: pip install "gloc3[logs]"') from error
        self._sets: dict[str, Mapping[str, Any]] = {}
        try:
            with path.open("rb") as stream:
                found = ULog(stream).data_list
        except ULogException as error:
            raise ValueError(str(error)) from error
        for one in found:
            self._sets[one.name if one.multi_id == 0 else f"{one.name}[{one.multi_id}]"] = one.data

    @property
    def columns(self) -> Mapping[str, list[str]]:
        """The fields of each message."""
        return {name: [field for field in data if field != "timestamp"] for name, data in self._sets.items()}

    def values(self, message: str, field: str) -> tuple[Floats, Floats]:
        """Times and values of a field that there is."""
        data = self._sets[message]
        return np.asarray(data["timestamp"], float) / 1e6, np.asarray(data[field], float)


class DataFlashFile:
    """A DataFlash log of ArduPilot; of several instances of a message (column C, I or Instance) the first is taken."""

    form = "DataFlash log of ArduPilot"

    def __init__(self, path: Path) -> None:
        from pymavlink.DFReader import DFReader_binary

        self._rows: dict[str, list[dict[str, Any]]] = {}
        reader = DFReader_binary(str(path))
        try:
            while (message := reader.recv_msg()) is not None:
                row = message.to_dict()
                if "TimeUS" in row and not any(row.get(name) for name in ("C", "I", "Instance")):
                    self._rows.setdefault(message.get_type(), []).append(row)
        finally:
            reader.close()

    @property
    def columns(self) -> Mapping[str, list[str]]:
        """The fields of each message."""
        others = ("mavpackettype", "TimeUS")
        return {name: [field for field in rows[0] if field not in others] for name, rows in self._rows.items()}

    def values(self, message: str, field: str) -> tuple[Floats, Floats]:
        """Times and values of a field that there is."""
        rows = self._rows[message]
        times = [row["TimeUS"] / 1e6 for row in rows]
        return np.asarray(times, float), np.asarray([row[field] for row in rows], float)


READERS: Final[tuple[tuple[bytes, Callable[[Path], AutopilotLog]], ...]] = (
    (ULOG_MAGIC, UlogFile),
    (DATAFLASH_MAGIC, DataFlashFile),
)


def read_autopilot_log(path: Path) -> AutopilotLog:
    """Reads a log of an autopilot, of either kind.

    Raises:
        InputError: it cannot be read, or is neither.
        Gloc3Error: the library for it is not installed.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(len(ULOG_MAGIC))
        for magic, reader in READERS:
            if head.startswith(magic):
                with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # they tell of each damaged byte
                    return reader(path)
    except OSError as error:
        raise InputError([Finding(file=str(path), message=f"cannot be read: {error.strerror}")]) from error
    except (
        ValueError,
        TypeError,
        LookupError,
        EOFError,
        AttributeError,
        struct.error,
    ) as error:  # the libraries check little
        raise InputError([Finding(file=str(path), message=f"is damaged: {error}")]) from error
    hint = "ULog (.ulg) of PX4 and DataFlash (.BIN) of ArduPilot are"
    raise InputError([Finding(file=str(path), message="is no autopilot's log that is known", hint=hint)])


def autopilot_series(log: AutopilotLog, name: str) -> tuple[Floats, Floats]:
    """Times and values of a field `MESSAGE.FIELD`.

    Raises:
        Refused: there is none of that name.
    """
    known = [f"{message}.{field}" for message, fields in log.columns.items() for field in fields]
    if name not in known:
        raise Refused(f"the {log.form} has no field {name!r}; {nearest(name, known)}")
    message, _, field = name.partition(".")
    return log.values(message, field)


def autopilot_track(log: AutopilotLog) -> MotionTrack:
    """The motion as the autopilot's estimator had it.

    Raises:
        Refused: it is not recorded.
    """
    for message, (positions, velocities) in POSITIONS.items():
        if set(positions + velocities) <= set(log.columns.get(message, ())):
            t_s = log.values(message, positions[0])[0]
            rows = [
                np.stack([log.values(message, field)[1] for field in names], axis=1)
                for names in (positions, velocities)
            ]
            return MotionTrack(t_s, *rows)
    raise Refused(f"the {log.form} has no position: none of {', '.join(POSITIONS)} is recorded in it")


def fit_offset_s(ours: MotionTrack, theirs: MotionTrack) -> tuple[float, float]:
    """What is added to the autopilot's times to get ours, by the speeds upwards and over ground; and how well they agree.

    Returns:
        The offset in s, and the correlation of the speeds there, up to 1.

    Raises:
        Refused: there is too little motion, or the motions are not the same.
    """
    from scipy.signal import correlate

    (our_begin_s, our_speeds), (their_begin_s, their_speeds) = _speeds(ours), _speeds(theirs)
    for speeds, whose in ((our_speeds, "our log"), (their_speeds, "the autopilot's log")):
        if speeds.shape[1] * GRID_S < LEAST_OVERLAP_S or speeds.std() < LEAST_SPEED_M_S:
            raise Refused(f"{whose} has too little motion to find how the clocks differ; set --offset SECONDS")
    ones = np.ones(our_speeds.shape[1]), np.ones(their_speeds.shape[1])
    product = sum(correlate(a, b) for a, b in zip(our_speeds, their_speeds, strict=True))
    energy = sum(correlate(a * a, ones[1]) for a in our_speeds), sum(correlate(ones[0], b * b) for b in their_speeds)
    overlap_s = correlate(*ones) * GRID_S
    least_s = max(LEAST_OVERLAP_S, 0.5 * min(our_speeds.shape[1], their_speeds.shape[1]) * GRID_S)
    quality = product / np.sqrt(np.maximum(energy[0] * energy[1], 1e-12))
    quality = np.where(overlap_s >= least_s - 0.5 * GRID_S, quality, -1.0)
    best = int(np.argmax(quality))
    if quality[best] < LEAST_CORRELATION:
        raise Refused(
            f"the logs are not of one flight: their speeds agree by {max(quality[best], 0.0):.2f} of 1 at best "
            f"(from {LEAST_CORRELATION} on they would); set --offset SECONDS if they are"
        )
    shift = float(best)
    if 0 < best < len(quality) - 1:
        below, at, above = quality[best - 1 : best + 2]
        shift += 0.5 * float((below - above) / (below - 2.0 * at + above)) if below + above < 2.0 * at else 0.0
    lag_s = (shift - (their_speeds.shape[1] - 1)) * GRID_S
    return our_begin_s + lag_s - their_begin_s, float(quality[best])


def _speeds(track: MotionTrack) -> tuple[float, Floats]:
    """The begin, and the speeds upwards and over ground on the grid, each less its mean."""
    begin_s = float(track.t_s[0])
    grid = np.arange(begin_s, float(track.t_s[-1]), GRID_S)
    north, east, down = (np.interp(grid, track.t_s, one) for one in np.nan_to_num(track.velocity_ned_m_s).T)
    speeds = np.stack([-down, np.hypot(north, east)])
    return begin_s, speeds - speeds.mean(axis=1, keepdims=True)
