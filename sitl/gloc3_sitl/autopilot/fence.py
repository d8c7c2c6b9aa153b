"""The geofence: polygons, circles, and the plain limits of distance and height."""

from collections.abc import Sequence
from math import hypot

from gloc3.messages.frames import TangentPlane, Vector3
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.plans import StoredItem
from gloc3_sitl.autopilot.tuning import FailsafeAction

Point = tuple[float, float]
LOAD_S = 0.3
"""Time after which ArduPilot has loaded an uploaded fence; before, it has none, and cannot enable one."""


def is_inside(point: Point, corners: Sequence[Point]) -> bool:
    """Whether a point lies in a polygon (crossing number)."""
    x, y = point
    inside = False
    last_x, last_y = corners[-1]
    for corner_x, corner_y in corners:
        if (corner_y > y) != (last_y > y) and x < (last_x - corner_x) * (y - corner_y) / (last_y - corner_y) + corner_x:
            inside = not inside
        last_x, last_y = corner_x, corner_y
    return inside


class FenceMonitor:
    """Checks the position against the fence; polygons are converted to NED once."""

    __slots__ = (
        "_circles",
        "_items",
        "_origin",
        "_polygons",
        "_stored",
        "_stored_s",
        "breach_s",
        "breaches",
        "is_broken",
        "is_newly_broken",
    )

    def __init__(self) -> None:
        self.is_broken = False
        self.is_newly_broken = False
        """Whether that was not reported yet."""
        self.breaches = 0
        """Times that it was broken in flight."""
        self.breach_s = 0.0
        """When it was broken last."""
        self._stored: tuple[StoredItem, ...] = ()
        self._stored_s = 0.0
        self._items: tuple[StoredItem, ...] = ()
        self._origin: TangentPlane | None = None
        self._polygons: list[tuple[list[Point], bool]] = []
        self._circles: list[tuple[Point, float, bool]] = []

    def tick(self, craft: Craft) -> None:
        """Notices a fence that has been uploaded."""
        if self._stored is not craft.plans.fence:
            self._stored, self._stored_s = craft.plans.fence, craft.now_s

    def _is_loaded(self, craft: Craft) -> bool:
        """Whether the uploaded fence has an effect in ArduPilot; that takes an origin, too."""
        is_taken = self._stored is craft.plans.fence and craft.now_s - self._stored_s >= LOAD_S
        return is_taken and craft.estimator.origin is not None

    def watch(self, craft: Craft) -> str:
        """The same as `breach`, and counts: for the failsafe, in flight."""
        broken = self.breach(craft)
        if broken and not self.is_broken:
            self.breaches += 1
            self.breach_s = craft.now_s
            self.is_newly_broken = True
        self.is_broken = bool(broken)
        return broken

    def is_present(self, craft: Craft) -> bool:
        """Whether ArduPilot would enforce any limit with the fence enabled."""
        tuning = craft.tuning
        has_areas = bool(craft.plans.fence) and tuning.fence_has_polygons and self._is_loaded(craft)
        return has_areas or any((tuning.fence_height_m, tuning.fence_depth_m, tuning.fence_radius_m))

    def is_kept(self, craft: Craft) -> bool:
        """Whether it is enabled and enforced rather than only reported, as in SYS_STATUS."""
        tuning = craft.tuning
        return self.is_present(craft) and tuning.fence_is_on and tuning.fence_action > FailsafeAction.WARN

    def breach(self, craft: Craft, place_ned_m: Vector3 | None = None) -> str:
        """Returns which limit is breached at a position, or at the vehicle's; empty inside the fence."""
        tuning = craft.tuning
        if not tuning.fence_is_on:
            return ""
        n, e, down = craft.estimator.inertial.position_ned_m if place_ned_m is None else place_ned_m
        height = (0.0 if craft.home is None else craft.home.position_ned_m[2]) - down
        if tuning.fence_height_m > 0.0 and height > tuning.fence_height_m:
            return f"above the fence height of {tuning.fence_height_m:.0f} m"
        if tuning.fence_depth_m > 0.0 and height < -tuning.fence_depth_m:
            return f"below the fence depth of {tuning.fence_depth_m:.0f} m"
        if craft.home is not None and tuning.fence_radius_m > 0.0:
            home_n, home_e, _ = craft.home.position_ned_m
            if hypot(n - home_n, e - home_e) > tuning.fence_radius_m:
                return f"farther from home than {tuning.fence_radius_m:.0f} m"
        origin = craft.estimator.origin
        if origin is None or not craft.plans.fence or not tuning.fence_has_polygons:
            return ""
        self._prepare(craft, origin)
        inclusions = False
        inside_any = False
        for corners, is_inclusion in self._polygons:
            inside = is_inside((n, e), corners)
            if not is_inclusion and inside:
                return "inside an exclusion area"
            inclusions |= is_inclusion
            inside_any |= is_inclusion and inside
        for (centre_n, centre_e), radius, is_inclusion in self._circles:
            inside = hypot(n - centre_n, e - centre_e) <= radius
            if not is_inclusion and inside:
                return "inside an exclusion area"
            inclusions |= is_inclusion
            inside_any |= is_inclusion and inside
        return "outside the fence" if inclusions and not inside_any else ""

    def _prepare(self, craft: Craft, origin: TangentPlane) -> None:
        if self._items is craft.plans.fence and self._origin is origin:
            return
        self._items, self._origin = craft.plans.fence, origin
        altitude = origin.origin.altitude_m
        self._polygons = [
            ([origin.ned_from_geo(place[0], place[1], altitude)[:2] for place in polygon.corners], polygon.is_inclusion)
            for polygon in craft.plans.polygons
        ]
        self._circles = [
            (
                origin.ned_from_geo(circle.centre[0], circle.centre[1], altitude)[:2],
                circle.radius_m,
                circle.is_inclusion,
            )
            for circle in craft.plans.circles
        ]
