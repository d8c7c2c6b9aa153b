"""A sea state in time: how high the surface is, and how the water under it moves."""

from math import cos, exp, log, pi, radians, sin, sqrt, tau
from typing import Final

import numpy as np

from gloc3.messages.frames import GRAVITY_M_S2, Vector3
from gloc3_sitl.physics.water import Waves

_COMPONENTS: Final = 16
"""Sinusoids that make up the sea: enough that it does not repeat within an hour."""


class Sea:
    """Long-crested irregular waves on deep water, as a sum of linear (Airy) waves with seeded phases.

    The spectrum is the modified Pierson-Moskowitz one, `S(w) = A w^-5 exp(-B w^-4)` with `A = 4 pi^3 H^2 / (0.710 T)^4`
    and `B = 16 pi^3 / (0.710 T)^4` (T the peak period; Fossen 2021, section 10.2), cut into bands of equal energy.

    Args:
        waves: height, period and direction; None for a flat sea.
        seed: of the phases.
    """

    def __init__(self, waves: Waves | None, seed: int = 0) -> None:
        self.is_flat: Final = waves is None
        self.height_m: Final = 0.0 if waves is None else waves.height_m
        """Significant height of the waves."""
        self._components: Final[list[tuple[float, float, float, float]]] = []
        if waves is None:
            return
        scale = (0.710 * waves.period_s) ** 4
        falling = 16.0 * pi**3 / scale
        random = np.random.Generator(np.random.PCG64([seed, 0x5EA]))
        phases = random.uniform(0.0, tau, _COMPONENTS).tolist()
        # The energy below w is exp(-B w^-4) of the whole, so equal shares have their middles at these frequencies.
        shares = [(i + 0.5) / _COMPONENTS for i in range(_COMPONENTS)]
        amplitude_m = waves.height_m / 4.0 * sqrt(2.0 / _COMPONENTS)
        towards = radians(waves.from_deg + 180.0)
        self._north, self._east = cos(towards), sin(towards)
        self._components.extend(
            (amplitude_m, w, w * w / GRAVITY_M_S2, phase)
            for w, phase in zip(((falling / -log(share)) ** 0.25 for share in shares), phases, strict=True)
        )

    def elevation_m(self, north_m: float, east_m: float, t_s: float) -> float:
        """Height of the surface over the calm one."""
        if self.is_flat:
            return 0.0
        along = self._north * north_m + self._east * east_m
        return sum(a * cos(k * along - w * t_s + phase) for a, w, k, phase in self._components)

    def velocity_ned_m_s(self, north_m: float, east_m: float, depth_m: float, t_s: float) -> Vector3:
        """Orbital velocity of the water at a depth under the calm surface; it fades as `exp(-k depth)`."""
        if self.is_flat:
            return (0.0, 0.0, 0.0)
        along = self._north * north_m + self._east * east_m
        depth = max(0.0, depth_m)
        forward = up = 0.0
        for a, w, k, phase in self._components:
            sunk = k * depth
            if sunk > 8.0:
                continue
            speed, angle = a * w * exp(-sunk), k * along - w * t_s + phase
            forward += speed * cos(angle)
            up += speed * sin(angle)
        return (forward * self._north, forward * self._east, -up)
