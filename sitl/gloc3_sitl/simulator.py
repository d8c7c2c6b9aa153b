"""A simulated vehicle, whole: physics, sensors and autopilot, advanced in time, with MAVLink links to the outside."""

from asyncio import AbstractEventLoop, TimerHandle
from collections import deque
from collections.abc import Mapping
from math import radians
from typing import Final

from gloc3.clock import VIRTUAL_EPOCH_S
from gloc3.errors import Misuse, nearest
from gloc3_sitl.autopilot.autopilot import STEP_S, Autopilot
from gloc3_sitl.autopilot.mavlink.front import Front
from gloc3_sitl.autopilot.mavlink.links import LinkKind, Receive, Send
from gloc3_sitl.autopilot.modes import Severity, Style
from gloc3_sitl.autopilot.pilot import Pilot
from gloc3_sitl.autopilot.sources import WITHOUT_SATELLITES
from gloc3_sitl.autopilot.styles.ardupilot import ARDUPILOT
from gloc3_sitl.autopilot.styles.px4 import PX4
from gloc3_sitl.physics import Quadrotor
from gloc3_sitl.sensors.height import level_ground
from gloc3_sitl.sensors.magnetic_field import declination_deg
from gloc3_sitl.sensors.suite import SensorSuite
from gloc3_sitl.truth import Truth
from gloc3_sitl.wind import CALM, Wind
from gloc3_sitl.world import World
from gloc3_sitl.world.probe import WorldProbe

STYLES: Final[Mapping[str, Style]] = {"px4": PX4, "ardupilot": ARDUPILOT}
"""Autopilots that can be simulated, by name."""

PERIOD_S: Final = 0.02
"""How often a running simulator advances, in simulated time: the period of the autopilot's outer loops."""

_GROUND_PERIOD_STEPS: Final = 10
_STEP_UP_M: Final = 0.3
"""What is higher above the vehicle than this is not ground that it has sunk into, but something that it is under."""
_MOST_LATE_S: Final = 5.0
"""A simulator that is further behind the wall clock than this gives up catching up: its clock slips."""
_MOST_AT_ONCE_S: Final = 0.5
"""So much is caught up with before others have their turn."""


class Simulator:
    """One vehicle in one world.

    It has no clock of its own: `advance` brings it to a time, and `start` has an event loop do so, in virtual or wall
    time. The same arguments, and the same data at the same times, give the same flight bit for bit.

    Args:
        world: where it flies.
        vehicle: what flies, by the name of a model.
        style: `px4` or `ardupilot`.
        seed: of turbulence and of all sensor noise.
        wind: what the air does.
        is_plain_gps: metre-level fixes in place of RTK-grade ones.
        is_without_gps: no fixes at all; the autopilot is set to fly by `ODOMETRY`.
        battery_remaining: charge at the start, 1 to 0.
        parameters: autopilot parameters that differ from their defaults.

    Raises:
        Misuse: no such autopilot style, or no such vehicle.
        Refused: a parameter does not exist or is out of bounds.
    """

    def __init__(
        self,
        world: World,
        *,
        vehicle: str = "pelican",
        style: str = "px4",
        seed: int = 0,
        wind: Wind = CALM,
        is_plain_gps: bool = False,
        is_without_gps: bool = False,
        battery_remaining: float = 1.0,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        if style not in STYLES:
            raise Misuse(f"no autopilot style {style!r}: {nearest(style, list(STYLES))}")
        self.world: Final = world
        self.quadrotor: Final = Quadrotor(
            vehicle, world.home, wind=wind, seed=seed, rate_hz=round(1.0 / STEP_S), heading_deg=world.heading_deg
        )
        self.sensors: Final = SensorSuite(
            seed,
            world.home,
            model=self.quadrotor.model,
            is_plain_gps=is_plain_gps,
            battery_remaining=battery_remaining,
            probe=level_ground if world.is_flat else WorldProbe(world),
        )
        self.autopilot: Final = Autopilot(
            STYLES[style], self._say, declination_rad=radians(declination_deg(world.home))
        )
        if is_without_gps:
            self.sensors.fail("fix", "lost")
            for name, value in WITHOUT_SATELLITES[style].items():
                self.autopilot.parameters.set(name, value)
        for name, value in (parameters or {}).items():
            self.autopilot.parameters.set(name, value)
        self.autopilot.utc_offset_s = VIRTUAL_EPOCH_S
        self.texts: Final[deque[tuple[float, Severity, str]]] = deque(maxlen=200)
        """What the autopilot said last: time, severity, text."""
        self.texts_said = 0
        """How many it has said in all."""
        self.front: Final = Front(self.autopilot)
        self.late = 0
        """Times that a wall clock ran away."""
        self._throttles = self.autopilot.throttles
        self._timer: TimerHandle | None = None
        self._is_flat = world.is_flat

    # -- time ---------------------------------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""
        return self.quadrotor.now_s

    def advance(self, now_s: float) -> None:
        """Simulates up to a time, in whole steps of 5 ms; a time that is past already changes nothing."""
        quadrotor, sample, step = self.quadrotor, self.sensors.sample, self.autopilot.step
        throttles = self._throttles
        rate_hz = quadrotor.rate_hz
        for count in range(quadrotor.steps + 1, int(now_s * rate_hz + 1e-6) + 1):
            quadrotor.step(throttles)
            t_s = count / rate_hz
            throttles = step(sample(quadrotor, t_s), t_s)
            if not self._is_flat and count % _GROUND_PERIOD_STEPS == 0:
                self._raise_ground()
        self._throttles = throttles

    def start(self, loop: AbstractEventLoop, speed: float = 1.0) -> None:
        """Has an event loop advance it from now on, `speed` times as fast as the loop's clock."""
        begin_s = loop.time()
        offset_s = self.now_s

        def turn() -> None:
            nonlocal begin_s, offset_s
            wanted_s = offset_s + (loop.time() - begin_s) * speed
            behind_s = wanted_s - self.now_s
            if behind_s > _MOST_LATE_S * max(1.0, speed):
                self.late += 1
                begin_s, offset_s = loop.time(), self.now_s + PERIOD_S
                wanted_s = offset_s
            self.advance(min(wanted_s, self.now_s + _MOST_AT_ONCE_S * max(1.0, speed)))
            next_s = begin_s + (self.now_s + PERIOD_S - offset_s) / speed
            self._timer = loop.call_at(next_s, turn)

        self._timer = loop.call_at(begin_s + PERIOD_S / speed, turn)

    def stop(self) -> None:
        """Ends what `start` began."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    # -- the outside --------------------------------------------------------------------------------------------------

    def attach(self, send: Send, kind: LinkKind = LinkKind.COMPANION, *, is_datagram: bool = True) -> Receive:
        """Connects a MAVLink link.

        Args:
            send: called with each frame that goes out.
            kind: what the link is for: it decides which telemetry begins by itself.
            is_datagram: whether each piece that comes in holds whole frames.

        Returns:
            What is to be called with each piece of data that comes in.
        """
        return self.front.attach(send, kind, is_datagram=is_datagram)

    @property
    def pilot(self) -> Pilot:
        """The human pilot's transmitter."""
        return self.autopilot.pilot

    def truth(self) -> Truth:
        """What the vehicle really does now."""
        return self.quadrotor.truth()

    @property
    def wind(self) -> Wind:
        """What the air does; may be set at any time."""
        return self.quadrotor.wind

    @wind.setter
    def wind(self, wind: Wind) -> None:
        self.quadrotor.wind = wind

    # -- inside -------------------------------------------------------------------------------------------------------

    def _say(self, severity: Severity, text: str) -> None:
        self.texts_said += 1
        self.texts.append((self.now_s, severity, text))
        self.autopilot.logger.note(text)
        self.front.say(severity, text)

    def _raise_ground(self) -> None:
        """Brings the ground under the vehicle to the height of the box or slope below it."""
        truth = self.quadrotor.truth()
        x, y, height = self.world.local(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
        ground_m = self.world.height_at(x, y, self.now_s, height + _STEP_UP_M)
        self.quadrotor.set_ground(self.world.frame.origin.altitude_m + ground_m)


__all__ = ["PERIOD_S", "STYLES", "LinkKind", "Simulator"]
