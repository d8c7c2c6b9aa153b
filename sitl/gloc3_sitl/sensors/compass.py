"""The heading reference of underwater dead reckoning: its error grows with the distance travelled."""

from gloc3.messages.frames import GeoPoint
from gloc3_sitl.sensors.magnetometer import Magnetometer

NOISE_TESLA = 1e-7
"""White noise of the RM3100 class, tens of nanotesla, with the vehicle's own."""
BIAS_TESLA = 5e-8
"""Standard deviation of the residual vehicle field: 0.15 degrees of heading, the figure of compact fibre-optic
gyrocompasses of survey vehicles (Exail Phins Compact C3); purely magnetic compasses have twice that (PNI TRAX2: 0.3
degrees)."""


class Compass(Magnetometer):
    """White noise and a bias that is constant for a dive."""

    def __init__(self, seed: int, home: GeoPoint, rate_hz: float = 25.0) -> None:
        super().__init__(seed, home, rate_hz, noise_tesla=NOISE_TESLA, bias_tesla=BIAS_TESLA)
