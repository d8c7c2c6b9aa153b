"""Where the vehicle is and how it moves, from noisy sensors.

`estimator` fuses what `sources` admit.
"""

__all__ = ["estimator", "sources"]
