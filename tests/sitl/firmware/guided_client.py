"""A bare MAVLink client that flies ArduCopter in GUIDED: what a script of a user would do, and nothing more."""

import asyncio
import math
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from gloc3.mavlink import codec
from gloc3.mavlink.codec import Encoder, Parser
from gloc3.mavlink.message import MavlinkMessage
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint

GUIDED, LAND = 4, 9
EKF_POSITION = 8 | 16
POSITION_ONLY = 3576
MODE, ARM, TAKE_OFF, REBOOT, INTERVAL = 176, 400, 22, 246, 511
STREAMS = {"LOCAL_POSITION_NED": 50_000, "SYSTEM_TIME": 100_000, "EKF_STATUS_REPORT": 200_000}
TIMEOUT_S = 250.0
"""A computer that is busy simulates slower than real time."""


class GuidedClient:
    def __init__(self) -> None:
        self.latest: dict[str, MavlinkMessage] = {}
        self.texts: deque[str] = deque(maxlen=40)
        self._parser = Parser(is_datagram=True)
        self._encoder = Encoder(255, 190)
        self._endpoint: Endpoint
        self._reports = asyncio.Event()
        self._beating: asyncio.Task[None]

    async def __aenter__(self) -> Self:
        self._endpoint = await open_endpoint("udpin://127.0.0.1:0", asyncio.get_running_loop(), self._take)
        self._beating = asyncio.ensure_future(self._beat())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._beating.cancel()
        with suppress(asyncio.CancelledError):
            await self._beating
        await self._endpoint.close()

    @property
    def url(self) -> str:
        """Where the autopilot is to send."""
        return f"udpout://127.0.0.1:{self._endpoint.local_port}"

    def _take(self, data: bytes) -> None:
        for frame in self._parser.receive(data):
            message = codec.decode(frame)
            if message is not None and frame.sender == (1, 1):
                self.latest[message.name] = message
                if message.name == "STATUSTEXT":
                    self.texts.append(str(message.text))
        self._reports.set()

    async def _beat(self) -> None:
        while True:
            self.send("HEARTBEAT", type=6, autopilot=8)
            await asyncio.sleep(0.2)

    def send(self, name: str, **fields: Any) -> None:
        self._endpoint.send(self._encoder.encode(codec.message(name, **fields)))

    async def until(self, is_it: Callable[[], bool], what: str, within_s: float = TIMEOUT_S) -> None:
        try:
            async with asyncio.timeout(within_s):
                while not is_it():
                    self._reports.clear()
                    await self._reports.wait()
        except TimeoutError:
            raise AssertionError(f"not within {within_s} s: {what}; it said {list(self.texts)}") from None

    async def command(self, number: int, *parameters: float) -> int:
        """Its result."""
        self.latest.pop("COMMAND_ACK", None)
        fields = {f"param{index}": value for index, value in enumerate(parameters, start=1)}
        self.send("COMMAND_LONG", target_system=1, target_component=1, command=number, **fields)

        def is_answered() -> bool:
            answer = self.latest.get("COMMAND_ACK")
            return answer is not None and answer.command == number

        await self.until(is_answered, f"an answer to command {number}")
        return int(self.latest["COMMAND_ACK"].result)

    async def get_ready(self) -> None:
        """Until its estimator knows where it is."""
        await self.until(lambda: "HEARTBEAT" in self.latest, "a heartbeat")
        for name, every_us in STREAMS.items():
            await self.command(INTERVAL, codec.shape(name).id, every_us)
        await self.until(
            lambda: (
                "EKF_STATUS_REPORT" in self.latest
                and self.latest["EKF_STATUS_REPORT"].flags & EKF_POSITION == EKF_POSITION
            ),
            "a position",
        )

    async def take_off(self, height_m: float) -> None:
        assert await self.command(MODE, 1, GUIDED) == 0
        for _ in range(20):
            if await self.command(ARM, 1) == 0:
                break
            await asyncio.sleep(0.5)
        assert await self.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, height_m) == 0, list(self.texts)
        await self.until(lambda: self.position()[2] > height_m - 0.2, "being up")

    def position(self) -> tuple[float, float, float]:
        """North, east and height, as it estimates them."""
        place = self.latest["LOCAL_POSITION_NED"]
        return (place.x, place.y, -place.z)

    def boot_s(self) -> float:
        """Its own time."""
        stamp = self.latest.get("SYSTEM_TIME")
        return 0.0 if stamp is None else stamp.time_boot_ms * 1e-3

    async def fly_to(self, north_m: float, east_m: float, height_m: float, within_m: float = 0.2) -> None:
        self.send(
            "SET_POSITION_TARGET_LOCAL_NED",
            target_system=1,
            target_component=1,
            coordinate_frame=1,
            type_mask=POSITION_ONLY,
            x=north_m,
            y=east_m,
            z=-height_m,
        )
        there = (north_m, east_m, height_m)
        await self.until(lambda: math.dist(self.position(), there) < within_m, f"being at {there}")

    async def rest(self, seconds: float) -> None:
        """Waits so long by the autopilot's clock."""
        end_s = self.boot_s() + seconds
        await self.until(lambda: self.boot_s() >= end_s, f"{seconds} s")

    async def land(self) -> None:
        assert await self.command(MODE, 1, LAND) == 0
        await self.until(lambda: not self.latest["HEARTBEAT"].base_mode & 128, "being down and disarmed")
