"""ArduPilot bridge: answers each servo packet with the state one step later, in strict lock-step."""

from collections.abc import Hashable, Sequence
from typing import Final

from gloc3_sitl.firmware.body import SensedBody
from gloc3_sitl.firmware.json_wire import JsonState, Servos, read_servos, state_text
from gloc3_sitl.sensors.readings import ImuReading, RangeReading, Reading

RATE_HZ: Final = 800
"""Steps of the physics per second: ArduCopter does not arm with fewer than 1.8 samples of the gyro to each of its 400 loops."""
NO_ECHO_M: Final = 1000.0
"""Range sent without an echo, m; beyond any range finder, so that the firmware reports *out of range*."""


class ArduPilotBridge:
    """Steps a vehicle by the received servo packets and returns the replies.

    The firmware sends first and numbers its packets:

    * the next number is one step;
    * a repeated number is a retransmission after a lost reply: the last state is sent again, without a step;
    * a gap is one step, too: the bridge keeps the time, and only the skipped outputs are lost;
    * a smaller number is a restarted firmware: the vehicle restarts as well, at home, at time 0;
    * another sender is a restarted firmware if it counts from 0; otherwise it gets no reply.

    Args:
        body: the vehicle; `RATE_HZ` steps a second.
    """

    def __init__(self, body: SensedBody) -> None:
        self.steps = 0
        """Servo packets that were steps."""
        self.repeats = 0
        """Servo packets that came again."""
        self.skips = 0
        """Counts that never came."""
        self.restarts = 0
        """Number of restarts of the firmware."""
        self.refused = 0
        """Packets that are invalid or from a second firmware."""
        self._body: Final = body
        self._sender: Hashable | None = None
        self._frame = -1
        self._answer = b""
        self._imu: ImuReading | None = None
        self._range_m: float | None = None

    @property
    def is_alone(self) -> bool:
        """Whether no firmware has connected yet."""
        return self._sender is None

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""
        return self._body.now_s

    def receive(self, data: bytes, sender: Hashable) -> bytes | None:
        """Handles a datagram from the firmware.

        Args:
            data: one datagram.
            sender: its address.

        Returns:
            The reply to that sender, or None.
        """
        servos = read_servos(data)
        if servos is None:
            self.refused += 1
            return None
        if self._sender is None:
            self._begin(servos, sender)
        elif sender != self._sender:
            if servos.frame != 0:
                self.refused += 1
                return None
            self._restart(servos, sender)
        elif servos.frame < self._frame:
            self._restart(servos, sender)
        elif servos.frame == self._frame:
            self.repeats += 1
            return self._answer
        else:
            self.skips += servos.frame - self._frame - 1
            self._step(servos)
        return self._answer

    def _begin(self, servos: Servos, sender: Hashable) -> None:
        self._sender = sender
        self._step(servos)

    def _restart(self, servos: Servos, sender: Hashable) -> None:
        self.restarts += 1
        self._body.restart()
        self._imu = self._range_m = None
        self._begin(servos, sender)

    def _step(self, servos: Servos) -> None:
        self.steps += 1
        self._frame = servos.frame
        vehicle, pulses = self._body.vehicle_class, servos.pwm_us
        wanted_us = [
            pulses[number - 1] or vehicle.neutral_us for number in vehicle.output_numbers
        ]  # 0: no pulses at all
        self._keep_readings(
            self._body.step([(pulse_us - vehicle.neutral_us) / vehicle.span_us for pulse_us in wanted_us])
        )
        truth = self._body.truth()
        imu = self._imu
        force, rate = (
            (imu.specific_force_frd_m_s2, imu.rate_frd_rad_s)
            if imu is not None
            else (truth.specific_force_frd_m_s2, truth.rate_frd_rad_s)
        )
        self._answer = state_text(
            JsonState(
                t_s=truth.t_s,
                rate_frd_rad_s=rate,
                specific_force_frd_m_s2=force,
                position_ned_m=truth.position_ned_m,
                ned_from_frd=truth.attitude_wxyz,
                velocity_ned_m_s=truth.velocity_ned_m_s,
                range_m=self._range_m,
            )
        )

    def _keep_readings(self, readings: Sequence[Reading]) -> None:
        """Keeps the readings that this interface carries; the firmware simulates fixes, pressure and magnetic field."""
        for reading in readings:
            if isinstance(reading, ImuReading):
                self._imu = reading
            elif isinstance(reading, RangeReading):
                self._range_m = reading.distance_m if reading.is_valid else NO_ECHO_M
