"""Mixer: collective thrust and three torques to four throttles, with priorities at saturation."""

from math import sqrt

Throttles = tuple[float, float, float, float]
"""Front right, rear left, front left, rear right; each 0..1."""

IDLE: Throttles = (0.0, 0.0, 0.0, 0.0)
"""Motors stopped."""


class Mixer:
    """Quadrotor in X seen from above: 0 front right and 1 rear left turn counter-clockwise, 2 front left and 3 rear right clockwise.

    At a limit yaw gives way first, then collective thrust, and only a demand beyond the whole range of a rotor scales
    roll and pitch down: a vehicle that is upright but turns or climbs wrongly can be flown, a toppled one cannot.
    """

    __slots__ = ("_half_linear", "_inverse_curve", "_is_linear", "idle_thrust", "is_saturated")

    def __init__(self, thrust_curve: float, idle_thrust: float = 0.02) -> None:
        self.idle_thrust = idle_thrust
        """Least thrust of a rotor while armed, as a fraction, so that none stops in flight."""
        self.is_saturated = False
        """Whether the last mix could not give all that was asked; integrators then stand still."""
        self._is_linear = thrust_curve < 1e-6
        self._inverse_curve = 0.0 if self._is_linear else 1.0 / thrust_curve
        self._half_linear = 0.0 if self._is_linear else (1.0 - thrust_curve) / (2.0 * thrust_curve)

    def mix(self, thrust: float, roll: float, pitch: float, yaw: float) -> Throttles:
        """Throttles for a collective thrust 0..1 and torques, all as fractions of full thrust of each rotor."""
        low, high = self.idle_thrust, 1.0
        tilt = abs(roll) + abs(pitch)
        saturated = False
        if tilt > 0.5 * (high - low):
            scale = 0.5 * (high - low) / tilt
            roll *= scale
            pitch *= scale
            tilt = 0.5 * (high - low)
            saturated = True
        # Collective moves just as far as roll and pitch need, and yaw takes what is left on the nearer side.
        if thrust - tilt < low:
            thrust = low + tilt
            saturated = True
        elif thrust + tilt > high:
            thrust = high - tilt
            saturated = True
        below, above = thrust - tilt - low, high - thrust - tilt
        room = min(below, above)
        # A little yaw authority is always kept, at the cost of lift at the upper limit.
        if room < 0.04 and thrust + tilt + 0.04 > high:
            thrust = max(high - tilt - 0.04, low + tilt)
            room = min(thrust - tilt - low, high - thrust - tilt)
        if yaw > room:
            yaw = room
            saturated = True
        elif yaw < -room:
            yaw = -room
            saturated = True
        self.is_saturated = saturated
        front_right = thrust - roll + pitch + yaw
        rear_left = thrust + roll - pitch + yaw
        front_left = thrust + roll + pitch - yaw
        rear_right = thrust - roll - pitch - yaw
        if self._is_linear:
            return (front_right, rear_left, front_left, rear_right)
        half, inverse = self._half_linear, self._inverse_curve
        square = half * half
        return (
            sqrt(square + front_right * inverse) - half if front_right > 0.0 else 0.0,
            sqrt(square + rear_left * inverse) - half if rear_left > 0.0 else 0.0,
            sqrt(square + front_left * inverse) - half if front_left > 0.0 else 0.0,
            sqrt(square + rear_right * inverse) - half if rear_right > 0.0 else 0.0,
        )
