"""Arguments of `point_camera`: a gimbal looks in a direction, or at a point."""

from math import radians
from typing import Annotated

import msgspec

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3
from gloc3.mission.model.arguments import Arguments, Degrees, GeoPosition, LocalPosition
from gloc3.mission.model.legs import Budget
from gloc3.mission.model.placement import Placement, written_for

SLEW_S = 3.0
"""Time that is counted for the motion of the gimbal, s."""


class PointCameraOrder(Arguments, frozen=True, kw_only=True):
    """Point a gimbal, in NED."""

    resources = ("gimbal",)

    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    is_from_north: bool = False
    """Whether the yaw is measured from north, else from the nose."""
    point_ned_m: Vector3 | None = None
    """Look there instead."""
    keep: bool = False

    @property
    def is_endless(self) -> bool:
        """It is, if it is to be kept."""
        return self.keep

    def time_needed_s(self, start_ned_m: Vector3, budget: Budget) -> float:
        """The motion of the gimbal."""
        del start_ned_m, budget
        return 0.0 if self.keep else SLEW_S


class PointCamera(Arguments, frozen=True, kw_only=True):
    """Point the camera on the gimbal in a direction or at a point; done when the gimbal reports that it looks there."""

    resources = ("gimbal",)
    one_of = (("pitch_deg", "look_at_m", "look_at"),)
    example = "{pitch_deg: -45}"

    pitch_deg: Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)] | None = None
    """Angle from the horizon: 0 looks level, -90 straight down."""
    yaw_deg: Degrees | None = None
    """With `pitch_deg`: angle from the nose, clockwise; 0 if neither this nor `heading_deg` is given."""
    heading_deg: Degrees | None = None
    """With `pitch_deg`, instead of `yaw_deg`: direction from north, clockwise, kept when the vehicle turns."""
    look_at_m: LocalPosition | None = None
    """Point `[x, y, height]` to look at, in a local frame."""
    look_at: GeoPosition | None = None
    """Point `[latitude, longitude, height]` to look at, in frame geo."""
    keep: bool = False
    """Keep looking there until the action is ended, such as by `until`: a point is followed while the vehicle moves."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.yaw_deg is not None and self.heading_deg is not None:
            raise ValueError("only one of yaw_deg and heading_deg may be given")
        if self.pitch_deg is None and (self.yaw_deg is not None or self.heading_deg is not None):
            raise ValueError("yaw_deg and heading_deg go with pitch_deg, not with a point")

    @property
    def is_endless(self) -> bool:
        """It is, if it is to be kept."""
        return self.keep

    def order(self, placement: Placement) -> PointCameraOrder:
        """The direction in radians, or the point in NED.

        Raises:
            Refused: a position is written for another kind of frame.
        """
        point = written_for(placement, self.look_at_m, self.look_at, "look_at")
        if self.pitch_deg is None and point is None:
            raise Refused(f"look_at{'' if placement.is_geo else '_m'} is missing")
        is_from_north = self.heading_deg is not None
        yaw_deg = self.heading_deg if self.heading_deg is not None else self.yaw_deg or 0.0
        return PointCameraOrder(
            pitch_rad=radians(self.pitch_deg or 0.0),
            yaw_rad=radians(yaw_deg),
            is_from_north=is_from_north,
            point_ned_m=None if point is None else placement.ned_from(point),
            keep=self.keep,
        )
