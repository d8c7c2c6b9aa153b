"""Makes the project's own test data: `python -m tests.data.make` writes what lies in `missions` and `laser` beside it.

Data of earlier versions (`*-of-*`) are not made here: they are what those versions wrote.
"""

import json
from collections.abc import Iterator
from math import cos, pi, radians, sin
from typing import Any, Final

import numpy as np
from tests.data_folders import OWN
from tests.onboard.algorithms.scan_matching.rays import HOLD, Scanner

from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import ranges_of

HOME: Final = (39.5528, 2.6285)
"""Latitude and longitude of the home of all missions."""
DEG_PER_M: Final = 1.0 / 111_200.0
TAKE_OFF, WAYPOINT, RETURN, LAND, TRIGGER = 22, 16, 20, 21, 206
SCANS, BEAMS = 90, 181
SCAN_PERIOD_S: Final = 0.2


def files() -> dict[str, str]:
    """All files by their path below this folder, with their texts."""
    return {
        **{f"missions/{name}": json.dumps(plan, indent=1) + "\n" for name, plan in _plans().items()},
        **{f"missions/{name}": text for name, text in _waypoint_files().items()},
        "laser/hold.log": "".join(f"{line}\n" for line in _laser_log()),
    }


# --- missions ---


def _at(north_m: float, east_m: float) -> tuple[float, float]:
    return round(HOME[0] + north_m * DEG_PER_M, 7), round(HOME[1] + east_m * DEG_PER_M / cos(radians(HOME[0])), 7)


def _item(command: int, north_m: float = 0.0, east_m: float = 0.0, height_m: float = 10.0) -> dict[str, Any]:
    latitude, longitude = _at(north_m, east_m)
    params = [0, 0, 0, None, latitude, longitude, height_m]
    return {"type": "SimpleItem", "autoContinue": True, "command": command, "frame": 3, "params": params}


def _box() -> list[dict[str, Any]]:
    corners = [(20.0, 0.0), (20.0, 20.0), (0.0, 20.0)]
    return [_item(TAKE_OFF), *(_item(WAYPOINT, *corner) for corner in corners), _item(LAND, height_m=0.0)]


def _return() -> dict[str, Any]:
    return {"type": "SimpleItem", "autoContinue": True, "command": RETURN, "frame": 2, "params": [0, 0, 0, 0, 0, 0, 0]}


def _survey(version: int = 5) -> dict[str, Any]:
    """Two lanes with a camera that is triggered by distance, stored as the items that they stand for."""
    trigger = {"type": "SimpleItem", "autoContinue": True, "command": TRIGGER, "frame": 2}
    lanes = [(10.0, 0.0), (10.0, 30.0), (15.0, 30.0), (15.0, 0.0)]
    stored = [_item(WAYPOINT, *lanes[0], 12.0), {**trigger, "params": [2, 0, 1, 0, 0, 0, 0]}]
    stored += [_item(WAYPOINT, *lane, 12.0) for lane in lanes[1:]] + [{**trigger, "params": [0, 0, 1, 0, 0, 0, 0]}]
    return {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "version": version,
        "angle": 90,
        "polygon": [_at(north, east) for north, east in ((8.0, -2.0), (8.0, 32.0), (17.0, 32.0), (17.0, -2.0))],
        "TransectStyleComplexItem": {"version": 2, "Items": stored, "CameraCalc": {"version": 1}},
    }


def _plan(items: list[dict[str, Any]], version: int = 1, mission_version: int = 2, **more: Any) -> dict[str, Any]:
    mission = {
        "version": mission_version,
        "firmwareType": 12,
        "vehicleType": 2,
        "cruiseSpeed": 15,
        "hoverSpeed": 3,
        "plannedHomePosition": [*HOME, 2.0],
        "items": items,
    }
    empty = {
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
    }
    return {"fileType": "Plan", "version": version, "groundStation": "gloc3", "mission": mission, **empty, **more}


def _plans() -> dict[str, Any]:
    structure = {"type": "ComplexItem", "complexItemType": "StructureScan", "version": 3, "Layers": 2}
    without = {key: value for key, value in _survey().items() if key != "TransectStyleComplexItem"}
    fence = {
        "version": 2,
        "circles": [{"version": 1, "inclusion": False, "circle": {"center": _at(10.0, 10.0), "radius": 3}}],
        "polygons": [
            {
                "version": 1,
                "inclusion": True,
                "polygon": [_at(n, e) for n, e in ((-9, -9), (-9, 40), (40, 40), (40, -9))],
            }
        ],
    }
    return {
        "box.plan": _plan(_box()),
        "box_in_a_fence.plan": _plan(
            _box(), geoFence=fence, rallyPoints={"version": 2, "points": [[*_at(0.0, 5.0), 5.0]]}
        ),
        "box_and_return_in_a_fence.plan": _plan([*_box()[:-1], _return()], geoFence=fence),
        "survey.plan": _plan([_item(TAKE_OFF), _survey(), _item(LAND, height_m=0.0)]),
        "structure_scan.plan": _plan([_item(TAKE_OFF), structure]),
        "survey_without_items.plan": _plan([_item(TAKE_OFF), without]),
        "survey_of_another_version.plan": _plan([_item(TAKE_OFF), _survey(version=9)]),
        "mission_of_another_version.plan": _plan(_box(), mission_version=7),
        "plan_of_another_version.plan": _plan(_box(), version=42),
        "without_mission.plan": {"fileType": "Plan", "version": 1, "groundStation": "gloc3"},
    }


def _waypoint_files() -> dict[str, str]:
    places = [(*HOME, 2.0), *((*_at(n, e), 10.0) for n, e in ((20.0, 0.0), (20.0, 20.0), (0.0, 20.0)))]
    rows = [
        "\t".join(map(str, (index, int(index == 0), 0 if index == 0 else 3, WAYPOINT, 0, 0, 0, 0, *place, 1)))
        for index, place in enumerate(places)
    ]
    return {
        "box.waypoints": "\n".join(("QGC WPL 110", *rows, "")),
        "fence.txt": "".join(f"{latitude}\t{longitude}\n" for latitude, longitude, _ in places),
        "rally.txt": "".join(f"RALLY\t{lat}\t{lon}\t{height}\t20\t0\t0\n" for lat, lon, height in places),
    }


# --- laser logs ---


def _laser_log() -> Iterator[str]:
    """A CARMEN log of a drive through the hold: half a turn of beams, wheels that drift, and where it really was."""
    random = np.random.default_rng(7)
    scanner = Scanner(HOLD, BEAMS, angle_min_rad=-pi / 2.0, angle_span_rad=pi * BEAMS / (BEAMS - 1), range_max_m=25.0)
    wheels, before = Planar(), Planar()
    yield "# a drive through the simulated hold: x forward, y left, metres and radians"
    for number in range(SCANS):
        t_s = number * SCAN_PERIOD_S
        pose = Planar(0.12 * number, 0.6 * sin(0.09 * number), 0.35 * sin(0.05 * number))
        wheels, before = wheels @ _drifted(before.inverse() @ pose), pose
        ranges = [f"{reading:.2f}" for reading in ranges_of(scanner.scan(pose, random))]
        place, rolled = (f"{one.x_m:.4f} {-one.y_m:.4f} {-one.yaw_rad:.5f}" for one in (pose, wheels))
        yield f"ODOM {rolled} 0 0 0 {t_s:.2f} gloc3 {t_s:.2f}"
        yield f"FLASER {BEAMS} {' '.join(ranges)} {place} {rolled} {t_s:.2f} gloc3 {t_s:.2f}"


def _drifted(step: Planar) -> Planar:
    """As wheels tell it that are a little too small, one of them more."""
    return Planar(1.03 * step.x_m, step.y_m, step.yaw_rad + 0.004)


if __name__ == "__main__":
    for name, text in files().items():
        (OWN / name).parent.mkdir(exist_ok=True)
        (OWN / name).write_text(text, encoding="utf-8")
