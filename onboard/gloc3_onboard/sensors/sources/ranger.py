"""Range finders that look down, on a serial line of this computer: Benewake's TF series, LightWare's LW20 and SF20."""

import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from gloc3.errors import Gloc3Error
from gloc3.messages.vehicle import HeightAboveGround
from gloc3_onboard.sensors.devices import StampedHeight, Unwatch, opened
from gloc3_onboard.sensors.line import Line, open_line
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.source_url import BAUD as BAUD_OPTION
from gloc3_onboard.sensors.source_url import SERIAL_GROUP, Number, Options, SourceUrl
from gloc3_onboard.sensors.sources.ranger_wire import (
    DISTANCE,
    DISTANCE_OUTPUT,
    FIRST_MEDIAN,
    PRODUCT_NAME,
    STREAM,
    STREAM_DISTANCES,
    LwnxReader,
    RangeDecoder,
    lwnx_packet,
)
from gloc3_onboard.sensors.threaded import ThreadedSource

BAUD: Final = 115_200
WAIT_S: Final = 0.2
ANSWER_TRIES: Final = 15
"""Requests without an answer after which a device is not a LightWare; it never answers the first two."""
NONSENSE: Final = 50
"""Damaged pieces without a distance after which a device is another one."""
OPTIONS: Final[Options] = {**BAUD_OPTION, "offset_m": Number(-5.0, 5.0)}


class Ranger(ThreadedSource[StampedHeight]):
    """A range finder that sends distances by itself; it is read while a sampler listens.

    Args:
        name: name of the device.
        url: `benewake:///dev/ttyUSB0`, `lightware:///dev/ttyUSB0`, or either with an address; `offset_m` is added.
        now_s: our time.
    """

    def __init__(self, name: str, url: SourceUrl, now_s: Callable[[], float]) -> None:
        super().__init__(name, now_s)
        self._url = url
        self._address = None if url.place.startswith("/") else url.address(name)

    def height(self) -> StampedHeight | None:
        """The latest distance to the ground; None before the first.

        Raises:
            Gloc3Error: the device is lost.
        """
        return self.latest()

    def on_height(self, ready: Callable[[], None]) -> Unwatch:
        """Opens the device, and has `ready` called when a new distance is there.

        Raises:
            Gloc3Error: the device is not available; the message says what to do.
        """
        return opened(self, ready)

    @contextmanager
    def connect(self) -> Iterator[Iterator[StampedHeight | None]]:
        """Opens the line; a LightWare is told to send its distances."""
        line = open_line(self.name, self._url, self._address, BAUD, WAIT_S)
        try:
            yield self._benewake(line) if self._url.scheme == "benewake" else self._lightware(line)
        finally:
            line.close()

    def _benewake(self, line: Line) -> Iterator[StampedHeight | None]:
        decoder, has_understood = RangeDecoder(), False
        while True:
            distances = decoder.receive(line.read())
            has_understood |= bool(distances)
            self._give_up(decoder.damaged, has_understood)
            yield self._height(distances[-1]) if distances else None

    def _lightware(self, line: Line) -> Iterator[StampedHeight | None]:
        reader = LwnxReader()
        self._identify(line, reader)
        line.write(lwnx_packet(DISTANCE_OUTPUT, FIRST_MEDIAN))
        line.write(lwnx_packet(STREAM, STREAM_DISTANCES))
        while True:
            packets = [one for one in reader.receive(line.read()) if one.command == DISTANCE and len(one.data) >= 2]
            if not packets:
                yield None
                continue
            (distance_cm,) = struct.unpack_from("<h", packets[-1].data)
            yield self._height(distance_cm * 0.01 if distance_cm > 0 else None)

    def _identify(self, line: Line, reader: LwnxReader) -> None:
        """Asks for the product's name until it comes: the first request selects the line, the second the protocol."""
        for _ in range(ANSWER_TRIES):
            line.write(lwnx_packet(PRODUCT_NAME))
            if any(packet.command == PRODUCT_NAME for packet in reader.receive(line.read())):
                return
        raise Gloc3Error(f"{self.name}: {self._url.place} does not answer as a LightWare does (LWNX)")

    def _give_up(self, damaged: int, has_understood: bool) -> None:
        if damaged > NONSENSE and not has_understood:
            raise Gloc3Error(f"{self.name}: {self._url.place} does not send frames of a Benewake; check the baud rate")

    def _height(self, distance_m: float | None) -> StampedHeight:
        if distance_m is None:
            return StampedHeight(self.now_s(), HeightAboveGround(height_m=0.0, is_valid=False, reason="no echo"))
        height_m = distance_m + self._url.number("offset_m", 0.0)
        return StampedHeight(self.now_s(), HeightAboveGround(height_m=height_m, is_valid=True))


def _make(request: SourceRequest) -> Ranger:
    return Ranger(request.device, request.url, request.now_s)


SOURCES: Final = tuple(
    SourceKind(scheme, ("height",), f"{scheme}:///dev/ttyUSB0", _make, OPTIONS, group=SERIAL_GROUP)
    for scheme in ("benewake", "lightware")
)
