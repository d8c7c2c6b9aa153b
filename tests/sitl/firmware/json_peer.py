"""A peer that behaves as the JSON client of ArduPilot's simulation does, from what is known of its interface.

It speaks first, counts what it accepts, and reads the answer with a scanner for substrings, not with a JSON parser: a line
counts with a line feed before and after it, keys are found anywhere, and a vector must follow its colon at once.
"""

import re
import struct
from typing import Final

MAGIC = {16: 18458, 32: 29569}
_NUMBER: Final = r"\s*([-+0-9.eE]+)"
_VECTORS: Final = {"gyro": 3, "accel_body": 3, "position": 3, "quaternion": 4, "velocity": 3}


class JsonPeer:
    def __init__(self, channels: int = 16) -> None:
        self.channels = channels
        self.frame = 0
        self.now_s = 0.0
        self.state: dict[str, tuple[float, ...]] = {}
        self.jumps = 0
        self._buffer = b""
        self._last_s = 0.0

    def servos(self, *pwm_us: int) -> bytes:
        """Its outputs; those not given are at 1000."""
        pulses = (*pwm_us, *(1000 for _ in range(self.channels - len(pwm_us))))
        return struct.pack(f"<HHI{self.channels}H", MAGIC[self.channels], 800, self.frame, *pulses)

    def take(self, data: bytes) -> bool:
        """Reads an answer; whether it is accepted."""
        self._buffer += data.replace(b"\n", b"\0")
        end = self._buffer.rfind(b"\0")
        begin = self._buffer.rfind(b"\0", 0, end) if end > 0 else -1
        if begin < 0 or not self._scan(self._buffer[begin + 1 : end].decode()):
            return False
        self._buffer = self._buffer[end:]
        stamp_s = self.state["timestamp"][0]
        self.jumps += stamp_s < self._last_s
        self.now_s += max(0.0, stamp_s - self._last_s)
        self._last_s = stamp_s
        self.frame += 1
        return True

    def _scan(self, line: str) -> bool:
        found: dict[str, tuple[float, ...]] = {}
        for key in ("timestamp", *_VECTORS, "rng_1"):
            place = line.find(key, line.find("imu") if key in ("gyro", "accel_body") else 0)
            if place < 0:
                if key == "rng_1":
                    continue
                return False
            rest = line[place + len(key) + 2 :]
            count = _VECTORS.get(key)
            form = _NUMBER if count is None else r"\[" + ",".join([_NUMBER] * count)
            match = re.match(form, rest)
            if match is None:
                return False
            found[key] = tuple(map(float, match.groups()))
        self.state = found
        return True
