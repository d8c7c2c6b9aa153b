"""Settings of the pose fusion."""

from typing import Annotated

from gloc3.component.settings import Bounds, Settings

Deviation = Annotated[float, Bounds(1e-6, 100.0)]


class FusionSettings(Settings, frozen=True):
    """Settings of the pose fusion; the defaults suit a small multirotor with a MEMS inertial unit."""

    start_ned_m: tuple[float, float, float] | None = None
    """Position of the body at the start; None waits for an external position or the autopilot's."""
    start_heading_deg: float | None = None
    """Heading at the start, clockwise from north; None takes the autopilot's."""
    start_std_m: Deviation = 0.005
    """How well the start is known."""
    start_heading_std_deg: Deviation = 0.2
    """How well the heading at the start is known."""
    gyroscope_noise: Deviation = 1e-4
    """Noise density of the gyroscopes, rad/s/√Hz."""
    accelerometer_noise: Deviation = 4e-3
    """Noise density of the accelerometers, m/s²/√Hz: the device's and the airframe's vibration."""
    gyroscope_walk: Deviation = 1e-5
    """How the gyroscopes' biases wander, rad/s/√s."""
    accelerometer_walk: Deviation = 3e-4
    """How the accelerometers' biases wander, m/s²/√s."""
    odometer_scale_std: Annotated[float, Bounds(0.0, 0.2)] = 0.01
    """Error of scale that an odometer may have and still agree with the others."""
    fix_correlation_s: Annotated[float, Bounds(0.0, 60.0)] = 0.0
    """How long the error of an absolute position lasts; within it, many positions tell hardly more than one. 0: not at all."""
    height_std_m: Deviation = 0.012
    """How well a range to the floor is measured, but for an error that stays: that goes into the level of the floor."""
    is_height_slant: bool = True
    """Heights are measured along the body's down axis, as a range finder does that is fixed to it; else vertically."""
    floor_walk: Deviation = 0.02
    """Random walk of the floor's level along the path, m/√m."""
    latest_s: Annotated[float, Bounds(0.05, 1.0)] = 0.5
    """A measurement that is older when it comes is turned down."""
    silent_s: Annotated[float, Bounds(0.1, 5.0)] = 0.5
    """Silence after which a source counts as lost."""
    probation_s: Annotated[float, Bounds(0.1, 30.0)] = 1.0
    """So long a source that was turned down must agree again before it is used."""
    window_s: Annotated[float, Bounds(1.0, 30.0)] = 6.0
    """Time window over which the sources are compared."""
    coast_s: Annotated[float, Bounds(0.1, 10.0)] = 2.5
    """So long the inertial unit alone may carry the pose; then it is not valid."""
    dispute_s: Annotated[float, Bounds(1.0, 120.0)] = 8.0
    """Longest conflict between sources that no third one can decide; then the pose becomes invalid."""
    std_limit_m: Annotated[float, Bounds(0.01, 10.0)] = 0.4
    """A pose with a greater standard deviation is not valid."""
    jump_m: Annotated[float, Bounds(0.01, 10.0)] = 0.1
    """A correction of more than this is counted as a jump, and takes three positions in a row that lead there; smaller ones
    are blended in."""
    blend_s: Annotated[float, Bounds(0.0, 2.0)] = 0.15
    """Time constant with which corrections come into the reported pose."""
