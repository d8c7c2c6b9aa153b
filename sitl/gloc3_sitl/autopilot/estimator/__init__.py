"""State estimation from noisy sensors.

`estimator` fuses what `sources` admit.
"""

__all__ = ["estimator", "sources"]
