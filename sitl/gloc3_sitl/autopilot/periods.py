"""The periods of the autopilot's loops."""

from typing import Final

STEP_S: Final = 0.005
"""Period of the inner loops."""
OUTER_STEPS: Final = 4
"""Inner periods in one of the outer loops."""
OUTER_S: Final = STEP_S * OUTER_STEPS
"""Period of the outer loops."""
