"""Doppler velocity logs over TCP or a serial line: Water Linked A50 and A125, and PD6 devices."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from gloc3.errors import Gloc3Error
from gloc3.messages.perception import BottomVelocity
from gloc3.messages.vehicle import Image
from gloc3_onboard.autopilot.telemetry import BootClock
from gloc3_onboard.sensors.devices import Dvl, StampedBottomVelocity
from gloc3_onboard.sensors.line import Line, open_line
from gloc3_onboard.sensors.registry import SensorKind, SourceKind, SourceRequest
from gloc3_onboard.sensors.replay import Recorded, Replay, topic_records
from gloc3_onboard.sensors.source_url import BAUD as BAUD_OPTION
from gloc3_onboard.sensors.source_url import SERIAL_GROUP, YAW, SourceUrl
from gloc3_onboard.sensors.sources.doppler import A50Decoder, Decoder, Pd6Decoder
from gloc3_onboard.sensors.threaded import ThreadedSource

BAUD: Final = 115_200
WAIT_S: Final = 0.3
_NONSENSE: Final = 50
"""Damaged lines without a valid one after which the device counts as incompatible."""


class DvlSource(ThreadedSource[StampedBottomVelocity]):
    """A device that streams its velocity, a line at a time.

    Args:
        name: name of the device.
        url: `a50://192.168.194.95:16171`, `pd6:///dev/ttyUSB0` or `pd6://HOST:PORT`; `yaw_deg` is its mounting angle.
        now_s: our time.
    """

    def __init__(self, name: str, url: SourceUrl, now_s: Callable[[], float]) -> None:
        super().__init__(name, now_s)
        self._url = url
        self._address = None if url.place.startswith("/") else url.address(name)

    def bottom_velocity(self) -> StampedBottomVelocity | None:
        """The latest velocity; None before the first.

        Raises:
            Gloc3Error: the device is lost.
        """
        return self.latest()

    @contextmanager
    def connect(self) -> Iterator[Iterator[StampedBottomVelocity | None]]:
        """Opens the line."""
        line = open_line(self.name, self._url, self._address, BAUD, WAIT_S)
        try:
            yield self._velocities(line)
        finally:
            line.close()

    def _decoder(self) -> Decoder:
        yaw_deg = self._url.number("yaw_deg", 0.0)
        return A50Decoder(yaw_deg) if self._url.scheme == "a50" else Pd6Decoder(yaw_deg)

    def _velocities(self, line: Line) -> Iterator[StampedBottomVelocity | None]:
        decoder, clock = self._decoder(), BootClock()
        has_understood = False
        while True:
            reports = decoder.receive(line.read())
            if not reports:
                if decoder.damaged > _NONSENSE and not has_understood:
                    raise Gloc3Error(f"{self.name}: {self._url.place} does not speak {self._url.scheme.upper()}")
                yield None
            for stamp_us, bottom in reports:
                has_understood = True
                now_s = self.now_s()
                t_s = now_s if stamp_us is None else clock.t_s(stamp_us * 1e-3, now_s)
                yield StampedBottomVelocity(t_s, bottom)


class ReplayDvl(Replay[BottomVelocity]):
    """A Doppler velocity log of a log."""

    _bottom: StampedBottomVelocity | None = None

    def play(self, t_s: float, item: BottomVelocity) -> None:
        """Keeps a velocity."""
        self._bottom = StampedBottomVelocity(t_s, item)

    def clear(self) -> None:
        """Keeps nothing."""
        self._bottom = None

    def bottom_velocity(self) -> StampedBottomVelocity | None:
        """The latest velocity; None before the first."""
        self.check()
        return self._bottom


def _recorded(log: Path, part: str, device: str) -> Sequence[Recorded[BottomVelocity]]:
    del device
    return topic_records(log, part or "dvl", BottomVelocity)


def _poll(device: Dvl) -> Sequence[Image]:
    device.bottom_velocity()
    return ()


def _make(request: SourceRequest) -> DvlSource:
    return DvlSource(request.device, request.url, request.now_s)


SENSORS: Final = (SensorKind("dvl", ReplayDvl, _recorded, _poll),)
SOURCES: Final = (
    SourceKind("a50", ("dvl",), "a50://192.168.194.95:16171", _make, YAW),
    SourceKind(
        "pd6",
        ("dvl",),
        "pd6:///dev/ttyUSB0, or pd6://192.168.0.20:1033",
        _make,
        {**BAUD_OPTION, **YAW},
        group=SERIAL_GROUP,
    ),
)
