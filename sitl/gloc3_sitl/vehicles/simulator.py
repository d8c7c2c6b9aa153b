"""A complete simulated vehicle: physics, sensors and autopilot, advanced in time, with MAVLink links."""

from asyncio import AbstractEventLoop, TimerHandle
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from math import inf, radians
from typing import Final

import msgspec
from msgspec.structs import replace

from gloc3.clock import VIRTUAL_EPOCH_S
from gloc3.messages.envelope import Severity
from gloc3_sitl.autopilot.autopilot import Autopilot
from gloc3_sitl.autopilot.control.control import Outputs
from gloc3_sitl.autopilot.mavlink.front import Front
from gloc3_sitl.autopilot.mavlink.links import LinkKind, Receive, Send
from gloc3_sitl.autopilot.periods import STEP_S
from gloc3_sitl.autopilot.pilot import Pilot
from gloc3_sitl.autopilot.sources import WITHOUT_SATELLITES
from gloc3_sitl.autopilot.surroundings import FailureKind, FailureUnit, SupplyState
from gloc3_sitl.autopilot.verdict import RequestVerdict
from gloc3_sitl.faults.injection import inject
from gloc3_sitl.physics.body import Situation
from gloc3_sitl.physics.ground import PERIOD_STEPS, raise_ground
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.physics.wind import CALM, Wind
from gloc3_sitl.sensors.battery import Battery
from gloc3_sitl.sensors.imu import SimulatedImu
from gloc3_sitl.sensors.magnetic_field import declination_deg
from gloc3_sitl.sensors.range_finder import level_ground
from gloc3_sitl.sensors.readings import Reading
from gloc3_sitl.sensors.suite import SensorSuite
from gloc3_sitl.vehicles.table import VehicleRow, style_of, vehicle_named
from gloc3_sitl.world import World
from gloc3_sitl.world.probe import WorldProbe

PERIOD_S: Final = 0.02
"""How often a running simulator advances, in simulated time: the period of the autopilot's outer loops."""

BOOT_S: Final = 1.5
"""Boot time of the autopilot, during which it neither sends nor receives, s."""
_MOST_LATE_S: Final = 5.0
"""Lag behind the wall clock beyond which the simulation stops catching up, s."""
_MOST_AT_ONCE_S: Final = 0.5
"""So much is caught up with before others have their turn."""


class _Wire:
    """The external side of a link; it survives a reboot of the autopilot behind it."""

    __slots__ = ("is_datagram", "kind", "receive", "send")

    def __init__(self, send: Send, kind: LinkKind, is_datagram: bool) -> None:
        self.send, self.kind, self.is_datagram = send, kind, is_datagram
        self.receive: Receive = _deaf

    def pass_on(self, data: bytes) -> None:
        """Forwards received data."""
        self.receive(data)


def _deaf(data: bytes) -> None:
    """Nobody is there."""


class SimulatorSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of a simulated vehicle, without the world."""

    vehicle: str = "pelican"
    """The name of a model."""
    style: str | None = None
    """`px4` or `ardupilot`; None for the usual one of the vehicle."""
    seed: int = 0
    """Of turbulence and of all sensor noise."""
    wind: Wind = CALM
    is_plain_gps: bool = False
    """Metre-level fixes in place of RTK-grade ones, unless the receiver is sent corrections (`GPS_RTCM_DATA`)."""
    is_without_gps: bool = False
    """No fixes at all; the autopilot is set to fly by `ODOMETRY`."""
    battery_remaining: float = 1.0
    """Charge at the start, 1 to 0."""
    parameters: Mapping[str, float] = {}
    """Autopilot parameters that differ from their defaults."""


class Simulator:
    """One vehicle in one world.

    It has no clock: `advance` steps it to a time, and `start` has an event loop do so, in virtual or wall time. The
    same arguments and the same data at the same times give the same flight, bit for bit.

    Args:
        world: scene of the flight.
        settings: vehicle, autopilot and sensors.

    Raises:
        Misuse: no such autopilot style, or no such vehicle.
        Refused: a parameter does not exist or is out of bounds.
    """

    def __init__(
        self,
        world: World,
        settings: SimulatorSettings = SimulatorSettings(),  # noqa: B008 - immutable
    ) -> None:
        row = vehicle_named(settings.vehicle)
        self.style: Final = style_of(settings.vehicle, settings.style)
        """Name of the autopilot."""
        self.world: Final = world
        self._vehicle_class: Final = row.vehicle_class
        self.body: Final = row.body(
            Situation(
                home=world.home,
                wind=settings.wind,
                water=world.water,
                seed=settings.seed,
                rate_hz=round(1.0 / STEP_S),
                heading_deg=world.heading_deg,
            )
        )
        self.sensors: Final = _sensors(row, world, settings)
        self._style: Final = row.styles[self.style]
        self.autopilot = self._new_autopilot()
        self._set_parameters(row, settings)
        self.autopilot.utc_offset_s = VIRTUAL_EPOCH_S
        self.texts: Final[deque[tuple[float, Severity, str]]] = deque(maxlen=200)
        """Latest status texts of the autopilot: time, severity, text."""
        self.text_count = 0
        """Number of status texts so far."""
        self.front = Front(self.autopilot)
        self._wires: list[_Wire] = []
        self._step: Callable[[Sequence[Reading], float], Outputs] = self.autopilot.step
        self._boot_s = 0.0
        self._up_s = inf
        self.late = 0
        """Times that a wall clock ran away."""
        self._outputs = self._idle = self.autopilot.control.stopped
        self._timer: TimerHandle | None = None
        self._is_flat, self._is_diving = world.is_flat, row.is_diving
        self.motors_left: Final[dict[int, float]] = {}
        """The share of its output that is left of a motor that fails, by the motor's number from 1."""

    def _set_parameters(self, row: VehicleRow, settings: SimulatorSettings) -> None:
        changed = dict(row.parameters.get(self.style, {}))
        if settings.is_without_gps:
            self.sensors.fail("fix", "lost")
            changed |= WITHOUT_SATELLITES[self.style]
        for name, value in (*changed.items(), *settings.parameters.items()):
            self.autopilot.parameters.set(name, value)

    # -- time ---------------------------------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""
        return self.body.now_s

    def advance(self, now_s: float) -> None:
        """Simulates up to a time, in whole steps of 5 ms; a time that is past already changes nothing."""
        body, sample = self.body, self.sensors.sample
        outputs = self._outputs
        rate_hz = body.rate_hz
        for count in range(body.steps + 1, int(now_s * rate_hz + 1e-6) + 1):
            body.step(outputs if not self.motors_left else self._weakened(outputs))
            t_s = count / rate_hz
            outputs = self._step(sample(body, t_s), t_s)
            if not self._is_flat and count % PERIOD_STEPS == 0:
                raise_ground(body, self.world, self.now_s, is_diving=self._is_diving)
        self._outputs = outputs

    def _weakened(self, outputs: Outputs) -> Outputs:
        """What failing motors make of the outputs."""
        return tuple(value * self.motors_left.get(number, 1.0) for number, value in enumerate(outputs, start=1))

    def start(self, loop: AbstractEventLoop, speed: float = 1.0) -> None:
        """Has an event loop advance it from now on, at `speed` times the loop's clock."""
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
        """Stops the advance that `start` began."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    # -- the outside --------------------------------------------------------------------------------------------------

    def attach(self, send: Send, kind: LinkKind = LinkKind.COMPANION, *, is_datagram: bool = True) -> Receive:
        """Connects a MAVLink link.

        Args:
            send: called with each outgoing frame.
            kind: purpose of the link; selects the telemetry that starts without a request.
            is_datagram: whether each received piece holds whole frames.

        Returns:
            A callable for each piece of received data.
        """
        wire = _Wire(send, kind, is_datagram)
        self._wires.append(wire)
        if not self.is_down:
            wire.receive = self.front.attach(send, kind, is_datagram=is_datagram)
        return wire.pass_on

    @property
    def pilot(self) -> Pilot:
        """The human pilot's transmitter."""
        return self.autopilot.pilot

    def truth(self) -> Truth:
        """What the vehicle really does now."""
        return self.body.truth()

    @property
    def wind(self) -> Wind:
        """What the air does; may be set at any time."""
        return self.body.wind

    @wind.setter
    def wind(self, wind: Wind) -> None:
        self.body.wind = wind

    # -- power --------------------------------------------------------------------------------------------------------

    @property
    def is_down(self) -> bool:
        """Whether the autopilot is booting or switched off."""
        return self._step == self._stay_down

    @property
    def is_off(self) -> bool:
        """Whether the autopilot is permanently switched off."""
        return self.is_down and self._up_s == inf

    def switch(self, power: SupplyState) -> None:
        """Reboots the autopilot or powers it off, from the next step on."""
        self._up_s = self.now_s + BOOT_S if power is SupplyState.REBOOT else inf
        self._step = self._go_down

    def _go_down(self, readings: Sequence[Reading], t_s: float) -> Outputs:
        for wire in self._wires:
            wire.receive = _deaf
        self._step = self._stay_down
        return self._stay_down(readings, t_s)

    def _stay_down(self, readings: Sequence[Reading], t_s: float) -> Outputs:
        del readings
        if t_s >= self._up_s:
            self._boot(t_s)
        return self._idle

    def _boot(self, t_s: float) -> None:
        """Boots with the autopilot's clock at 0 and the contents of its memory card."""
        before, front = self.autopilot, self.front
        self.autopilot = self._new_autopilot(before)
        self.autopilot.utc_offset_s = before.utc_offset_s + t_s - self._boot_s if before.utc_offset_s else 0.0
        self.front = Front(self.autopilot, front)
        self._boot_s = t_s
        for wire in self._wires:
            wire.receive = self.front.attach(wire.send, wire.kind, is_datagram=wire.is_datagram)
        self._step = self._step_since_boot

    def _step_since_boot(self, readings: Sequence[Reading], t_s: float) -> Outputs:
        boot_s = self._boot_s
        shifted = [replace(reading, t_s=reading.t_s - boot_s) for reading in readings]
        return self.autopilot.step(shifted, t_s - boot_s)

    def _new_autopilot(self, before: Autopilot | None = None) -> Autopilot:
        declination = radians(declination_deg(self.world.home))
        return Autopilot(
            self._style,
            self._count_text,
            vehicle=self._vehicle_class,
            declination_rad=declination,
            surroundings=self,
            before=before,
        )

    def inject(self, unit: FailureUnit, failure: FailureKind) -> RequestVerdict:
        """Makes something fail, or repairs it."""
        return inject(self.sensors, self.autopilot, unit, failure)

    def correct(self, corrections: bytes) -> None:
        """Passes corrections of a base to the satellite receiver."""
        self.sensors.correct(corrections, self.now_s)

    # -- inside -------------------------------------------------------------------------------------------------------

    def _count_text(self, severity: Severity, text: str) -> None:
        self.text_count += 1
        self.texts.append((self.now_s, severity, text))
        self.autopilot.logger.note(text)
        self.front.send_text(severity, text)


def _sensors(row: VehicleRow, world: World, settings: SimulatorSettings) -> SensorSuite:
    seed = settings.seed
    return SensorSuite(
        seed,
        world.home,
        imu=SimulatedImu(seed, bias_share=row.imu_bias_share),
        battery=Battery(seed, row.pack, settings.battery_remaining),
        is_plain_gps=settings.is_plain_gps,
        probe=level_ground if world.is_flat else WorldProbe(world),
        more=row.sensors(seed, world.home),
    )


__all__ = ["PERIOD_S", "LinkKind", "Simulator", "SimulatorSettings"]
