"""Estimators that are not ours, over UDP and Zenoh: OpenVINS, RTAB-Map, cameras that track themselves, lidar odometry."""

import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange.foreign import payloads
from gloc3.messages.perception import EstimatorPose
from gloc3.messages.vehicle import Image
from gloc3_onboard.autopilot.telemetry import BootClock
from gloc3_onboard.sensors.devices import ExternalEstimator, StampedEstimatorPose
from gloc3_onboard.sensors.registry import SensorKind, SourceKind, SourceRequest
from gloc3_onboard.sensors.replay import Recorded, Replay, topic_records
from gloc3_onboard.sensors.source_url import DELAY, Options, SourceUrl
from gloc3_onboard.sensors.sources.estimator_wire import EstimatorDecoder, JsonDecoder, OdometryDecoder
from gloc3_onboard.sensors.threaded import ThreadedSource

WAIT_S: Final = 0.3
DATAGRAM_MAX: Final = 65_535
_NONSENSE: Final = 50
"""Damaged datagrams without a valid one after which what sends is taken for something else."""
_CONNECT: Final[Options] = {"connect": None}
_DECODERS: Final[Mapping[str, Callable[[], EstimatorDecoder]]] = {
    "json": JsonDecoder,
    "odometry": OdometryDecoder,
    "zenoh": JsonDecoder,
}


class EstimatorSource(ThreadedSource[StampedEstimatorPose]):
    """Poses as they come.

    Args:
        name: name of the device.
        url: `json://HOST:PORT` or `odometry://HOST:PORT`, where we listen, or `zenoh://KEY?connect=ENDPOINT`; `delay_s` is
            the age of poses without a time when they come.
        now_s: our time.
    """

    def __init__(self, name: str, url: SourceUrl, now_s: Callable[[], float]) -> None:
        super().__init__(name, now_s)
        self._url = url
        self._address = None if url.scheme == "zenoh" else url.address(name)

    def estimated_pose(self) -> StampedEstimatorPose | None:
        """The latest pose; None before the first.

        Raises:
            Gloc3Error: the source is lost.
        """
        return self.latest()

    @contextmanager
    def connect(self) -> Iterator[Iterator[StampedEstimatorPose | None]]:
        """Opens the socket, or joins the network."""
        if self._address is None:
            with ExitStack() as stack:
                try:
                    came = stack.enter_context(payloads(self._url.options["connect"], self._url.place, WAIT_S))
                except Gloc3Error as error:
                    raise Gloc3Error(f"{self.name}: {error}") from error
                yield self._poses(came)
            return
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
            receiver.settimeout(WAIT_S)
            try:
                receiver.bind(self._address)
            except OSError as error:
                place = "{}:{}".format(*self._address)
                raise Gloc3Error(f"{self.name}: {place} cannot be listened on: {error.strerror}") from error
            yield self._poses(_datagrams(receiver))

    def _poses(self, datagrams: Iterator[bytes | None]) -> Iterator[StampedEstimatorPose | None]:
        decoder, clock = _DECODERS[self._url.scheme](), BootClock()
        delay_s = self._url.number("delay_s", 0.0)
        has_understood = False
        for data in datagrams:
            reports = decoder.receive(data) if data is not None else ()
            if decoder.damaged > _NONSENSE and not has_understood:
                raise Gloc3Error(f"{self.name}: what comes on {self._url.text} is none of its poses")
            if not reports:
                yield None
            for stamp_s, pose in reports:
                has_understood = True
                now_s = self.now_s()
                t_s = now_s if stamp_s is None else clock.t_s(stamp_s * 1e3, now_s)
                yield StampedEstimatorPose(t_s - delay_s, pose)


def _datagrams(receiver: socket.socket) -> Iterator[bytes | None]:
    while True:
        try:
            yield receiver.recv(DATAGRAM_MAX)
        except TimeoutError:
            yield None


class ReplayEstimator(Replay[EstimatorPose]):
    """An estimator of a log."""

    _pose: StampedEstimatorPose | None = None

    def play(self, t_s: float, item: EstimatorPose) -> None:
        """Keeps a pose."""
        self._pose = StampedEstimatorPose(t_s, item)

    def clear(self) -> None:
        """Keeps nothing."""
        self._pose = None

    def estimated_pose(self) -> StampedEstimatorPose | None:
        """The latest pose; None before the first."""
        self.check()
        return self._pose


def _recorded(log: Path, part: str, device: str) -> Sequence[Recorded[EstimatorPose]]:
    del device
    return topic_records(log, part or "estimator_pose", EstimatorPose)


def _poll(device: ExternalEstimator) -> Sequence[Image]:
    device.estimated_pose()
    return ()


def _make(request: SourceRequest) -> EstimatorSource:
    if request.url.scheme == "zenoh" and "connect" not in request.url.options:
        raise Refused(f"{request.device}: {request.url.text!r}: add ?connect=ENDPOINT, as in {_ZENOH}")
    return EstimatorSource(request.device, request.url, request.now_s)


_ZENOH: Final = "zenoh://openvins/odometry?connect=tcp/127.0.0.1:7447"
SENSORS: Final = (SensorKind("estimator", ReplayEstimator, _recorded, _poll),)
SOURCES: Final = (
    SourceKind("json", ("estimator",), "json://127.0.0.1:14600", _make, DELAY),
    SourceKind("odometry", ("estimator",), "odometry://127.0.0.1:14601", _make, DELAY),
    SourceKind("zenoh", ("estimator",), _ZENOH, _make, {**DELAY, **_CONNECT}),
)
