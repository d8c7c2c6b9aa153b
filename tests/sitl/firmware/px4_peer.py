"""A peer that behaves as PX4's simulator module in lock-step does, from its public interface.

It speaks first (a heartbeat, and a wish for the truth); it lives by the time of HIL_SENSOR and refuses one that stands or goes
back; while it boots it only listens; then each HIL_SENSOR with a turn rate is a control step, answered by one
HIL_ACTUATOR_CONTROLS with that time. Groups of fields count only where all of their bits are set.
"""

from collections import Counter
from collections.abc import Callable

from gloc3.mavlink import codec
from gloc3.mavlink.codec import Encoder, Parser
from gloc3.mavlink.message import MavlinkMessage

ACCEL, GYRO, MAG, BARO, DIFF = 0b111, 0b111000, 0b111000000, 0b1101000000000, 0b10000000000
GROUPS = {"accel": ACCEL, "gyro": GYRO, "mag": MAG, "baro": BARO, "diff_press": DIFF}
LOCK_STEP, CUSTOM, ARMED = 1, 1, 128

Control = Callable[["Px4Peer"], list[float]]


class Px4Peer:
    def __init__(self, boot_steps: int = 25, control: Control | None = None, flags: int = LOCK_STEP) -> None:
        self.now_us = 0
        self.boot_steps = boot_steps
        self.flags = flags
        self.control = control
        self.is_armed = control is not None
        self.sensor: MavlinkMessage | None = None
        self.truth: MavlinkMessage | None = None
        self.fix: MavlinkMessage | None = None
        self.range: MavlinkMessage | None = None
        self.counts: Counter[str] = Counter()
        self.answered = 0
        self._parser = Parser()
        self._encoder = Encoder(1, 1)

    def send_hello(self) -> bytes:
        heartbeat = codec.message("HEARTBEAT", autopilot=12)
        wanted = codec.message("COMMAND_LONG", command=511, param1=115, param2=5e3)
        return self._encoder.encode(heartbeat) + self._encoder.encode(wanted)

    def take(self, data: bytes) -> bytes:
        """Reads what has come; what it answers."""
        out = b""
        for frame in self._parser.receive(data):
            message = codec.decode(frame)
            assert message is not None
            self.counts[message.name] += 1
            match message.name:
                case "HIL_SENSOR":
                    out += self._live(message)
                case "HIL_STATE_QUATERNION":
                    self.truth = message
                case "HIL_GPS":
                    self._has_time()
                    self.fix = message
                case "DISTANCE_SENSOR":
                    self._has_time()
                    self.range = message
        return out

    def _has_time(self) -> None:
        assert self.now_us > 0, "a reading before the first HIL_SENSOR has no time"

    def _live(self, message: MavlinkMessage) -> bytes:
        assert message.id_ == 0, "only unit 0 drives the time"
        assert message.time_usec > self.now_us, f"time goes back from {self.now_us} to {message.time_usec}"
        self.now_us = message.time_usec
        self.sensor = message
        for name, bits in GROUPS.items():
            if message.fields_updated & bits == bits:
                self.counts[name] += 1
            else:
                assert message.fields_updated & bits == 0, f"{name} is only half there"
        if not message.fields_updated & GYRO:
            return b""
        if self.boot_steps > 0:
            self.boot_steps -= 1
            return b""
        self.answered += 1
        return self._encoder.encode(
            codec.message(
                "HIL_ACTUATOR_CONTROLS",
                time_usec=self.now_us,
                mode=CUSTOM | (ARMED if self.is_armed else 0),
                flags=self.flags,
                controls=[*(self.control(self) if self.control else [0.0] * 4), *[0.0] * 12],
            )
        )
