"""Perception messages: sensor data, odometry and position estimates.

Frames: *frd* is the body (x forward, y right, z down), *rdf* a camera (x right, y down, z along the optical axis),
*ned* the tangent plane at the origin of the platform's local frame. Times of validity are in the envelope. Arrays are
sent as bytes, little endian, rows first.
"""

import zlib
from typing import Final

from gloc3.messages.envelope import Message
from gloc3.messages.frames import IDENTITY, Quaternion, Vector3


class ImuSample(Message, frozen=True):
    """A sample of the inertial measuring unit, with its biases."""

    rate_frd_rad_s: Vector3
    specific_force_frd_m_s2: Vector3
    """Acceleration less gravity: (0, 0, -9.81) at rest and level."""
    is_valid: bool = True
    reason: str = ""


class LaserScan(Message, frozen=True):
    """One turn of a range scanner, in its own plane: x forward, y left, angles counter-clockwise seen from above."""

    scanner: str
    angle_min_rad: float
    angle_step_rad: float
    range_min_m: float
    range_max_m: float
    """A range at or past it is *nothing seen*."""
    ranges_m: bytes
    """32-bit floats, one a beam."""
    duration_s: float = 0.0
    """From the first beam to the last; the time of validity is that of the last."""
    is_valid: bool = True
    reason: str = ""


class DepthImage(Message, frozen=True):
    """A depth camera's frame: the distance of what each pixel shows, along the optical axis (z of *rdf*)."""

    camera: str
    """The camera whose calibration says where each pixel looks."""
    width: int
    height: int
    data: bytes
    """Rows of 16-bit unsigned integers, `2 * height * width` bytes: depths in units of `scale_m`, 0 where none was
    measured."""
    scale_m: float = 0.001
    range_min_m: float = 0.0
    """What is nearer is not measured."""
    range_max_m: float = 65.535
    """What is farther away is not measured."""
    is_valid: bool = True
    reason: str = ""


class PointCloud(Message, frozen=True):
    """Points that a depth camera or a 3D scanner has measured, in the axes of the vehicle's body (*frd*)."""

    sensor: str
    data: bytes
    """Rows of x, y and z in metres as 32-bit floats, `12 * n` bytes, in any order."""
    origin_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """The point from which they were seen."""
    range_max_m: float = 0.0
    """What is farther away is not measured."""
    is_valid: bool = True
    reason: str = ""
    ages_s: bytes = b""
    """How long before the cloud's time each point was measured, as 32-bit floats in seconds; empty for all at once."""


CELL_UNKNOWN: Final = 0
CELL_FREE: Final = 1
CELL_OCCUPIED: Final = 2
MOST_CELLS: Final = 64_000_000
"""Cells of all layers of a map that is unpacked, at most."""


class OccupancyMap(Message, frozen=True):
    """What is free and what is occupied: a stack of level grids in the NED frame of the pose."""

    corner_ne_m: tuple[float, float]
    """North and east of the corner of the first cell: its least."""
    cell_m: float
    """Side of a cell."""
    rows: int
    """Cells from south to north."""
    columns: int
    """Cells from west to east."""
    layer_m: float
    """Thickness of a layer."""
    levels: list[int]
    """Numbers of the layers, the lowest first: number n is from n to n + 1 times `layer_m` above the frame's origin."""
    cells: bytes
    """Compressed with zlib: bytes of shape (layers, rows, columns), `CELL_UNKNOWN`, `CELL_FREE` or `CELL_OCCUPIED`."""
    level: int = 0
    """Number of the layer in which the vehicle is."""

    def layers(self) -> list[bytes]:
        """The states of each layer's cells, row by row.

        Raises:
            ValueError: there are not as many as the map has cells, or more than `MOST_CELLS`.
        """
        size = self.rows * self.columns
        if min(self.rows, self.columns) < 0 or size * max(1, len(self.levels)) > MOST_CELLS:
            raise ValueError(f"the map has {self.rows} rows and {self.columns} columns of cells")
        unpacker = zlib.decompressobj()
        try:
            cells = unpacker.decompress(self.cells, max(1, size * len(self.levels) + 1))
        except zlib.error as error:
            raise ValueError(f"the cells of the map cannot be unpacked: {error}") from error
        if len(cells) != size * len(self.levels):
            raise ValueError(f"the map has {len(cells)} cells in place of {size * len(self.levels)}")
        return [cells[number * size : (number + 1) * size] for number in range(len(self.levels))]

    def layer_of_vehicle(self) -> bytes:
        """The same of the layer nearest to the vehicle; empty for an empty map."""
        layers = self.layers()
        nearest = min(range(len(layers)), key=lambda number: abs(self.levels[number] - self.level), default=None)
        return b"" if nearest is None else layers[nearest]


class Features(Message, frozen=True):
    """Points that were found and matched in the pictures of one camera, or of a stereo pair (the paper's FDM)."""

    camera: str
    """The camera, or the left one of a pair."""
    ids: bytes
    """32-bit signed integers, one a point: the same for the same point from picture to picture."""
    pixels: bytes
    """32-bit floats, column and row of each point, as the lens showed them."""
    right_pixels: bytes = b""
    """The same in the right picture of a pair, not-a-number for a point that has no match there."""
    is_valid: bool = True
    reason: str = ""


class Odometry(Message, frozen=True):
    """Motion of the body since a moment of its past, by one source. Its time of validity is the end of the motion.

    Consecutive reports may share their reference: a key frame, the begin of a map. A direction that the source cannot
    tell has a variance of `UNKNOWN_VARIANCE`.
    """

    source: str
    reference_t_s: float
    """Time of the reference pose."""
    position_m: Vector3 = (0.0, 0.0, 0.0)
    """Where the body is now, in the axes of the reference."""
    reference_from_frd: Quaternion = IDENTITY
    """Attitude now, relative to the reference."""
    covariance: list[float] = []
    """6 by 6, rows first: position in the reference's axes (m2), then the rotation vector in the body's (rad2)."""
    is_level: bool = False
    """The axes of the reference are those of its body made level (its heading kept), not those of the body."""
    is_valid: bool = True
    reason: str = ""
    quality: float = 1.0
    """0 to 1."""
    shared: float = 0.3
    """Part of the covariance that is of errors which all reports from this reference have in common, 0 to 1."""
    drift: float = 1.0
    """By how many times the variances of these add up faster from reference to reference than if they were independent."""


class EstimatorPose(Message, frozen=True):
    """Pose of an estimator that is not ours, in axes of its own: z points down, and where x points nobody knows."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    """Of the estimator's own body: where the origin of its camera or inertial unit is."""
    world_from_body: Quaternion = IDENTITY
    """Attitude of that body, whose axes are forward, right and down."""
    covariance: list[float] = []
    """6 by 6, rows first: position in the estimator's axes (m2), then rotation vector (rad2); empty where not claimed."""
    reset_counter: int = 0
    """It has restarted, or jumped, when this changes."""
    is_valid: bool = True
    reason: str = ""
    quality: float = 1.0
    """0 to 1."""


class PositionFix(Message, frozen=True):
    """Position of a point on the body, measured from outside."""

    source: str
    position_ned_m: Vector3
    covariance: list[float]
    """3 by 3, rows first, m2, along north, east and down; large along a direction that is not seen."""
    lever_frd_m: Vector3 = (0.0, 0.0, 0.0)
    """Measured point on the body, from the body's origin."""
    is_valid: bool = True
    reason: str = ""
    quality: float = 1.0
    """0 to 1."""


class SourceState(Message, frozen=True):
    """State of one source in the fusion."""

    source: str
    is_used: bool
    reason: str = ""
    """Why it is not used."""
    accepted: int = 0
    rejected: int = 0
    """Turned down by the gate."""
    innovation: float = 0.0
    """Normalised innovation squared over its degrees of freedom, smoothed; 1 where the covariance is honest."""


class FusionState(Message, frozen=True):
    """Sources on which the pose of the platform rests."""

    sources: list[SourceState]
    gyroscope_bias_rad_s: Vector3 = (0.0, 0.0, 0.0)
    accelerometer_bias_m_s2: Vector3 = (0.0, 0.0, 0.0)


UNKNOWN_VARIANCE = 1e6
"""Of a direction that a source says nothing about, in m2 or rad2."""


def no_motion(source: str, reference_t_s: float, reason: str, *, is_level: bool = False) -> Odometry:
    """Odometry report of an odometer that cannot measure the motion."""
    unknown = [UNKNOWN_VARIANCE if index % 7 == 0 else 0.0 for index in range(36)]
    return Odometry(
        source=source,
        reference_t_s=reference_t_s,
        covariance=unknown,
        is_level=is_level,
        is_valid=False,
        reason=reason,
        quality=0.0,
    )


class BottomVelocity(Message, frozen=True):
    """Velocity over the bottom, as measured by a Doppler velocity log (DVL)."""

    velocity_frd_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Along the body's axes."""
    std_m_s: float = 0.0
    """White noise that the device claims for each axis."""
    altitude_m: float = 0.0
    """Distance to the floor; 0 where it is not known."""
    is_valid: bool = True
    """Whether it has bottom lock."""
    reason: str = ""


class WheelDistances(Message, frozen=True):
    """Distances that wheels have turned since their encoders began to count."""

    distances_m: tuple[float, ...] = ()
    """Way of each wheel's rim, in the order of its encoders; backwards counts down."""
    is_valid: bool = True
    reason: str = ""


class SatelliteFix(Message, frozen=True):
    """Position that a satellite receiver reports."""

    place_geo: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Latitude and longitude in degrees, altitude above mean sea level in metres."""
    std_m: float = 0.0
    """Standard deviation that the receiver claims along north and along east."""
    satellites: int = 0
    is_valid: bool = True
    reason: str = ""
    height_std_m: float = 0.0
    """Standard deviation that it claims of the altitude."""
    speed_m_s: float = 0.0
    """Over ground; 0 where it does not say."""
    course_deg: float = 0.0
    """Direction of its motion over ground, from north; 0 where it does not say."""
