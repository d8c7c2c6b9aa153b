"""Tracks of all vehicles of the fleet: past positions and motion, updated from changes of the fleet."""

from collections.abc import Iterator
from enum import IntEnum
from itertools import pairwise
from math import hypot, nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import Vector3
from gloc3.messages.motion import MotionSummary
from gloc3.messages.summaries import VehicleSummary
from gloc3.mission.model.states import ActionState
from gloc3_groundstation.mapping.history import History, HistoryLevel, HistorySeries, Singles
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

SAMPLES_KEPT: Final = 2400
"""As they came: ten minutes at 4 Hz."""
LEVELS: Final = (HistoryLevel(2.0, 1800), HistoryLevel(30.0, 1000))
"""An hour in steps of 2 s, and eight hours in steps of 30 s."""
GAP_S: Final = 3.0
"""Silence after which the track is interrupted, s."""
MOTION_SILENT_S: Final = 1.5
"""Time without motion messages after which the slower vehicle summary is used instead, s."""
DRIFT: Final = 2e-4
"""How much faster than the station's clock a platform's may run."""
Points = NDArray[np.float64]
"""Rows of `x_m, y_m, height_m, t_s`."""

FRESH: Final = 512
"""Points that are kept as they came, before they are thinned."""
MOST: Final = 4096
"""Points that are kept of the time before."""
FIRST_TOLERANCE_M: Final = 0.03
STANDING_M: Final = 0.02
"""A vehicle that moves less adds no point."""
GAP: Final = (np.nan, np.nan, np.nan, np.nan)


class Trail:
    """The trail of one vehicle over hours in bounded memory, in the frame in which it tells its position.

    Recent points are as received; older ones are thinned by Douglas and Peucker's rule (Cartographica 10, 1973): what is
    left out lies within a tolerance of the line that is left. When too many remain all the same, the tolerance is
    doubled. A row of NaN is a gap.
    """

    def __init__(self) -> None:
        self.tolerance_m = FIRST_TOLERANCE_M
        """Largest distance between the thinned track and the reported positions."""
        self._older: Points = np.empty((0, 4))
        self._fresh: Points = np.empty((FRESH, 4))
        self._count = 0

    def __len__(self) -> int:
        return len(self._older) + self._count

    @property
    def points(self) -> Points:
        """All points, the oldest first."""
        return np.concatenate((self._older, self._fresh[: self._count]))

    @property
    def bytes(self) -> int:
        """The memory it takes."""
        return self._older.nbytes + self._fresh.nbytes

    def add(self, t_s: float, position_m: Vector3) -> None:
        """Adds a point; one at the place of the last takes its place in time."""
        if self._count >= 2:
            last = self._fresh[self._count - 1, :3]
            before = self._fresh[self._count - 2, :3]
            if _near(last, position_m) and _near(before, position_m):
                self._fresh[self._count - 1, 3] = t_s
                return
        self._append((*position_m, t_s))

    def interrupt(self) -> None:
        """Marks a gap between here and the next point."""
        if self._count and not np.isnan(self._fresh[self._count - 1, 0]):
            self._append(GAP)

    def clear(self) -> None:
        """Clears the track."""
        self._older, self._count, self.tolerance_m = np.empty((0, 4)), 0, FIRST_TOLERANCE_M

    def _append(self, row: tuple[float, float, float, float]) -> None:
        if self._count == FRESH:
            self._settle()
        self._fresh[self._count] = row
        self._count += 1

    def _settle(self) -> None:
        """Thins the older half of the recent points, and all old ones where they have become too many."""
        half = FRESH // 2
        thin = thinned(self._fresh[: half + 1], self.tolerance_m)[:-1]
        self._older = np.concatenate((self._older, thin))
        self._fresh[: FRESH - half] = self._fresh[half:].copy()
        self._count -= half
        while len(self._older) > MOST:
            self.tolerance_m *= 2.0
            self._older = thinned(self._older, self.tolerance_m)
            if self.tolerance_m > 1e6:  # nothing but gaps
                self._older = self._older[-MOST:]


def thinned(points: Points, tolerance_m: float) -> Points:
    """The points that matter: ends, both sides of gaps, and what lies off the line between those that are kept."""
    keep = np.isnan(points[:, 0])
    bounds = [-1, *np.flatnonzero(keep).tolist(), len(points)]
    waiting = [(low + 1, high - 1) for low, high in pairwise(bounds) if high - low > 1]
    for first, last in waiting:
        keep[first] = keep[last] = True
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        inner = points[first + 1 : last, :3] - points[first, :3]
        along = points[last, :3] - points[first, :3]
        square = float(along @ along)
        share = np.clip(inner @ along / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(inner))
        off = inner - share[:, None] * along
        squares = np.einsum("ij,ij->i", off, off)
        farthest = int(squares.argmax())
        if squares[farthest] > tolerance_m * tolerance_m:
            middle = first + 1 + farthest
            keep[middle] = True
            waiting += [(first, middle), (middle, last)]
    return points[keep]


def _near(one: NDArray[np.float64], other: Vector3) -> bool:
    return all(abs(float(mine) - its) < STANDING_M for mine, its in zip(one, other, strict=True))


class TrackChannel(IntEnum):
    """A quantity recorded over time."""

    X = 0
    Y = 1
    HEIGHT = 2
    SPEED = 3
    """Horizontal."""
    CLIMB = 4
    ROLL = 5
    PITCH = 6
    HEADING = 7
    WANTED_X = 8
    WANTED_Y = 9
    WANTED_HEIGHT = 10
    WANTED_SPEED = 11
    WANTED_CLIMB = 12
    WANTED_HEADING = 13
    BATTERY_PERCENT = 14
    BATTERY_V = 15
    BATTERY_A = 16


class Track:
    """One vehicle's track."""

    def __init__(self) -> None:
        self.trail: Final = Trail()
        self.history: Final = History(len(TrackChannel), SAMPLES_KEPT, LEVELS)
        self.started_s: float | None = None
        """When its mission was started last; None if it never was."""
        self.latest: Singles = np.full(len(TrackChannel), nan, np.float32)
        """The newest sample."""
        self.latest_s: float | None = None
        self._frame: object = None
        self._ahead_s: float | None = None
        self._motion_s = float("-inf")

    @property
    def bytes(self) -> int:
        """The memory it takes."""
        return self.trail.bytes + self.history.bytes

    def series(self, channel: TrackChannel, from_s: float, to_s: float, points: int) -> HistorySeries:
        """A channel over a time range on the station's clock."""
        return self.history.series(channel, from_s, to_s, points)

    def follow(self, before: PlatformSnapshot | None, after: PlatformSnapshot) -> None:
        """Adds the changes between two snapshots."""
        self._stay_in_frame(after)
        if before is not None and before.boot != after.boot:
            self._ahead_s = None
        motion, vehicle = after.motion, after.vehicle
        if motion is not None and (before is None or before.motion is None or motion.value is not before.motion.value):
            self._motion_s = motion.received_s
            self._receive_motion(motion.value, self._when(motion.value.t_s, motion.received_s), after)
        elif (
            vehicle is not None
            and (before is None or vehicle is not before.vehicle)
            and vehicle.received_s - self._motion_s > MOTION_SILENT_S
        ):
            self._receive_vehicle(vehicle.value, vehicle.received_s)
        self._receive_mission(before, after)

    def _stay_in_frame(self, platform: PlatformSnapshot) -> None:
        """Clears the track when the frame of the positions has moved; its altitude alone follows an autopilot's home."""
        site = platform.site.value if platform.site is not None else None
        if site is None:
            return
        origin = site.origin_geo[:2] if site.origin_geo is not None else None
        frame = site.frame, origin, site.x_axis_bearing_deg
        if self._frame not in (None, frame):
            self.trail.clear()
            self.history.clear()
        self._frame = frame

    def _when(self, t_s: float, received_s: float) -> float:
        """The station's time of something that was so at a platform's time: as if all came as fast as the fastest."""
        ahead_s = received_s - t_s
        if self._ahead_s is None or not -GAP_S < ahead_s - self._ahead_s < 10.0 * GAP_S:
            self._ahead_s = ahead_s
        self._ahead_s = min(ahead_s, self._ahead_s + DRIFT)
        return t_s + self._ahead_s

    def _receive_motion(self, motion: MotionSummary, t_s: float, platform: PlatformSnapshot) -> None:
        vx, vy, climb = motion.velocity_cm_s
        wanted, speed = motion.setpoint_cm, motion.setpoint_velocity_cm_s
        heading = motion.setpoint_heading_cdeg
        percent = platform.vehicle.value.battery_percent if platform.vehicle is not None else -1
        position = motion.position_cm if motion.is_pose_valid else (nan, nan, nan)
        self._append(
            t_s,
            [
                *position,
                hypot(vx, vy) if motion.is_pose_valid else nan,
                climb if motion.is_pose_valid else nan,
                *motion.attitude_cdeg,
                *((nan, nan, nan) if wanted is None else wanted),
                nan if speed is None else hypot(*speed[:2]),
                nan if speed is None else speed[2],
                nan if heading is None else heading,
                100.0 * percent if percent >= 0 else nan,
                motion.battery_cv or nan,
                motion.battery_ca if motion.battery_cv else nan,
            ],
        )

    def _receive_vehicle(self, vehicle: VehicleSummary, t_s: float) -> None:
        row = [nan] * len(TrackChannel)
        if vehicle.is_pose_valid:
            row[:3] = [100.0 * value for value in vehicle.position_m]
            row[TrackChannel.SPEED] = 100.0 * vehicle.speed_m_s
        if vehicle.heading_deg >= 0:
            row[TrackChannel.HEADING] = 100.0 * vehicle.heading_deg
        if vehicle.battery_percent >= 0:
            row[TrackChannel.BATTERY_PERCENT] = 100.0 * vehicle.battery_percent
        self._append(t_s, row)

    def _append(self, t_s: float, hundredths: list[float]) -> None:
        if self.latest_s is not None and t_s <= self.latest_s:
            return
        if self.latest_s is not None and t_s - self.latest_s > GAP_S:
            self.history.append((t_s + self.latest_s) / 2.0, np.full(len(TrackChannel), nan, np.float32))
            self.trail.interrupt()
        self.latest_s = t_s
        values = self.latest = np.array(hundredths, np.float32) / np.float32(100.0)
        self.history.append(t_s, values)
        x, y, height = (value / 100.0 for value in hundredths[:3])
        if x != x:
            self.trail.interrupt()
        else:
            self.trail.add(t_s, (x, y, height))

    def _receive_mission(self, before: PlatformSnapshot | None, after: PlatformSnapshot) -> None:
        mission = after.mission
        was = before.mission if before is not None else None
        if mission is None or mission is was or mission.value.state != ActionState.RUNNING:
            return
        if was is None or was.value.state not in (ActionState.RUNNING, ActionState.PAUSED):
            self.started_s = mission.received_s


class Tracks:
    """The tracks of a fleet, by the vehicle's name."""

    def __init__(self) -> None:
        self._tracks: dict[str, Track] = {}

    def __iter__(self) -> Iterator[tuple[str, Track]]:
        return iter(self._tracks.items())

    def get(self, name: str) -> Track | None:
        """A vehicle's track."""
        return self._tracks.get(name)

    @property
    def bytes(self) -> int:
        """The memory that they take."""
        return sum(track.bytes for track in self._tracks.values())

    def follow(self, before: Fleet, after: Fleet, now_s: float) -> None:
        """Takes in a change of the fleet."""
        if before.platforms is after.platforms:
            return
        for was, platform in after.changed_since(before):
            track = self._tracks.get(platform.name)
            if track is None:
                track = self._tracks[platform.name] = Track()
            track.follow(was, platform)
        if len(self._tracks) > len(after.platforms):
            self._tracks = {name: track for name, track in self._tracks.items() if name in after.platforms}
