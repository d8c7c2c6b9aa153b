"""DP: a map of what is free and what is occupied, from a laser scanner or point clouds, and the pose."""

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Output, PortReport, Result
from gloc3.component.settings import Bounds
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.neighbours import Neighbours
from gloc3.messages.perception import LaserScan, OccupancyMap, PointCloud
from gloc3.messages.vehicle import HeightAboveGround, Pose
from gloc3_onboard.algorithms.mapping.occupancy import OccupancyStack
from gloc3_onboard.algorithms.scan_matching.planar import Array
from gloc3_onboard.algorithms.scan_matching.scan_placement import (
    ScanPlacement,
    ScanPlacementSettings,
    place_body,
)
from gloc3_onboard.algorithms.scan_matching.scan_points import cloud_fault, fault_of, level_points, points_of

CLOUD_BEAMS = 720
"""Directions in which the nearest point of a cloud ends what is free."""
UNCHANGED_S = 5.0
"""A map into which no scan has come is reported this often."""


class MapSettings(ScanPlacementSettings, frozen=True):
    """Settings of the map."""

    cell_m: Annotated[float, Bounds(0.05, 1.0)] = 0.1
    """Side of a cell, in metres."""
    layer_m: Annotated[float, Bounds(0.1, 5.0)] = 0.5
    """Thickness of a layer, in metres: what is seen in one says nothing about the others."""
    most_m: Annotated[float, Bounds(10.0, 200.0)] = 80.0
    """Largest side of the map, in metres; what is beyond is not entered."""
    most_layers: Annotated[int, Bounds(1, 40)] = 16
    """Number of layers at most."""
    range_m: Annotated[float, Bounds(1.0, 60.0)] = 10.0
    """What is farther away is not entered, in metres."""
    scan_period_s: Annotated[float, Bounds(0.0, 10.0)] = 0.2
    """Least time from one scan that is entered to the next, in seconds."""
    period_s: Annotated[float, Bounds(0.5, 60.0)] = 1.0
    """Least time from one report to the next, in seconds."""
    std_limit_m: Annotated[float, Bounds(0.01, 10.0)] = 0.25
    """With a pose less certain than this (standard deviation to the side, in metres) nothing is entered."""
    others_m: Annotated[float, Bounds(0.0, 10.0)] = 1.0
    """What is so near to another vehicle, in metres, is that vehicle and not entered."""


def stack_with(known: OccupancyMap | None, settings: MapSettings) -> OccupancyStack:
    """An empty map, or one that begins with what is known.

    Raises:
        Refused: the known map does not fit the settings.
    """
    stack = OccupancyStack(settings.cell_m, settings.layer_m, settings.most_m, settings.most_layers)
    if known is None:
        return stack
    sizes = (known.cell_m, known.layer_m)
    if not np.allclose(sizes, (settings.cell_m, settings.layer_m), rtol=1e-6):
        raise Refused(
            f"the known map has cells of {sizes[0]:g} m and layers of {sizes[1]:g} m; "
            f"set cell_m and layer_m, which are {settings.cell_m:g} and {settings.layer_m:g}"
        )
    if not stack.add_map(known):
        north_m, east_m = known.rows * known.cell_m, known.columns * known.cell_m
        raise Refused(
            f"the known map is {north_m:g} m by {east_m:g} m with {len(known.levels)} layers; "
            f"set most_m and most_layers, which are {settings.most_m:g} and {settings.most_layers}, or cut it"
        )
    return stack


class MapProcessor(DataProcessor[MapSettings]):
    """Enters scans and clouds into a map, while the pose is valid and certain, and reports it at most once a second.

    The map's time of validity is that of the last scan in it; before the first one, of the component's first cycle.
    """

    loggable = ("scans", "left_out", "reason")

    laser = Input(LaserScan)
    cloud = Input(PointCloud)
    pose = Input(Pose)
    height = Input(HeightAboveGround)
    neighbours = Input(Neighbours)
    map = Output(OccupancyMap, frame="ned")

    def __init__(self, known: OccupancyMap | None = None) -> None:
        self._known = known
        self.scans = self.left_out = 0
        self.reason = ""
        """Why the last scan was left out; empty if it was entered."""
        self._entered_s = self._reported_s = -math.inf
        self._begun_s = math.inf
        """When the first cycle was."""
        self._last: PortReport | None = None

    def start(self) -> None:
        """Begins with what is known already.

        Raises:
            Refused: the known map does not fit the settings.
        """
        self._stack = stack_with(self._known, self.settings)
        self._entered_s = self._reported_s = -math.inf
        self._begun_s, self._last = math.inf, None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Enters a new scan, and reports when it is due."""
        self._begun_s = min(self._begun_s, now_s)
        pose = inbox.latest(self.pose)
        seen: list[Envelope[LaserScan] | Envelope[PointCloud]] = [*inbox.new(self.laser), *inbox.new(self.cloud)]
        for scan in seen:
            if scan.t_s - self._entered_s < self.settings.scan_period_s - 1e-6:
                continue
            self.reason = self._enter(scan, pose, inbox)
            self.scans += not self.reason
            self.left_out += bool(self.reason)
        if pose is None or now_s - self._reported_s < self.settings.period_s - 1e-6:
            return []
        report = self.map.report(
            self._stack.message(-pose.payload.position_ned_m[2]), t_s=max(self._entered_s, self._begun_s)
        )
        if report == self._last and now_s - self._reported_s < UNCHANGED_S:
            return []
        self._last, self._reported_s = report, now_s
        return [report]

    def _enter(
        self, scan: Envelope[LaserScan] | Envelope[PointCloud], pose: Envelope[Pose] | None, inbox: Inbox
    ) -> str:
        """Enters a scan or a cloud, or says why not."""
        payload, height = scan.payload, inbox.latest(self.height)
        duration_s = payload.duration_s if isinstance(payload, LaserScan) else 0.0
        placed = place_body(scan.t_s, pose, height, self.settings, duration_s)
        if placed is None or pose is None:
            return "there is no valid pose at the time of the scan"
        std_m = max(pose.payload.position_std_m[:2])
        if std_m > self.settings.std_limit_m:
            return f"the pose is not certain enough: {std_m:.2f} m"
        if fault := fault_of(payload) if isinstance(payload, LaserScan) else cloud_fault(payload):
            return fault
        if not self._stack.reach((placed.pose[0], placed.pose[1]), self.settings.range_m):
            return f"the vehicle is outside the map, which is as large as it may be: {self.settings.most_m:g} m"
        self._entered_s = scan.t_s
        others = inbox.latest(self.neighbours)
        vehicles = others.payload.vehicles if others is not None else []
        beams, groups = _hits_ned_m(payload, placed, self.settings)
        for hits in groups:
            self._stack.add_scan(
                (*placed.pose[:2], -placed.height_m),
                hits,
                beams,
                self.settings.range_m,
                [one.position_ned_m[:2] for one in vehicles],
                self.settings.others_m,
            )
        return ""


def _hits_ned_m(scan: LaserScan | PointCloud, placed: ScanPlacement, settings: MapSettings) -> tuple[int, list[Array]]:
    """Beams of a whole turn, and what was hit, without the floor, each of shape (n, 3): of a cloud, layer by layer."""
    if isinstance(scan, LaserScan):
        found = points_of(scan, placed.tilt, settings.mount, placed.motion)
        hits = np.column_stack((placed.pose.apply(found.points_m), found.below_m - placed.height_m))
        return max(1, round(2.0 * math.pi / abs(scan.angle_step_rad))), [hits]
    seen = level_points(scan, placed.tilt, placed.twist)
    points = seen.points_m[~seen.is_floor]
    hits = np.column_stack((placed.pose.apply(points[:, :2]), points[:, 2] - placed.height_m))
    levels = np.floor(-hits[:, 2] / settings.layer_m)
    return CLOUD_BEAMS, [hits[levels == level] for level in np.unique(levels)]
