"""A real firmware in lockstep with a flight in virtual time, in place of the simulator with its autopilot.

It waits for physics after each of its steps, and we step only when the flight's clock asks for it; so cameras that take
long, and a computer that is busy, cost wall time and nothing else.
"""

import select
import socket
from asyncio import AbstractEventLoop, TimerHandle
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NoReturn

from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.envelope import Severity
from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.mavlink.links import LinkKind, Receive, Send
from gloc3_sitl.autopilot.pilot import Pilot
from gloc3_sitl.autopilot.surroundings import SupplyState
from gloc3_sitl.firmware.body import BodySettings, SensedBody
from gloc3_sitl.firmware.ends_in_step import HilEnd, JsonEnd
from gloc3_sitl.firmware.json_server import SocketAddress
from gloc3_sitl.firmware.kinds import FirmwareOptionsWanted, kind_named, start_program
from gloc3_sitl.firmware.program import find_binary
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.physics.wind import Wind
from gloc3_sitl.sensors.suite import SensorSuite
from gloc3_sitl.world import World

PERIOD_S: Final = 0.02
"""How often messages of the link go back and forth, in simulated time."""
READY_WITHIN_S: Final = 120.0
"""Its estimator takes 40 s to believe satellites."""
SENSORS: Final[Mapping[str, tuple[str, ...]]] = {
    "ardupilot": ("imu", "height"),
    "px4": ("imu", "height", "barometer", "magnetometer", "fix"),
}
"""Those of ours that each firmware flies by; the others it simulates by itself."""
_ENDS: Final[Mapping[str, Callable[[SensedBody], JsonEnd | HilEnd]]] = {"ardupilot": JsonEnd, "px4": HilEnd}
_SILENT_S: Final = 20.0
_AS_FAST_AS_IT_CAN: Final = 1000.0
_LARGEST: Final = 2048


class FirmwareInStep:
    """One vehicle in one world, flown by a real firmware.

    Args:
        firmware: which.
        world: where it flies.
        settings: what is simulated.
        parameters: of the firmware, beside those of the vehicle.
        out: folder for what it says and leaves; None keeps nothing.

    Raises:
        Refused: its program is not there.
    """

    def __init__(
        self,
        firmware: str,
        world: World,
        settings: BodySettings,
        parameters: Mapping[str, float],
        out: Path | None = None,
    ) -> None:
        kind = kind_named(firmware)
        binary = find_binary(kind.programs_for(settings.vehicle), None)
        self.world: Final = world
        self.texts: Final[deque[tuple[float, Severity, str]]] = deque()
        """Always empty: status texts are on its link and in `firmware.txt`."""
        self.problem = ""
        """Reason why time has stopped."""
        self._body: Final = SensedBody(world, settings, kind.rate_hz)
        self._end: Final = _ENDS[firmware](self._body)
        self._scratch: Final = TemporaryDirectory(prefix="gloc3-firmware-")
        folder = Path(self._scratch.name) if out is None else out.absolute() / "firmware"
        folder.mkdir(parents=True, exist_ok=True)
        self._peer: SocketAddress | None = None
        self._send: Send | None = None
        self._timer: TimerHandle | None = None
        self._program: Final = start_program(
            kind,
            binary,
            FirmwareOptionsWanted(
                world=world,
                vehicle=settings.vehicle,
                port=self._end.port,
                links=self._end.links,
                speedup=_AS_FAST_AS_IT_CAN,
                is_without_gps=settings.is_without_gps,
                parameters={**self._end.parameters, **parameters},
                folder=folder,
            ),
        )

    # -- time ---------------------------------------------------------------------------------------------------------

    def start(self, loop: AbstractEventLoop) -> None:
        """Has an event loop advance it from now on."""
        begin_s = loop.time()

        def turn() -> None:
            try:
                self.advance(loop.time() - begin_s)
            except Gloc3Error as error:  # nobody is above: the flight finds its autopilot silent
                self.problem = str(error)
            else:
                self._timer = loop.call_later(PERIOD_S, turn)

        self._timer = loop.call_later(PERIOD_S, turn)

    def stop(self) -> None:
        """Ends the firmware."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._program.kill()
        self._end.close()
        self._scratch.cleanup()

    def advance(self, now_s: float) -> None:
        """Simulates up to a time.

        Raises:
            Gloc3Error: the firmware has ended, or says nothing.
        """
        self._end.advance(now_s, self._await)
        self._receive()

    def _await(self, opened: socket.socket) -> None:
        for _ in range(round(_SILENT_S)):
            if select.select([opened], [], [], 1.0)[0]:
                return
            if self._program.exit_code is not None:
                break
        why = "does not respond" if self._program.exit_code is None else "has exited"
        raise Gloc3Error(f"{self._end.title} {why}: {self._program.last_lines()}")

    # -- the outside --------------------------------------------------------------------------------------------------

    def attach(self, send: Send, kind: LinkKind = LinkKind.COMPANION) -> Receive:
        """Connects its one MAVLink link.

        Args:
            send: called with each outgoing datagram.
            kind: ignored: the firmware streams on request.

        Returns:
            A callable for each piece of received data.
        """
        self._send = send
        return self._send_bytes

    def _receive(self) -> None:
        while True:
            try:
                data, self._peer = self._end.line.recvfrom(_LARGEST)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # it is starting anew
                continue
            if self._send is not None:
                self._send(data)

    def _send_bytes(self, data: bytes) -> None:
        if self._peer is not None:
            self._end.line.sendto(data, self._peer)

    def truth(self) -> Truth:
        """What the vehicle really does now."""
        return self._body.truth()

    @property
    def sensors(self) -> SensorSuite:
        """All sensors; the firmware uses `SENSORS`."""
        return self._body.sensors

    @property
    def wind(self) -> Wind:
        """What the air does; may be set at any time."""
        return self._body.body.wind

    @wind.setter
    def wind(self, wind: Wind) -> None:
        self._body.body.wind = wind

    @property
    def autopilot(self) -> Autopilot:
        """Not available: the firmware is the autopilot.

        Raises:
            Refused: always.
        """
        _none_of_ours()

    @property
    def pilot(self) -> Pilot:
        """Not available: there is no simulated transmitter.

        Raises:
            Refused: always.
        """
        _none_of_ours()

    def switch(self, power: SupplyState) -> None:
        """Not available: the firmware's power is not simulated.

        Raises:
            Refused: always.
        """
        _none_of_ours()


def _none_of_ours() -> NoReturn:
    raise Refused("a real firmware has no simulated pilot and no power switch")
