"""Velodyne VLP-16 (Puck) scanners over UDP: packets, whole turns, and the source (VLP-16 User Manual, 63-9243, chapter 9)."""

import math
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from gloc3.errors import Gloc3Error
from gloc3.messages.perception import PointCloud
from gloc3_onboard.autopilot.telemetry import BootClock
from gloc3_onboard.sensors.devices import StampedCloud
from gloc3_onboard.sensors.lidar_sources.lidar import PLACE, LidarMount
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.source_url import DEPTHS
from gloc3_onboard.sensors.threaded import ThreadedSource

Floats = npt.NDArray[np.float64]

PACKET_BYTES: Final = 1206
BLOCKS: Final = 12
VLP_16: Final = 0x22
"""Product of a packet: VLP-16, and Puck Lite with the same beams."""
DUAL: Final = 0x39
"""Return mode of a packet whose blocks come in pairs: the last and the strongest return of one direction."""
MODES: Final = (0x37, 0x38, DUAL)
UNIT_M: Final = 0.002
NEAR_M: Final = 0.5
"""Nearer is the vehicle itself, unless the URL says otherwise."""
FAR_M: Final = 100.0
HOUR_US: Final = 3_600_000_000
"""Stamps count from the full hour."""
ELEVATIONS_RAD: Final[Floats] = np.radians([-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15])
HEIGHTS_M: Final[Floats] = 1e-3 * np.array(
    (11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2)
)
"""How far above the middle each beam begins."""
BLOCK_US: Final = 110.592
"""From one block to the next, or from one pair to the next."""
SHARES: Final[Floats] = ((55.296 * np.arange(2)[:, None] + 2.304 * np.arange(16)) / BLOCK_US).ravel()
"""When each of the 32 values of a block was measured, as a share of the time until the next one."""
LONGEST_S: Final = 0.5
"""A turn takes 0.2 s at most; where it seems to take longer, the scanner's clock has been set in it."""
MOST_POINTS: Final = 200_000
"""Points of a turn that does not end."""
BACK_RAD: Final = math.radians(10.0)
"""A scanner turns clockwise only: where its direction is less by this, a new turn has begun, also after lost packets."""
WAIT_S: Final = 0.3
_BLOCK: Final = np.dtype([("flag", "<u2"), ("azimuth", "<u2"), ("values", [("distance", "<u2"), ("light", "u1")], 32)])
_FLAG: Final = 0xEEFF
_NONSENSE: Final = 50
"""Datagrams without one that is understood, after which the sender is taken for something else."""


class LidarPacket(NamedTuple):
    """The values of a packet."""

    stamp_us: int
    """Time of its first value since the full hour."""
    delays_us: Floats
    """How long after it each value was measured, (12, 32)."""
    azimuths_rad: Floats
    """Direction of each value, clockwise from the side opposite to the cable, (12, 32)."""
    distances_m: Floats
    """(12, 32); 0 without a return."""


def packet_of(data: bytes) -> LidarPacket:
    """The values of a datagram.

    Raises:
        ValueError: it is no packet of a VLP-16; the text says why.
    """
    if len(data) != PACKET_BYTES:
        raise ValueError(f"a datagram of {len(data)} bytes is no packet of {PACKET_BYTES}")
    mode, product = data[-2:]
    if product != VLP_16 or mode not in MODES:
        raise ValueError(f"product 0x{product:02x} in mode 0x{mode:02x} is no VLP-16")
    blocks = np.frombuffer(data, _BLOCK, BLOCKS)
    if (blocks["flag"] != _FLAG).any() or (blocks["azimuth"] >= 36_000).any():
        raise ValueError("a packet is damaged")
    azimuths = np.radians(blocks["azimuth"] / 100.0)
    pace = 2 if mode == DUAL else 1
    steps = np.mod(azimuths[pace:] - azimuths[:-pace], math.tau)
    steps = np.concatenate((steps, steps[-pace:]))
    return LidarPacket(
        int.from_bytes(data[-6:-2], "little"),
        BLOCK_US * ((np.arange(BLOCKS) // pace)[:, None] + SHARES),
        azimuths[:, None] + steps[:, None] * SHARES,
        blocks["values"]["distance"] * UNIT_M,
    )


class LidarTurn(NamedTuple):
    """One turn of a scanner."""

    points: Floats
    """Forward, right, down of the scanner, (n, 3)."""
    ages_s: Floats
    """How long before its end each point was measured, (n,); none where the scanner's clock was set in it."""
    end_us: float
    """Time of its end, as of the packets' stamps."""


class TurnAssembler:
    """Puts the packets of a scanner together to turns.

    Args:
        near_m, far_m: range of the distances that are kept.
    """

    def __init__(self, near_m: float, far_m: float) -> None:
        self._near_m, self._far_m = near_m, far_m
        self._points: list[Floats] = []
        self._times_us: list[Floats] = []
        self._count = 0
        self._is_whole = False
        """Whether the turn has been received from its begin on."""
        self._before_rad = 0.0

    def add(self, packet: LidarPacket) -> LidarTurn | None:
        """Adds a packet; returns the turn that it ends."""
        directions = packet.azimuths_rad[:, 0]
        steps = np.diff(directions, prepend=self._before_rad)
        self._before_rad = float(directions[-1])
        starts = np.flatnonzero(steps < -BACK_RAD)
        if not len(starts):
            self._keep(packet, slice(None))
            return None
        self._keep(packet, slice(None, starts[0]))
        end_us = packet.stamp_us + float(packet.delays_us[starts[0], 0])
        turn = self._turn(end_us) if self._is_whole else None
        self._clear(is_whole=True)
        self._keep(packet, slice(starts[0], None))
        return turn

    def _keep(self, packet: LidarPacket, blocks: slice) -> None:
        distances, azimuths = packet.distances_m[blocks], packet.azimuths_rad[blocks]
        is_kept = (distances >= self._near_m) & (distances <= self._far_m) & (distances > 0.0)
        beams = np.broadcast_to(np.tile(np.arange(16), 2), distances.shape)[is_kept]
        elevations = ELEVATIONS_RAD[beams]
        away, azimuths = distances[is_kept], azimuths[is_kept]
        level = away * np.cos(elevations)
        points = np.column_stack(
            (level * np.cos(azimuths), level * np.sin(azimuths), -away * np.sin(elevations) - HEIGHTS_M[beams])
        )
        self._count += len(points)
        if self._count > MOST_POINTS:
            self._clear(is_whole=False)
            return
        self._points.append(points)
        self._times_us.append(packet.stamp_us + packet.delays_us[blocks][is_kept])

    def _clear(self, *, is_whole: bool) -> None:
        self._points, self._times_us, self._count, self._is_whole = [], [], 0, is_whole

    def _turn(self, end_us: float) -> LidarTurn:
        ages_s = 1e-6 * (end_us - np.concatenate(self._times_us))
        is_even = ((ages_s >= 0.0) & (ages_s <= LONGEST_S)).all()
        return LidarTurn(np.concatenate(self._points), ages_s if is_even else ages_s[:0], end_us)


class VelodyneLidar(ThreadedSource[StampedCloud]):
    """A VLP-16 whose datagrams come to this computer. A turn has the time of its end.

    Args:
        request: `velodyne://HOST:PORT`, where we listen.
    """

    def __init__(self, request: SourceRequest) -> None:
        super().__init__(request.device, request.now_s)
        self._url = request.url
        self._address = request.url.address(request.device)
        self._mount = LidarMount.of(request.url)

    def cloud(self) -> StampedCloud | None:
        """The latest turn; None before the first.

        Raises:
            Gloc3Error: something else sends there.
        """
        return self.latest()

    @contextmanager
    def connect(self) -> Iterator[Iterator[StampedCloud | None]]:
        """Listens. The scanner need not send yet."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
            try:
                receiver.bind(self._address)
            except OSError as error:
                raise Gloc3Error(f"{self.name}: {self._url.place} cannot be listened to: {error.strerror}") from error
            receiver.settimeout(WAIT_S)
            yield self._turns(receiver)

    def _turns(self, receiver: socket.socket) -> Iterator[StampedCloud | None]:
        near_m, far_m = self._url.number("min_m", NEAR_M), self._url.number("max_m", FAR_M)
        clock, turns, lap_us, before_us, refused = BootClock(), TurnAssembler(near_m, far_m), 0, 0, 0
        while True:
            try:
                packet = packet_of(receiver.recv(2 * PACKET_BYTES))
            except TimeoutError:
                yield None
                continue
            except ValueError as error:  # a damaged datagram is left out; the next one comes soon
                refused += 1
                if refused > _NONSENSE:
                    raise Gloc3Error(f"{self.name}: {error}") from error
                yield None
                continue
            refused = 0
            if packet.stamp_us < before_us - HOUR_US // 2:
                lap_us += HOUR_US
            before_us = packet.stamp_us
            packet = packet._replace(stamp_us=lap_us + packet.stamp_us)
            t_s = clock.t_s(packet.stamp_us * 1e-3, self.now_s())
            turn = turns.add(packet)
            if turn is None:  # the reader looks whether it is to go on, also where the scanner does not turn
                yield None
                continue
            cloud = PointCloud(
                sensor=self.name,
                data=self._mount.placed(turn.points).astype("<f4").tobytes(),
                ages_s=turn.ages_s.astype("<f4").tobytes(),
                origin_frd_m=self._mount.position_frd_m,
                range_max_m=far_m,
            )
            yield StampedCloud(t_s + 1e-6 * (turn.end_us - packet.stamp_us), cloud)


SOURCES: Final = (
    SourceKind("velodyne", ("lidar",), "velodyne://0.0.0.0:2368?down_m=-0.1", VelodyneLidar, {**PLACE, **DEPTHS}),
)
