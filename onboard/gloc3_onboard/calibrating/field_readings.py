"""Readings of a magnetometer: of our logs, of autopilots' logs, of tables, and live over MAVLink; all in gauss."""

import asyncio
import csv
import math
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np

from gloc3.cli.narration import narrate
from gloc3.clock import passed
from gloc3.errors import Finding, InputError, Refused
from gloc3.log.autopilot_log import read_autopilot_log
from gloc3.log.reader import LogReader
from gloc3.mavlink import codec
from gloc3.mavlink.codec import Address, Encoder, MavlinkMessage, Parser
from gloc3.mavlink.services.heartbeat import AUTOPILOT_INVALID, GROUND_STATION
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL
from gloc3.mavlink.transport.endpoints import open_endpoint
from gloc3_onboard.algorithms.calibration.boards import Floats
from gloc3_onboard.algorithms.calibration.ellipsoid import fit_ellipsoid

MESSAGES: Final = {"HIGHRES_IMU": 1.0, "SCALED_IMU": 1e-3, "SCALED_IMU2": 1e-3, "RAW_IMU": 1e-3}
"""Messages with a field, and their unit in gauss; the first that comes is taken."""
LOGGED: Final = (
    ("sensor_mag", ("x", "y", "z"), 1.0),
    ("vehicle_magnetometer", ("magnetometer_ga[0]", "magnetometer_ga[1]", "magnetometer_ga[2]"), 1.0),
    ("MAG", ("MagX", "MagY", "MagZ"), 1e-3),
)
"""Messages of autopilots' logs: PX4's, then ArduPilot's."""
OWN: Final = Address(255, 190)
"""PX4 and ArduPilot listen to a ground station."""
EVERY_US: Final = 50_000.0
REPEAT_S: Final = 1.0
SHOWN_S: Final = 3.0
LISTEN_S: Final = 10.0
"""Time without a reading after which a link is given up."""
ENOUGH: Final = 400


def is_link(place: str) -> bool:
    """Whether readings come over MAVLink."""
    return "://" in place


def read_readings(place: Path) -> Floats:
    """The readings of a log or a table, (n, 3), in gauss.

    Raises:
        InputError: there are none, or the file is damaged.
    """
    if place.suffix == ".mcap":
        return _of_our_log(place)
    if place.suffix in (".ulg", ".bin", ".BIN"):
        return _of_autopilot_log(place)
    if place.suffix in (".csv", ".txt"):
        return _of_table(place)
    hint = "known: log.mcap, .ulg, .bin, .csv, or a MAVLink link such as serial:///dev/ttyACM0:115200"
    raise InputError([Finding(file=str(place), message="this is no log of a magnetometer", hint=hint)])


def _of_our_log(path: Path) -> Floats:
    listener, parser = FieldListener(), Parser(is_datagram=True)
    with LogReader(path) as reader:
        reader.require_ours("MAVLink traffic")
        for raw in reader.frames():
            for frame in parser.receive(raw.data) if raw.direction == "in" else ():
                message = frame.decode()
                if message is not None:
                    listener.receive(frame.sender, message)
    if not listener.rows:
        hint = f"they are in the MAVLink messages {', '.join(MESSAGES)}: name the log of a process that has the autopilot's link"
        raise InputError([Finding(file=str(path), message="it has no readings of a magnetometer", hint=hint)])
    return np.array(listener.rows)


def _of_autopilot_log(path: Path) -> Floats:
    log = read_autopilot_log(path)
    columns = log.columns
    for name, fields, unit in LOGGED:
        if name in columns and set(fields) <= set(columns[name]):
            return np.column_stack([unit * log.values(name, field)[1] for field in fields])
    hint = f"it must have {' or '.join(name for name, _, _ in LOGGED)}"
    raise InputError([Finding(file=str(path), message=f"{log.form}: it has no readings of a magnetometer", hint=hint)])


def _of_table(path: Path) -> Floats:
    """Rows of x, y, z, or of a time and these."""
    rows: list[tuple[float, ...]] = []
    try:
        with path.open(newline="", encoding="utf-8", errors="replace") as file:
            for line, row in enumerate(csv.reader(file), start=1):
                if not row or row[0].startswith("#") or (line == 1 and not _are_numbers(row)):
                    continue
                if len(row) not in (3, 4) or not _are_numbers(row):
                    message = f"{','.join(row)!r} is no reading"
                    hint = "a row is x,y,z or time,x,y,z, in gauss on body axes"
                    raise InputError([Finding(file=str(path), line=line, column=1, message=message, hint=hint)])
                rows.append(tuple(map(float, row[-3:])))
    except OSError as error:
        raise InputError([Finding(file=str(path), message=f"cannot be read: {error.strerror}")]) from error
    except csv.Error as error:
        raise InputError([Finding(file=str(path), message=f"this is no table: {error}")]) from error
    return np.array(rows).reshape(-1, 3)


def _are_numbers(row: list[str]) -> bool:
    try:
        return all(math.isfinite(float(value)) for value in row)
    except ValueError:
        return False


def _reading(message: MavlinkMessage) -> tuple[float, float, float] | None:
    unit = MESSAGES.get(message.name)
    if unit is None or not (message.xmag or message.ymag or message.zmag):
        return None
    return unit * message.xmag, unit * message.ymag, unit * message.zmag


def listen(url: str, seconds: float) -> Floats:
    """Takes readings over MAVLink while the vehicle is turned: until enough has been shown, for a time, or until Ctrl-C.

    Args:
        url: the link, as of `gloc3 onboard --autopilot`.
        seconds: the longest time.

    Raises:
        Refused: the link cannot be had, or no reading comes.
    """
    listener = FieldListener()
    with suppress(KeyboardInterrupt):
        asyncio.run(_listen(url, listener, seconds))
    if not listener.rows:
        reason = listener.problem or f"no reading of a magnetometer has come ({', '.join(MESSAGES)})"
        raise Refused(f"{url}: {reason}")
    return np.array(listener.rows)


class FieldListener:
    """Keeps the readings of one kind of message of one autopilot."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, float, float]] = []
        self.autopilot: Address | None = None
        self.problem = ""
        """Why nothing comes on the link; empty if it is open."""
        self._kind = ""

    def receive(self, sender: Address, message: MavlinkMessage) -> None:
        """Handles one message."""
        if message.name == "HEARTBEAT" and message.autopilot != AUTOPILOT_INVALID and self.autopilot is None:
            self.autopilot = sender
        reading = _reading(message)
        if (
            reading is not None
            and sender == (self.autopilot or sender)
            and message.name == (self._kind or message.name)
        ):
            self._kind = message.name
            self.rows.append(reading)

    def requests(self) -> list[MavlinkMessage]:
        """What to send each second: our heartbeat, and requests for the messages."""
        messages = [codec.message("HEARTBEAT", type=GROUND_STATION, autopilot=AUTOPILOT_INVALID, mavlink_version=3)]
        if self.autopilot is not None and not self.rows:
            system, component = self.autopilot
            messages += [
                codec.message(
                    "COMMAND_LONG",
                    target_system=system,
                    target_component=component,
                    command=SET_MESSAGE_INTERVAL,
                    param1=float(codec.shape(name).id),
                    param2=EVERY_US,
                )
                for name in MESSAGES
            ]
        return messages

    def advice(self) -> str:
        """How to turn the vehicle next; empty if enough has been shown."""
        if len(self.rows) < ENOUGH:
            return "turn the vehicle about all its axes"
        try:
            return fit_ellipsoid(np.array(self.rows)).coverage.advice()
        except Refused as error:
            return str(error)


async def _listen(url: str, listener: FieldListener, seconds: float) -> None:
    loop = asyncio.get_running_loop()
    encoder = Encoder(*OWN)
    parsers: list[Parser] = []

    def receive(data: bytes) -> None:
        for frame in parsers[0].receive(data) if parsers else ():
            message = frame.decode()
            if message is not None:
                listener.receive(frame.sender, message)

    endpoint = await open_endpoint(url, loop, receive)
    parsers.append(Parser(is_datagram=endpoint.is_datagram))
    try:
        end_s, shown_s, count, last_s = loop.time() + seconds, loop.time(), 0, loop.time()
        while loop.time() < end_s and loop.time() - last_s < LISTEN_S:
            for message in listener.requests():
                endpoint.send(encoder.encode(message))
            await passed(REPEAT_S)
            if not listener.rows and endpoint.problem != listener.problem:
                listener.problem = endpoint.problem
                narrate(f"{url}: {listener.problem or 'the link is open'}")
            if listener.rows and not count:
                narrate("turn the vehicle slowly about all its axes, each side down once, away from steel; Ctrl-C ends")
            if len(listener.rows) > count:
                count, last_s = len(listener.rows), loop.time()
            if count and loop.time() - shown_s >= SHOWN_S:
                shown_s = loop.time()
                advice = listener.advice()
                if not advice:
                    break
                narrate(f"{count} readings; {advice}")
    finally:
        await endpoint.close()
