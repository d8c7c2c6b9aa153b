"""Motion of a vehicle and the geographic origin of its frame, for the stations' map and charts.

Topics, below the platform's name: `ci/motion`, `ci/site`. On a slow link the motion is sent with the remaining
bandwidth. Whole numbers of small units keep a message within one frame of such a link.
"""

from gloc3.messages.envelope import Message

Whole3 = tuple[int, int, int]
"""Three whole numbers; the unit is in the name of the value."""


class MotionSummary(Message, frozen=True):
    """Motion of the vehicle, measured and wanted.

    Positions and velocities are x, y, height in the frame of the `SiteSummary`. Angles are hundredths of degrees, and
    headings count clockwise from north.
    """

    t_s: float
    attitude_cdeg: Whole3
    """Roll, pitch, heading."""
    position_cm: Whole3
    velocity_cm_s: Whole3
    is_pose_valid: bool
    setpoint_cm: Whole3 | None = None
    """Position setpoint; None without one."""
    setpoint_velocity_cm_s: Whole3 | None = None
    setpoint_heading_cdeg: int | None = None
    covariance_cm2: Whole3 | None = None
    """Of the position: xx, xy, yy; None where it is not known."""
    height_std_cm: int = 0
    """Standard deviation of the height; 0 where it is not known."""
    battery_cv: int = 0
    """Battery voltage in hundredths of volts; 0 where it is not known."""
    battery_ca: int = 0
    """Battery current in hundredths of amperes."""


class SiteSummary(Message, frozen=True):
    """Frame of the platform's reported positions, and home."""

    frame: str
    """Its name; empty where positions are north, west, height of the origin."""
    x_axis_bearing_deg: float
    """Of the x axis, clockwise from north; y points to the left of x."""
    origin_geo: tuple[float, float, float] | None = None
    """Latitude and longitude in degrees, altitude above mean sea level in metres; None where it is not known."""
    home_m: tuple[float, float, float] | None = None
    """Where the vehicle was armed, else its position on the ground: x, y, height; None where it is unknown."""
