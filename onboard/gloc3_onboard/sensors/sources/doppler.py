"""Protocols of Doppler velocity logs: Water Linked's JSON and Teledyne RDI's PD6, cut out of a stream and decoded; no I/O.

Water Linked, "DVL A50/A125 protocols", report *velocity* of format json_v3; Teledyne RD Instruments, "Workhorse Commands and
Output Data Format", PD6.
"""

from math import cos, isfinite, radians, sin
from typing import Any, Final, NamedTuple, Protocol

import msgspec

from gloc3.messages.perception import BottomVelocity

LINE_MAX: Final = 65_536
"""A line that is longer is noise."""
PD6_STD_M_S: Final = 0.005
"""Taken as the noise of a device that does not claim any."""


class DopplerReport(NamedTuple):
    """A velocity, and the device's own time if it sends one."""

    stamp_us: int | None
    bottom: BottomVelocity


class Decoder(Protocol):
    """Decodes the bytes of a line."""

    damaged: int
    """Lines that could not be read."""

    def receive(self, data: bytes) -> list[DopplerReport]:
        """What is complete now."""


class _Lines:
    """Cuts a stream into lines."""

    def __init__(self) -> None:
        self._remainder = b""

    def cut(self, data: bytes) -> list[bytes]:
        """The lines that are complete now, without their ends."""
        *lines, self._remainder = (self._remainder + data).split(b"\n")
        if len(self._remainder) > LINE_MAX:
            self._remainder = b""
        return [line.strip() for line in lines if line.strip()]


class A50Decoder:
    """Water Linked A50 and A125 over TCP: one JSON object a line; its axes are forward, right, down."""

    def __init__(self, yaw_deg: float = 0.0) -> None:
        self.damaged = 0
        self._lines = _Lines()
        self._yaw_deg = yaw_deg

    def receive(self, data: bytes) -> list[DopplerReport]:
        """The velocities that are complete now; reports of other types are passed over."""
        found: list[DopplerReport] = []
        for line in self._lines.cut(data):
            try:
                text = msgspec.json.decode(line)
                if isinstance(text, dict) and text.get("type") == "velocity":
                    found.append(self._report(text))
            except (msgspec.DecodeError, KeyError, TypeError, ValueError, OverflowError, RecursionError):
                self.damaged += 1
        return found

    def _report(self, text: dict[str, Any]) -> DopplerReport:
        velocity = float(text["vx"]), float(text["vy"]), float(text["vz"])
        std_m_s, altitude_m = float(text.get("fom", PD6_STD_M_S)), float(text.get("altitude", 0.0))
        is_valid = text["velocity_valid"] is True and all(map(isfinite, (*velocity, std_m_s))) and std_m_s >= 0.0
        stamp_us = text.get("time_of_validity")
        return DopplerReport(
            _stamp(stamp_us) if stamp_us else None,
            BottomVelocity(
                velocity_frd_m_s=_turned(velocity, self._yaw_deg) if is_valid else (0.0, 0.0, 0.0),
                std_m_s=max(1e-3, std_m_s) if is_valid else 0.0,
                altitude_m=_distance(altitude_m),
                is_valid=is_valid,
                reason="" if is_valid else "no bottom lock",
            ),
        )


class Pd6Decoder:
    """PD6: lines of text; `:BS` has the velocity of the ship over the bottom in mm/s, `:BD` the distance to it."""

    def __init__(self, yaw_deg: float = 0.0) -> None:
        self.damaged = 0
        self._lines = _Lines()
        self._yaw_deg = yaw_deg
        self._altitude_m = 0.0

    def receive(self, data: bytes) -> list[DopplerReport]:
        """The velocities that are complete now."""
        found: list[DopplerReport] = []
        for line in self._lines.cut(data):
            name, *fields = (part.strip() for part in line.decode("ascii", "replace").split(","))
            try:
                if name == ":BS":
                    found.append(self._report(fields))
                elif name == ":BD":
                    self._altitude_m = _distance(float(fields[3]))
            except (IndexError, ValueError):
                self.damaged += 1
        return found

    def _report(self, fields: list[str]) -> DopplerReport:
        starboard, forward, up = (1e-3 * float(text) for text in fields[:3])
        if fields[3] not in ("A", "V"):
            raise ValueError(fields[3])
        is_valid = fields[3] == "A" and all(map(isfinite, (starboard, forward, up)))
        return DopplerReport(
            None,
            BottomVelocity(
                velocity_frd_m_s=_turned((forward, starboard, -up), self._yaw_deg) if is_valid else (0.0, 0.0, 0.0),
                std_m_s=PD6_STD_M_S if is_valid else 0.0,
                altitude_m=self._altitude_m,
                is_valid=is_valid,
                reason="" if is_valid else "no bottom lock",
            ),
        )


def _stamp(stamp_us: Any) -> int:
    """A device's own time; raises `ValueError` where it is none."""
    found = int(stamp_us)
    if not 0 < found < 1 << 64:
        raise ValueError("no time")
    return found


def _distance(reported_m: float) -> float:
    """The distance to the floor; 0 for none."""
    return reported_m if isfinite(reported_m) and reported_m > 0.0 else 0.0


def _turned(velocity: tuple[float, float, float], yaw_deg: float) -> tuple[float, float, float]:
    """Rotates a velocity from the axes of a device mounted at a yaw angle to the body's."""
    x, y, z = velocity
    cosine, sine = cos(radians(yaw_deg)), sin(radians(yaw_deg))
    return x * cosine - y * sine, x * sine + y * cosine, z
