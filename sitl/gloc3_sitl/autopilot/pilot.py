"""The human pilot with a transmitter: sticks and a mode switch, simulated."""

from dataclasses import dataclass, field
from math import inf


@dataclass(slots=True)
class Pilot:
    """State of the receiver. The transmitter is off until `switch_on` is called or a stick is moved."""

    is_on: bool = False
    """Whether the transmitter is on and in range."""
    roll: float = 0.0
    """Right positive, -1..1."""
    pitch: float = 0.0
    """Stick pulled (nose up, backwards) positive, -1..1."""
    yaw: float = 0.0
    """Clockwise positive, -1..1."""
    throttle: float = 0.5
    """0..1, centred at 0.5."""
    mode_wanted: str | None = None
    """Mode that the switch was just put to, until the autopilot has taken it."""
    arm_wanted: bool | None = None
    """What the arming switch was just put to, until the autopilot has taken it."""
    is_killed: bool = False
    """Kill switch: motors stop at once, in flight too."""
    last_seen_s: float = field(default=-1e9)
    """Last time that the receiver gave valid channels."""

    held_until_s: float = inf
    """Time until which the input counts: limited for a joystick over MAVLink, infinite for a transmitter."""

    @property
    def has_transmitter(self) -> bool:
        """Whether a transmitter is on; a joystick over MAVLink is none."""
        return self.is_on and self.held_until_s == inf

    def switch_on(self) -> None:
        """Switches the transmitter on with centred sticks."""
        self.is_on = True

    def switch_off(self) -> None:
        """Switches the transmitter off, or flies out of its range: no stick counts any more."""
        self.is_on = False
        self.roll = self.pitch = self.yaw = 0.0
        self.throttle = 0.5
        self.held_until_s = inf

    def sticks(self, *, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0, throttle: float = 0.5) -> None:
        """Holds the sticks like this."""
        self.is_on = True
        self.roll, self.pitch, self.yaw = (max(-1.0, min(1.0, value)) for value in (roll, pitch, yaw))
        self.throttle = max(0.0, min(1.0, throttle))

    def switch_mode(self, name: str) -> None:
        """Puts the mode switch to a mode, by the style's own name for it."""
        self.is_on = True
        self.mode_wanted = name

    def arm(self) -> None:
        """Sets the arming switch."""
        self.is_on = True
        self.arm_wanted = True

    def disarm(self) -> None:
        """Puts the arming switch off; PX4's style refuses that in flight, ArduPilot's stops the motors."""
        self.is_on = True
        self.arm_wanted = False

    def kill(self) -> None:
        """Throws the kill switch."""
        self.is_on = True
        self.is_killed = True

    def deflection(self) -> float:
        """How far the sticks are from their centres, throttle aside."""
        return max(abs(self.roll), abs(self.pitch), abs(self.yaw))
